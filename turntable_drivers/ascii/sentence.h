// Sentences of an ASCII dialect: templates that are filled in or matched, checksums, and control characters written as \r \n.
// Pure functions.
//
// A template is literal text with placeholders in braces: ":DEM:POS {axis},{position}". Matching is anchored at both ends; a
// placeholder takes at least one character and no blank and no comma, {*} takes anything. The same template is what the driver
// expects and what the twin says.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace turncal {

class SentenceTemplate {
 public:
  // Empty: a brace without its partner, an empty name, or two placeholders with nothing between them.
  static std::optional<SentenceTemplate> parse(std::string_view text);
  std::string fill(const std::function<std::string(const std::string& name)>& value) const;
  // The values by name; empty when it does not match.
  std::optional<std::map<std::string, std::string>> match(std::string_view sentence) const;
  bool has(std::string_view name) const;
  std::vector<std::string> names() const;
  const std::string& text() const { return text_; }

 private:
  struct Piece {
    std::string literal;
    std::string name;  // empty: literal
  };
  std::string text_;
  std::vector<Piece> pieces_;
};

enum class SentenceCheck { none, sum8, exclusive_or };
// Two hexadecimal digits, upper case, over all characters of the body.
std::string check_digits(std::string_view body, SentenceCheck check);

// \r \n \t \\ as characters; empty for anything else after a backslash.
std::optional<std::string> unescaped(std::string_view text);
// Control characters made visible, for messages.
std::string visible(std::string_view text);

}  // namespace turncal
