#include "imu_io/base/key_value.h"

#include "tests/test.h"

namespace turncal {
namespace {

KeyValueFile parsed(const std::string& text) {
  auto file = KeyValueFile::parse(text, "a.conf");
  EXPECT_OK(file);
  return std::move(*file);
}

TEST(KeyValue, ReadsEveryType) {
  auto file = parsed(
      "# a comment\n"
      "\n"
      "name = north bench  # with a comment\n"
      "  site.latitude_deg=29.53\r\n"
      "table.turns = -3\n"
      "manual = true\n"
      "kind = serial\n"
      "limits = -1, 2.5 ,3e2\n"
      "effects = a, b\n"
      "none =\n");
  EXPECT_EQ(file.text("name"), "north bench");
  EXPECT_EQ(file.number("site.latitude_deg", between(-90, 90)), 29.53);
  EXPECT_EQ(file.integer("table.turns"), -3);
  EXPECT_TRUE(file.boolean_or("manual", false));
  EXPECT_EQ(file.one_of("kind", {"serial", "modbus"}), "serial");
  EXPECT_EQ(file.numbers("limits", 3), (std::vector<double>{-1, 2.5, 300}));
  EXPECT_EQ(file.list("effects"), (std::vector<std::string>{"a", "b"}));
  EXPECT_TRUE(file.list("none").empty());
  ASSERT_OK(file.check_all_used());
  EXPECT_EQ(file.line_of("manual"), 6);
  file = parsed("effect.b.x = 1\nother = 2\neffect.a.y = 3\n");
  EXPECT_EQ(file.keys_with_prefix("effect."), (std::vector<std::string>{"effect.b.x", "effect.a.y"}));
  EXPECT_EQ(file.keys().size(), 3U);
}

TEST(KeyValue, OptionalKeysTakeTheirDefault) {
  auto file = parsed("there = 5\n");
  EXPECT_EQ(file.number_or("there", 1.0), 5.0);
  EXPECT_EQ(file.number_or("missing", 1.0), 1.0);
  EXPECT_FALSE(file.number_if("missing").has_value());
  EXPECT_EQ(file.integer_or("missing", 7), 7);
  EXPECT_TRUE(file.boolean_or("missing", true));
  EXPECT_EQ(file.text_or("missing", "x"), "x");
  EXPECT_EQ(file.one_of_or("missing", "a", {"a", "b"}), "a");
  EXPECT_EQ(file.numbers_or("missing", {1, 2}).size(), 2U);
  EXPECT_EQ(file.list_or("missing", {"q"}).size(), 1U);
  ASSERT_OK(file.check_all_used());
}

// What a value of the wrong kind is answered with: file, line, key, value, and what was expected.
TEST(KeyValue, ABadValueIsOneLine) {
  using File = KeyValueFile;
  const struct {
    const char* value;
    void (*get)(File&);
    const char* expected;
  } cases[] = {
      {"x1", [](File& f) { EXPECT_TRUE(std::isnan(f.number("k"))); }, "a number"},
      {"nan", [](File& f) { f.number("k"); }, "a number"},
      {"0", [](File& f) { f.number("k", positive); }, "a number > 0"},
      {"-1", [](File& f) { f.number_or("k", 3, not_negative); }, "a number >= 0"},
      {"91", [](File& f) { f.number_if("k", between(-90, 90)); }, "a number between -90 and 90"},
      {"1.5", [](File& f) { f.integer("k"); }, "a whole number"},
      {"0", [](File& f) { f.integer("k", 1, 9); }, "a whole number between 1 and 9"},
      {"0", [](File& f) { f.integer("k", 1); }, "a whole number >= 1"},
      {"yes", [](File& f) { f.boolean_or("k", true); }, "true or false"},
      {"tpc",
       [](File& f) {
         f.one_of("k", {"a", "tcp", "c"});
       },
       "a, tcp or c; did you mean 'tcp'?"},
      {"1, 2", [](File& f) { EXPECT_EQ(f.numbers("k", 3).size(), 3U); },
       "3 numbers separated by commas, each a number"},
      {"1, -2", [](File& f) { f.numbers("k", 0, positive); }, "numbers separated by commas, each a number > 0"},
      {"a,,b", [](File& f) { f.list("k"); }, "names separated by commas, none empty"},
      {"", [](File& f) { f.text("k"); }, "a text"},
      {"q", [](File& f) { f.text("k"), f.reject("k", "a port"); }, "a port"}};
  for (const auto& [value, get, expected] : cases) {
    auto file = parsed(std::string("# top\nk = ") + value + "\n");
    get(file);
    const std::string message = std::string("a.conf:2: key 'k' = '") + value + "': expected " + expected;
    EXPECT_ERROR(file.check_all_used(), message);
    EXPECT_ERROR(file.status(), message);
  }
}

TEST(KeyValue, MissingRequiredKeySaysWhatWasExpected) {
  auto file = parsed("a = 1\n");
  file.number("a");
  file.number("table.rate_degps", positive);
  EXPECT_ERROR(file.check_all_used(), "a.conf: key 'table.rate_degps' is missing: expected a number > 0");
}

TEST(KeyValue, FirstDefectWins) {
  auto file = parsed("a = x\nb = y\nunknown = 1\n");
  file.number("a");
  file.number("b");
  EXPECT_ERROR(file.check_all_used(), "a.conf:1: key 'a' = 'x': expected a number");
}

TEST(KeyValue, UnknownKeyIsAnErrorAlsoAfterLookingAtIt) {
  auto file = parsed("a = 1\ntable.rat = 2\n");
  file.number("a");
  EXPECT_TRUE(file.has("table.rat"));
  file.keys_with_prefix("table.");
  EXPECT_ERROR(file.check_all_used(), "a.conf:2: key 'table.rat' is unknown");
}

TEST(KeyValue, AMisspeltKeyIsNamedWithTheOneThatWasMeant) {
  auto optional = parsed("a = 1\nhook.doen = x\n");
  optional.number("a");
  optional.text_or("hook.done", "");
  EXPECT_ERROR(optional.check_all_used(), "a.conf:2: key 'hook.doen' is unknown; did you mean 'hook.done'?");
  auto required = parsed("other = 1\nsite.latitude_dge = 2\n");
  required.number("site.latitude_deg");
  EXPECT_ERROR(required.check_all_used(),
               "a.conf:2: key 'site.latitude_dge' is unknown; did you mean 'site.latitude_deg'?");
  auto there = parsed("a.kind = x\na.kinds = y\n");
  there.text("a.kind");
  EXPECT_ERROR(there.check_all_used(), "a.conf:2: key 'a.kinds' is unknown");
}

TEST(KeyValue, DefectsOfTheTextItself) {
  const std::string key = "expected letters, digits, '_' and '-', parts joined by '.'";
  const std::pair<std::string, std::string> cases[] = {
      {"a = 1\n\na = 2\n", ":3: key 'a' again: it is already in line 1"},
      {"a = 1\nnonsense\n", ":2: 'nonsense': expected key = value"},
      {"= 1\n", ":1: key '': " + key},
      {"a b = 1\n", ":1: key 'a b': " + key},
      {"a..b = 1\n", ":1: key 'a..b': " + key},
      {"a. = 1\n", ":1: key 'a.': " + key},
      {std::string("a = \0\n", 6), ":1: a control character: expected a text file"},
      {"", ": empty file: expected key = value lines"},
      {"# only this\n", ": empty file: expected key = value lines"}};
  for (const auto& [text, message] : cases) EXPECT_ERROR(KeyValueFile::parse(text, "a.conf"), "a.conf" + message);
}

TEST(KeyValue, AcceptsByteOrderMarkAndMissingLastLineEnd) {
  auto file = parsed(
      "\xEF\xBB\xBF"
      "a = 1\nb = 2");
  EXPECT_EQ(file.number("a") + file.number("b"), 3.0);
  ASSERT_OK(file.check_all_used());
}

TEST(KeyValue, LongAndStrangeValuesAreShownShort) {
  auto file = parsed("k = " + std::string(500, 'z') + "\n");
  file.number("k");
  EXPECT_ERROR(file.status(), "a.conf:1: key 'k' = '" + std::string(60, 'z') + "...': expected a number");
}

TEST(KeyValue, FilesThatCannotBeRead) {
  TemporaryFolder folder;
  const std::string missing = folder / "no.conf";
  EXPECT_ERROR(KeyValueFile::read(missing), missing + ": cannot open: No such file or directory");
  auto named = parsed("a = 1\nf = nofile\n");
  EXPECT_EQ(named.file_named("f"), "");
  EXPECT_ERROR(named.status(),
               "a.conf:2: key 'f' = 'nofile': expected a file: nofile: cannot open: No such file or directory");
  EXPECT_ERROR(KeyValueFile::read(folder.path()), folder.path() + ": not a regular file");
  write_file(folder / "empty.conf", "");
  EXPECT_ERROR(KeyValueFile::read(folder / "empty.conf"),
               (folder / "empty.conf") + ": empty file: expected key = value lines");
  write_file(folder / "good.conf", "a = 1\n");
  auto file = good(KeyValueFile::read(folder / "good.conf"));
  EXPECT_EQ(file->integer("a"), 1);
}

}  // namespace
}  // namespace turncal
