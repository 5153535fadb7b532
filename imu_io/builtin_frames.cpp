#include "imu_io/builtin_frames.h"

#include <iterator>

#include "imu_io/text_pieces.h"

namespace turncal {

namespace {

struct BuiltinFrame {
  std::string_view name;
  std::string_view text;
};
constexpr BuiltinFrame builtin_frames[] = {
#include "builtin_frames.inc"  // made at build time of imu_io/frames/*.frame
};

}  // namespace

std::vector<std::string_view> builtin_frame_names() {
  std::vector<std::string_view> names;
  for (const BuiltinFrame& frame : builtin_frames) names.push_back(frame.name);
  return names;
}

std::string_view builtin_frame_text(std::string_view name) {
  for (const BuiltinFrame& frame : builtin_frames) {
    if (frame.name == name) return frame.text;
  }
  return {};
}

Result<FrameDescription> find_frame(const std::string& name_or_path) {
  if (name_or_path.find('/') != std::string::npos || name_or_path.ends_with(".frame")) {
    return read_frame_description(name_or_path);
  }
  const std::string_view text = builtin_frame_text(name_or_path);
  if (text.empty()) {
    std::string known;
    for (const std::string_view name : builtin_frame_names()) known += (known.empty() ? "" : ", ") + std::string(name);
    return input_error("frame " + quoted(name_or_path) + " is not known: expected one of " + known +
                       ", or a file (with '/' or '.frame' in its name)");
  }
  return parse_frame_description(text, "built-in " + name_or_path + ".frame");
}

}  // namespace turncal
