#include "imu_io/base/line_source.h"

namespace turncal {

std::vector<LineSource> read_line_sources(KeyValueFile& file) {
  const std::vector<std::string> named = file.keys_with_prefix("source.");
  for (const std::string& key : named) file.text(key);
  std::vector<LineSource> lines;
  for (const std::string& key : file.keys()) {
    if (key.starts_with("source.")) continue;
    LineSource line{key, file.line_of(key), ""};
    const std::string comment = file.comment_of(key);
    const std::size_t end = comment.find(']');
    if (comment.starts_with('[') && end != std::string::npos) line.mark = comment.substr(1, end - 1);
    const bool known = line.mark.empty() || line.is_guess() || line.mark == "yours" || file.has("source." + line.mark);
    if (!known && !named.empty())
      file.reject(key, "[guess], [yours] or a NAME of a line source.NAME after its #, not [" + line.mark + "]");
    if (!known) line.mark.clear();
    lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace turncal
