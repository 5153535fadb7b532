// JSON and CSV of one table; the forms' own corner cases.
#include "imu_io/base/data_text.h"

#include <gtest/gtest.h>

#include <limits>

namespace turncal {
namespace {

TEST(DataTable, IsTheSameInBothForms) {
  DataTable table({"id", "unit", "value", "good", "none"});
  table.begin_row();
  table.count(-3);
  table.text("SN,1 \"a\"");
  table.number(0.1);
  table.flag(true);
  table.nothing();
  table.begin_row();
  table.count(4);
  table.text("=cmd()");
  table.number(std::numeric_limits<double>::quiet_NaN());
  table.flag(false);
  table.nothing();
  EXPECT_EQ(table.as("csv"), "id,unit,value,good,none\n-3,\"SN,1 \"\"a\"\"\",0.1,true,\n4,'=cmd(),,false,\n");
  EXPECT_EQ(table.as("json"),
            "[\n{\"id\":-3,\"unit\":\"SN,1 \\\"a\\\"\",\"value\":0.1,\"good\":true,\"none\":null},\n"
            "{\"id\":4,\"unit\":\"=cmd()\",\"value\":null,\"good\":false,\"none\":null}\n]\n");
  EXPECT_EQ(DataTable({"a"}).json(), "[\n]\n");
}

TEST(DataTable, WordsAreWhatTheyRead) {
  DataTable table({"key", "value"});
  for (const char* word : {"1.50", "-2e-05", "007", "1.", "", "true", "clean", "0", "0.5", "nan", "-"}) {
    table.begin_row();
    table.text("k");
    table.word(word);
  }
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

}  // namespace
}  // namespace turncal
