#include "imu_io/base/checksum_line.h"

#include <algorithm>
#include <cstdio>

#include "imu_io/base/crc32c.h"

namespace turncal {
namespace {

constexpr std::string_view checksum_key = "checksum = ";

std::string checksum_line(std::string_view text) {
  char hex[9];
  std::snprintf(hex, sizeof hex, "%08x", static_cast<unsigned>(crc32c(text)));
  return std::string(checksum_key) + hex + "\n";
}

}  // namespace

std::string with_checksum(std::string text) {
  text += checksum_line(text);
  return text;
}

Result<std::string_view> without_checksum(std::string_view text, const std::string& file_name) {
  const std::size_t place = text.rfind("\n" + std::string(checksum_key));
  if (place == std::string_view::npos) {
    return input_error(file_name + ": no checksum: expected 'checksum = ' and 8 hex digits in the last line");
  }
  const std::string_view above = text.substr(0, place + 1);
  const std::string_view last = text.substr(place + 1);
  const std::string_view after = last.substr(std::min(last.size(), checksum_key.size() + 8));
  if (after != "\n" && after.find_first_not_of("\r\n") != std::string_view::npos) {
    return input_error(file_name + ": text after the checksum: expected it to be the last line");
  }
  if (last != checksum_line(above)) {
    return input_error(file_name + ": wrong checksum: the file was damaged or edited after it was written");
  }
  return above;
}

}  // namespace turncal
