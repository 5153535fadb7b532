// The languages of the operator: each says everything that English says, with the same places, and nothing is there that nobody says.
#include "turntable_drivers/manual/manual_turntable.h"

#include "imu_io/base/text.h"
#include "tests/test.h"

namespace turncal {
namespace {

std::multiset<std::string> places_of(const std::string& text) {
  std::multiset<std::string> places;
  for (std::size_t open = 0; (open = text.find('{', open)) != std::string::npos; ++open)
    places.insert(text.substr(open, text.find('}', open) - open + 1));
  return places;
}

// Every source that may speak to an operator.
std::string sources() {
  std::ostringstream all;
  for (const char* folder : {"turntable_drivers/manual", "orchestrator/watch", "orchestrator/devices"}) {
    for (const auto& entry : std::filesystem::directory_iterator(std::string(TURNCAL_SOURCE_DIR) + "/" + folder)) {
      const std::string name = entry.path().extension();
      if (name == ".cpp" || name == ".h") all << std::ifstream(entry.path()).rdbuf();
    }
  }
  return all.str();
}

TEST(OperatorTexts, EveryLanguageSaysEverythingWithTheSamePlaces) {
  const auto& english = OperatorTexts::of("en").all();
  ASSERT_GT(english.size(), 50u);
  for (const std::string_view language : operator_languages) {
    const auto& texts = OperatorTexts::of(language).all();
    for (const auto& [key, text] : english) {
      ASSERT_TRUE(texts.contains(key)) << language << ": no " << key;
      const auto here = places_of(texts.at(key)), there = places_of(text);
      // A language may name a place twice.
      EXPECT_EQ(std::set(here.begin(), here.end()), std::set(there.begin(), there.end())) << language << ": " << key;
      EXPECT_FALSE(texts.at(key).empty()) << language << ": " << key;
    }
    for (const auto& [key, text] : texts) EXPECT_TRUE(english.contains(key)) << language << ": " << key;
  }
  EXPECT_NE(OperatorTexts::of("de").all(), english);
  EXPECT_NE(OperatorTexts::of("zh").all(), english);
}

TEST(OperatorTexts, EveryKeyIsSaid) {
  const std::string code = sources();
  for (const auto& [key, text] : OperatorTexts::of("en").all()) {
    const bool named = key.starts_with("axis.");  // by to_string(axis)
    const std::string said = key.starts_with("word.") ? "is(\"" + key.substr(5) + "\")" : "\"" + key + "\"";
    EXPECT_TRUE(named || code.find(said) != std::string::npos) << key;
  }
}

// What the code says, English has: a key that is missing would be shown as it is.
TEST(OperatorTexts, EveryKeyThatIsSaidIsThere) {
  const std::string code = sources();
  int found = 0;
  for (const std::string_view group :
       {"ask", "reason", "screen", "wrong", "said", "help", "mount", "sense", "number"}) {
    const std::string begin = "\"" + std::string(group) + ".";
    for (std::size_t at = 0; (at = code.find(begin, at)) != std::string::npos; ++at) {
      const std::string key = code.substr(at + 1, code.find('"', at + 1) - at - 1);
      EXPECT_TRUE(OperatorTexts::of("en").all().contains(key)) << key;
      ++found;
    }
  }
  EXPECT_GT(found, 50);
}

// A letter that two words share would do what nobody asked for; none gives the run up.
TEST(OperatorTexts, NoTwoWordsShareAFirstLetter) {
  constexpr const char* words[] = {"repeat", "skip", "pause", "continue", "leave", "abort", "help"};
  for (const std::string_view language : operator_languages) {
    const OperatorTexts& texts = OperatorTexts::of(language);
    for (const std::string typed : {"r", "s", "p", "c", "l", "a", "h"}) {
      for (const char* own : words) {
        const std::string full = texts.say(std::string("word.") + own);
        for (const std::string& letter : {typed, full.substr(0, printable_character(full))}) {
          int meanings = 0;
          for (const char* word : words) meanings += texts.first_letter(letter, word) ? 1 : 0;
          EXPECT_EQ(meanings, 1) << language << ": " << letter;
          EXPECT_FALSE(texts.means(letter, "abort")) << language << ": " << letter;
        }
        EXPECT_TRUE(texts.means(full, own)) << language << ": " << full;
      }
    }
  }
}

TEST(OperatorTexts, PlacesAreFilledAndWordsUnderstood) {
  const OperatorTexts& german = OperatorTexts::of("de");
  EXPECT_EQ(german.say("screen.turn", {{"target", "90"}, {"axis", german.say("axis.pitch")}}),
            "Nickachse auf 90° drehen");
  EXPECT_TRUE(german.means("weiter", "continue"));
  EXPECT_TRUE(german.means("continue", "continue"));
  EXPECT_TRUE(german.means("c", "continue"));
  EXPECT_TRUE(german.means("w", "continue"));
  EXPECT_TRUE(german.means("\u00fc", "skip"));
  EXPECT_FALSE(german.means("\xc3", "skip"));
  EXPECT_EQ(german.exact(-89.875), "-89,875");
  EXPECT_EQ(german.shown(0.1), "0,1");
  EXPECT_EQ(OperatorTexts::of("zh").shown(0.1), "0.1");
  EXPECT_TRUE(OperatorTexts::of("zh").means("继续", "continue"));
}

}  // namespace
}  // namespace turncal
