// Small pieces that every text reader needs: trimming, splitting, and showing a stretch of somebody's file in a
// message.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace turncal {

// Without blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

// The parts between separators, trimmed; one empty part for an empty text.
std::vector<std::string_view> split(std::string_view text, char separator);

// 'text' in quotes, on one line and of bounded length, whatever stood in the file.
std::string quoted(std::string_view text);

// Takes the next line off the front, without its LF or CRLF. had_end: whether there was one.
std::string_view take_line(std::string_view& text, bool* had_end = nullptr);

// A number as devices and people write it: blanks around it and a leading + are allowed; nothing else beside the number is.
std::optional<double> device_number(std::string_view text);

}  // namespace turncal
