// JSON and CSV of one table, numbers as text, and words that were mistyped.
#include "imu_io/base/data_text.h"

#include "imu_io/base/text.h"
#include "tests/test.h"

namespace turncal {
namespace {

TEST(DataTable, IsTheSameInBothForms) {
  DataTable table({"id", "unit", "value", "good", "none"});
  table.row({-3, "SN,1 \"a\"", 0.1, true, {}});
  table.row({4, "=cmd()", std::numeric_limits<double>::quiet_NaN(), false, {}});
  EXPECT_EQ(table.as("csv"), "id,unit,value,good,none\n-3,\"SN,1 \"\"a\"\"\",0.1,true,\n4,'=cmd(),,false,\n");
  EXPECT_EQ(table.as("json"),
            "[\n{\"id\":-3,\"unit\":\"SN,1 \\\"a\\\"\",\"value\":0.1,\"good\":true,\"none\":null},\n"
            "{\"id\":4,\"unit\":\"=cmd()\",\"value\":null,\"good\":false,\"none\":null}\n]\n");
  EXPECT_EQ(DataTable({"a"}).json(), "[\n]\n");
}

TEST(DataTable, WordsAreWhatTheyRead) {
  DataTable table({"key", "value"});
  for (const char* word : {"1.50", "-2e-05", "007", "1.", "", "true", "clean", "0", "0.5", "nan", "-"})
    table.row({"k", DataCell::of_word(word)});
  EXPECT_EQ(table.json_object(),
            "{\n\"k\":1.50,\n\"k\":-2e-05,\n\"k\":\"007\",\n\"k\":\"1.\",\n\"k\":null,\n\"k\":true,\n\"k\":\"clean\",\n"
            "\"k\":0,\n\"k\":0.5,\n\"k\":\"nan\",\n\"k\":\"-\"\n}\n");
}

TEST(QuotedJson, EscapesAndMendsBytes) {
  EXPECT_EQ(quoted_json("a\"b\\c\n<"), "\"a\\\"b\\\\c\\u000a\\u003c\"");
  EXPECT_EQ(quoted_json("M\xc3\xbcller \xe2\x82\xac"), "\"M\xc3\xbcller \xe2\x82\xac\"");
  // A lone byte, one that is cut off, an overlong form, a surrogate.
  EXPECT_EQ(quoted_json("\xfc"
                        "a\xc3"),
            "\"\\ufffda\\ufffd\"");
  EXPECT_EQ(quoted_json("\xc0\xaf"), "\"\\ufffd\\ufffd\"");
  EXPECT_EQ(quoted_json("\xed\xa0\x80"), "\"\\ufffd\\ufffd\\ufffd\"");
}

// ---- which word a mistyped one is taken for, and when none is ----

TEST(ClosestWord, DistanceCountsEveryKindOfSlip) {
  for (const auto& [typed, meant, slips] : {std::tuple("run", "run", 0U),
                                            {"", "run", 3U},
                                            {"rn", "run", 1U},
                                            {"rrun", "run", 1U},
                                            {"RUM", "run", 1U},
                                            {"rnu", "run", 1U},
                                            {"kitten", "sitting", 3U},
                                            {"ca", "abc", 3U}})  // no stretch is edited twice
    EXPECT_EQ(edit_distance(typed, meant), slips) << typed << " " << meant;
}

TEST(ClosestWord, OnlyACloseWordIsMeant) {
  const std::vector<std::string> known = {"calibrate", "certificate", "run", "resume"};
  EXPECT_EQ(did_you_mean("rnu", known), "; did you mean 'run'?");
  EXPECT_EQ(did_you_mean("calbirate", known), "; did you mean 'calibrate'?");
  EXPECT_EQ(did_you_mean("certifciat", known), "; did you mean 'certificate'?");
  EXPECT_EQ(did_you_mean("prun", {"run", "prune"}), "; did you mean 'prune'?") << "the first letter is seldom wrong";
  EXPECT_EQ(did_you_mean("clsed", {"joint", "closed-form"}), "; did you mean 'closed-form'?");
  EXPECT_EQ(one_of("resum", known), "calibrate, certificate, run or resume; did you mean 'resume'?");
  EXPECT_EQ(did_you_mean("run", {"run"}), "") << "it was typed right";
  EXPECT_EQ(did_you_mean("walk", known), "");
  EXPECT_EQ(did_you_mean("xy", known), "");
  EXPECT_EQ(did_you_mean("", known), "");
  EXPECT_EQ(did_you_mean(std::string(100000, 'r'), known), "");
}

TEST(ShellPath, ComesBackFromAShell) {
  EXPECT_EQ(shell_path("a/b-1_2.conf"), "a/b-1_2.conf");
  for (const std::string path :
       {"my run's $HOME/`x`", "a\\b \"c\"", "*", "-x", "~", "#1", "a;b&c|d>e(f)!{g,h}", "Gerät 7"}) {
    const std::unique_ptr<FILE, int (*)(FILE*)> shell(::popen(("printf %s " + shell_path(path)).c_str(), "r"),
                                                      ::pclose);
    std::string said(100, '\0');
    said.resize(std::fread(said.data(), 1, said.size(), shell.get()));
    EXPECT_EQ(said, path.starts_with('-') ? "./" + path : path);
  }
}

// ---- numbers as text ----

TEST(FormatNumber, WritesWhatPeopleWrite) {
  for (const auto& [value, text] : {std::pair(0.005, "0.005"),
                                    {0.0005, "0.0005"},
                                    {9.7914, "9.7914"},
                                    {-90.0, "-90"},
                                    {100000.0, "100000"},
                                    {0.1 + 0.2, "0.30000000000000004"},
                                    {1.5e-7, "1.5e-07"},
                                    {0.0, "0"},
                                    {-0.0, "-0"}})
    EXPECT_EQ(format_number(value), text);
  EXPECT_EQ(format_number(std::int64_t{-12}), "-12");
  EXPECT_EQ(format_number(29.573F), "29.573");
}

template <class T, class Bits>
void comes_back(T value) {
  NumberBuffer buffer;
  const auto back = parse_number<T>(format_number(value, buffer));
  ASSERT_TRUE(back.has_value());
  ASSERT_EQ(std::bit_cast<Bits>(*back), std::bit_cast<Bits>(value));
}
TEST(FormatNumber, EveryBitPatternComesBack) {
  using Limits = std::numeric_limits<double>;
  for (const double x : {Limits::denorm_min(), -Limits::denorm_min(), Limits::min(), Limits::max(), Limits::lowest(),
                         Limits::epsilon(), -0.0, 1e-4, 9.999999999999999e-5, 1e15, 999999999999999.9})
    comes_back<double, std::uint64_t>(x);
  std::mt19937_64 random(1);
  for (int i = 0; i < 200000; ++i) {
    const auto bits = random();
    if (const auto x = std::bit_cast<double>(bits); std::isfinite(x)) comes_back<double, std::uint64_t>(x);
    if (const auto x = std::bit_cast<float>(std::uint32_t(bits)); std::isfinite(x)) comes_back<float, std::uint32_t>(x);
  }
}

TEST(ParseNumber, WholeTokenAndFinite) {
  EXPECT_EQ(parse_number("1e3"), 1000.0);
  EXPECT_EQ(parse_number("-.5"), -0.5);
  for (const char* text :
       {"", " 1", "1 ", "+1", "1,0", "1.0x", "0x10", "nan", "inf", "-inf", "infinity", "1e999", "e5", "-"})
    EXPECT_FALSE(parse_number(text).has_value()) << text;
}

TEST(ParseInteger, WholeTokenAndRange) {
  EXPECT_EQ(parse_integer("-7"), -7);
  EXPECT_EQ(parse_integer<int>("2147483647"), 2147483647);
  for (const char* text : {"", "1.0", " 1", "1 ", "+1", "9223372036854775808", "1e3"})
    EXPECT_FALSE(parse_integer(text).has_value()) << text;
  EXPECT_FALSE(parse_integer<int>("2147483648").has_value());
  EXPECT_FALSE(parse_integer<unsigned>("-1").has_value());
}

}  // namespace
}  // namespace turncal
