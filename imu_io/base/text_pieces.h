// Small pieces that every text reader needs: trimming, splitting, and showing a stretch of somebody's file in a
// message.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace turncal {

// Without blanks and tabs at both ends.
std::string_view trimmed(std::string_view text);

// The parts between separators, trimmed; one empty part for an empty text.
std::vector<std::string_view> split(std::string_view text, char separator);
// Those between blanks, the empty ones left out.
std::vector<std::string_view> split_words(std::string_view text);
// Into `cells`, without the quotes about them; between any run of blanks where the separator is one.
void split_cells(std::string_view row, char separator, std::vector<std::string_view>& cells);

// How many bytes the first character of a UTF-8 text has (RFC 3629), and its code point; 0 when it is none.
std::size_t utf8_character(std::string_view text, std::uint32_t* code = nullptr);
// The same; 0 too for one that is not printed: a control character (C0, DEL, C1: U+0080 to U+009F), a line or paragraph
// separator, or one that turns the direction of writing.
std::size_t printable_character(std::string_view text);

// 'text' in quotes, on one line and of bounded length, whatever stood in the file.
std::string quoted(std::string_view text);

// Takes the next line off the front, without its LF or CRLF. had_end: whether there was one.
std::string_view next_line(std::string_view& text, bool* had_end = nullptr);

// A number as devices and people write it: blanks around it and a leading + are allowed; nothing else beside the number is.
// decimal_comma: 1,5 is one, too.
std::optional<double> device_number(std::string_view text, bool decimal_comma = false);

// "Did you mean ...?": the known word that somebody probably meant to type.
//
// Distance: the smallest number of letters inserted, left out, replaced or swapped with their neighbour, no stretch edited twice
// (optimal string alignment). Close is up to one error for every three letters of what was typed, three at most.
std::size_t edit_distance(std::string_view a, std::string_view b);

// "; did you mean 'run'?", to put behind a message; nothing when no word is close. Of equally close ones: one with the same first
// letter, then the first.
std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known);

}  // namespace turncal
