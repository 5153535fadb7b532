#include "turntable_drivers/manual/operator_texts.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdio>

#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {

extern const std::string_view operator_texts_en, operator_texts_de, operator_texts_zh;

OperatorTexts::OperatorTexts(std::string_view language) {
  const std::string_view text = language == "de"   ? operator_texts_de
                                : language == "zh" ? operator_texts_zh
                                                   : operator_texts_en;
  Result<KeyValueFile> file = KeyValueFile::parse(text, std::string(language) + ".conf");
  assert(file.ok());
  for (const std::string& key : file->keys()) texts_[key] = file->text(key);
}

const OperatorTexts& OperatorTexts::of(std::string_view language) {
  static const OperatorTexts english("en"), german("de"), chinese("zh");
  return language == "de" ? german : language == "zh" ? chinese : english;
}

std::string OperatorTexts::say(std::string_view key, Places places) const {
  const auto found = texts_.find(key);
  assert(found != texts_.end());
  if (found == texts_.end()) return std::string(key);
  std::string said;
  std::string_view left = found->second;
  for (std::size_t open; (open = left.find('{')) != std::string_view::npos;) {
    const std::size_t shut = std::min(left.find('}', open), left.size() - 1);
    const std::string_view name = left.substr(open + 1, shut - open - 1);
    const auto place =
        std::find_if(places.begin(), places.end(), [name](const auto& one) { return one.first == name; });
    assert(place != places.end());
    said += left.substr(0, open);
    if (place != places.end()) said += place->second;
    left.remove_prefix(shut + 1);
  }
  return said += left;
}

std::string OperatorTexts::number(std::string text) const {
  if (const std::size_t point = text.find('.'); point != std::string::npos) text.replace(point, 1, say("number.point"));
  return text;
}

std::string OperatorTexts::shown(double angle_deg) const {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", std::abs(angle_deg) < 1e-9 ? 0.0 : angle_deg);
  return number(text);
}

std::string OperatorTexts::exact(double angle_deg) const { return number(format_number(angle_deg)); }

bool OperatorTexts::means(const std::string& typed, std::string_view english) const {
  return typed == english || typed == say("word." + std::string(english)) ||
         (english != "abort" && first_letter(typed, english));
}

bool OperatorTexts::first_letter(const std::string& typed, std::string_view english) const {
  const std::string own = say("word." + std::string(english));
  return typed == english.substr(0, 1) || typed == own.substr(0, printable_character(own));
}

}  // namespace turncal
