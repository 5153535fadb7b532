#include "orchestrator/line_report/history_page.h"

#include <gtest/gtest.h>

#include <string>

#include "orchestrator/line/parameter_history.h"

namespace turncal {
namespace {

std::size_t count_of(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size())) ++count;
  return count;
}

// Ten units; N01 walks in steps of 0.01 and the last one jumps.
std::vector<StoredCalibration> ten_units(double last_n01) {
  std::vector<StoredCalibration> all;
  for (int i = 0; i < 10; ++i) {
    StoredCalibration c;
    c.id = i + 1;
    c.unit = "SN<" + std::to_string(i) + ">";
    c.time_utc = "2026-01-0" + std::to_string(i) + "T00:00:00Z";
    c.verdict = "pass";
    for (const std::string_view key : parameter_keys) {
      StoredValue value;
      value.key = key;
      value.value = key == "N01" && i == 9 ? last_n01 : 0.01 * (i % 2);
      value.sigma = 0.002;
      if (key == "N01") value.limit = {.min = -0.1, .max = 0.1};
      c.values.push_back(value);
    }
    all.push_back(c);
  }
  return all;
}

TEST(ParameterHistory, HasValuesSigmasAndTheChart) {
  const std::vector<StoredCalibration> all = ten_units(0.01);
  const ParameterHistory history = parameter_history(all, "N01");
  ASSERT_EQ(history.values.size(), 10u);
  EXPECT_DOUBLE_EQ(history.chart.mean, 0.005);
  EXPECT_DOUBLE_EQ(*history.sigmas[3], 0.002);
  EXPECT_EQ(history.of[4]->id, 5);
  EXPECT_NEAR(history.chart.cpk->value, 0.095 / (3.0 * 0.01 / 1.128), 1e-12);
  EXPECT_EQ(free_parameter_keys().size(), 21u);
  EXPECT_TRUE(parameter_history(all, "N99").values.empty());
}

TEST(HistoryPage, ChartsEveryParameterThatIsEstimated) {
  const std::string page = history_page(ten_units(0.01), "results.db");
  EXPECT_EQ(count_of(page, "<td class=\"name\">"), 21u);
  EXPECT_EQ(count_of(page, "<tr class=\"hit\">"), 0u);
  EXPECT_EQ(page.find("outside the control limits</span>"), std::string::npos);
  EXPECT_NE(page.find("SN&lt;3&gt;"), std::string::npos) << "serial numbers are text, not markup";
  if (page.find("This plot is missing") != std::string::npos) GTEST_SKIP() << "needs gnuplot";
  EXPECT_EQ(count_of(page, "<svg"), 6u);
  EXPECT_EQ(count_of(page, " less "), 21u);
}

// Of every page that is made: as wide as a phone, wide tables scroll by themselves, and none is split between two sheets.
TEST(HistoryPage, FitsPhonesAndPaper) {
  const std::string page = history_page({}, "results.db");
  EXPECT_NE(page.find("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"), std::string::npos);
  const std::size_t phone = page.find("@media screen and (max-width:700px)"), paper = page.find("@media print");
  ASSERT_NE(phone, std::string::npos);
  ASSERT_NE(paper, std::string::npos);
  EXPECT_LT(page.find("table { display:block; overflow-x:auto; }", phone), paper);
  EXPECT_NE(page.find("figure, table, tr, .verdict { break-inside:avoid; }", paper), std::string::npos);
}

TEST(HistoryPage, MarksWhatIsOutsideTheControlLimits) {
  const std::string page = history_page(ten_units(0.09), "results.db");
  EXPECT_EQ(count_of(page, "<tr class=\"hit\">"), 1u);
  if (page.find("This plot is missing") != std::string::npos) GTEST_SKIP() << "needs gnuplot";
  EXPECT_EQ(count_of(page, "outside the control limits</span>"), 1u);
}

TEST(HistoryPage, WithoutGnuplotTheTablesStay) {
  const std::string page = history_page(ten_units(0.01), "results.db", {.program = "/nowhere/gnuplot"});
  EXPECT_EQ(count_of(page, "This plot is missing"), 6u);
  EXPECT_EQ(count_of(page, "<td class=\"name\">"), 21u);
  EXPECT_NE(history_page({}, "results.db").find("No calibration is on record."), std::string::npos);
}

}  // namespace
}  // namespace turncal
