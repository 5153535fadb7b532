// All that the operator of a table turned by hand reads, in one file a language: texts/en.conf, de.conf, zh.conf, compiled in. What
// engineers read (log, journal, errors) is English and not here. A text has {places}; every language has those of the English one.
#pragma once

#include <array>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <utility>

namespace turncal {

inline constexpr std::array<std::string_view, 3> operator_languages = {"en", "de", "zh"};

class OperatorTexts {
 public:
  // REQUIRES: one of operator_languages.
  static const OperatorTexts& of(std::string_view language);

  using Places = std::initializer_list<std::pair<std::string_view, std::string>>;
  // REQUIRES: a key of en.conf, and its places.
  std::string say(std::string_view key, Places places = {}) const;
  // Angles, with this language's decimal point: to four digits, and as they are.
  std::string shown(double angle_deg) const;
  std::string exact(double angle_deg) const;
  // Whether somebody typed this: "pause" is the English word of word.pause, this language's own, or the first letter of either. What
  // gives the run up has to be the whole word.
  bool means(const std::string& typed, std::string_view english) const;
  bool first_letter(const std::string& typed, std::string_view english) const;
  const std::map<std::string, std::string, std::less<>>& all() const { return texts_; }

 private:
  explicit OperatorTexts(std::string_view language);
  std::string number(std::string text) const;
  std::map<std::string, std::string, std::less<>> texts_;
};

}  // namespace turncal
