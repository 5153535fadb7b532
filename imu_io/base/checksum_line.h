// Text files that tell whether they are whole: the last line is `checksum = ` and the CRC-32C, as 8 hex digits, of all bytes above it. It
// tells damage and careless editing, not forgery.
#pragma once

#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

// `text` ends its last line.
std::string with_checksum(std::string text);
// What stands above the checksum. An error when there is none, when it is wrong, or when it is not the last line.
Result<std::string_view> without_checksum(std::string_view text, const std::string& file_name);

}  // namespace turncal
