// Sentences of an ASCII dialect: templates that are filled in or matched, checksums, and control characters written as \r \n.
// Pure functions.
//
// A template is literal text with placeholders in braces: ":DEM:POS {axis},{position}". Matching is anchored at both ends; a
// placeholder takes at least one character and no blank, comma or line break, {*} takes anything. {position:10} is exactly 10 characters
// wide: with blanks around it when it is matched, filled up with zeros after the sign when it is filled in. The same template is what the driver
// expects and what the twin says.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/crc.h"

namespace turncal {

class SentenceTemplate {
 public:
  // Empty: a brace without its partner, an empty name, a width that is none, or a placeholder without a width right before another.
  static std::optional<SentenceTemplate> parse(std::string_view text);
  std::string fill(const std::function<std::string(const std::string& name)>& value) const;
  // The values by name; empty when it does not match.
  std::optional<std::map<std::string, std::string>> match(std::string_view sentence) const;
  bool has(std::string_view name) const;
  std::vector<std::string> names() const;
  std::size_t width_of(std::string_view name) const;  // 0: any
  const std::string& text() const { return text_; }
  int lines() const;  // of a sentence that matches

 private:
  struct Piece {
    std::string literal;
    std::string name;       // empty: literal
    std::size_t width = 0;  // 0: any
  };
  std::string text_;
  std::vector<Piece> pieces_;
};

enum class SentenceCheck { none, sum8, exclusive_or, crc16 };
// Two hexadecimal digits, four of a CRC, upper case, over all characters of the body.
std::string check_digits(std::string_view body, SentenceCheck check, const CrcParameters& crc = {});

// \r \n \t \\ as characters; empty for anything else after a backslash.
std::optional<std::string> unescaped(std::string_view text);

}  // namespace turncal
