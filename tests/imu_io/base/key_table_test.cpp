#include "imu_io/base/key_value.h"

#include <gtest/gtest.h>

namespace turncal {
namespace {

enum class Shape { round, square, flat };

struct Settings {
  double width = 2.0;
  std::optional<double> height;
  int count = 3;
  bool open = true;
  std::string label = "plain";
  Shape shape = Shape::square;
};

void read(KeyTable& keys, Settings& settings) {
  keys.number("width", settings.width, between(1.0, 10.0));
  keys.number("height", settings.height);
  keys.whole("count", settings.count, 0, 9);
  keys.flag("open", settings.open);
  keys.text("label", settings.label);
  keys.chosen("shape", settings.shape, {"round", "square", "flat"});
}

Status read(const std::string& text, Settings& settings) {
  auto file = KeyValueFile::parse(text, "a.conf");
  if (!file) return file.error();
  KeyTable keys(*file, between(-5.0, 5.0));
  read(keys, settings);
  return file->check_all_used();
}

TEST(KeyTable, AKeyThatIsNotThereLeavesItsDefault) {
  Settings settings;
  ASSERT_TRUE(read("format = 1\n", settings).error().message.ends_with("'format' is unknown"));
  EXPECT_EQ(settings.width, 2.0);
  EXPECT_FALSE(settings.height);
  EXPECT_EQ(settings.count, 3);
  EXPECT_TRUE(settings.open);
  EXPECT_EQ(settings.label, "plain");
  EXPECT_EQ(settings.shape, Shape::square);
}

TEST(KeyTable, AKeyThatIsThereSetsItsField) {
  Settings settings;
  ASSERT_TRUE(read("width = 9.5\nheight = -5\ncount = 0\nopen = false\nlabel = fine\nshape = flat\n", settings).ok());
  EXPECT_EQ(settings.width, 9.5);
  EXPECT_EQ(settings.height, -5.0);
  EXPECT_EQ(settings.count, 0);
  EXPECT_FALSE(settings.open);
  EXPECT_EQ(settings.label, "fine");
  EXPECT_EQ(settings.shape, Shape::flat);
}

TEST(KeyTable, DefectsNameFileLineKeyValueAndRange) {
  const std::pair<std::string, std::string> cases[] = {
      {"width = 11", "'width' = '11': expected a number between 1 and 10"},
      {"height = 6", "'height' = '6': expected a number between -5 and 5"},  // the range that is usual here
      {"count = 10", "'count' = '10': expected a whole number between 0 and 9"},
      {"open = yes", "'open' = 'yes': expected true or false"},
      {"shape = thin", "'shape' = 'thin': expected round, square or flat"}};
  for (const auto& [line, expected] : cases) {
    Settings settings;
    EXPECT_EQ(read(line + "\n", settings).error().message, "a.conf:1: key " + expected);
  }
}

}  // namespace
}  // namespace turncal
