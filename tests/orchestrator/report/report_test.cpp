// The page of a diagnosis: complete, well-formed, small, and whole without gnuplot.
#include "tests/test.h"

#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/figures/drawing.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/report.h"
#include "tests/orchestrator/report/sample_diagnosis.h"

namespace turncal {
namespace {

const GnuplotOptions no_gnuplot = {.program = "/nonexistent/gnuplot"};

const char* const section_ids[] = {"error",  "time",   "scores",    "parameters", "allan",
                                   "limits", "faults", "selection", "reading"};

void expect_sections_in_order(const std::string& html) {
  std::size_t at = html.find("class=\"verdict");
  ASSERT_NE(at, std::string::npos);
  for (const char* id : section_ids) {
    const std::size_t next = html.find("<h2 id=\"" + std::string(id) + "\">");
    ASSERT_NE(next, std::string::npos) << id;
    EXPECT_LT(at, next) << id;
    at = next;
  }
}

TEST(Report, NamesAliasesLimitsFaultsAndSelection) {
  Sample sample = extended_sample();
  Diagnosis& d = sample.diagnosis;
  d.base.faults = {{1000 + 200 * 12, 1000 + 200 * 12 + 3, 12, "gap of <1> sample", "leg set aside"}};
  d.extended.undetermined = {{{{"n12", 0.7071}, {"n21", -0.7071}}}};
  d.extended.sigma[7] = d.extended.sigma[9] = 0.0;
  d.gated_out = {"gyro_bias_drift"};
  const std::string html = as_page(diagnosis_document(d, sample_context(sample)), no_gnuplot).html;
  for (const char* wanted :
       {"unit SN&lt;7&gt;&amp;&quot;quoted&quot;", "<b>accel_second_order</b> could as well be accel_scale_asymmetry.",
        "Positions or rates that would separate them: accel_scale_asymmetry: dwells at 45 deg", "3400 to 3403",
        "<td class=\"n\">12.000</td>", "gap of &lt;1&gt; sample", "leg set aside", "0.71 n12 − 0.71 n21",
        "not determined", "The probability that something is missing is more than 0.99.",
        "<td>force</td><td class=\"name\">accel_second_order</td><td class=\"n\">0.72</td>",
        "<td class=\"name\">accel_size_effect</td><td class=\"w long\">rotations with velocity carried",
        "gyro_bias_drift: fitted the recording better", "error of the local gravity",
        "20.25</td><td class=\"n\">0.75</td><td>µg/g²</td>", "+12.0"})
    EXPECT_SAYS(html, wanted);
}

TEST(Report, SaysSoWhenThereIsNoGnuplot) {
  Sample sample = extended_sample();
  sample.recording.info.unit_serial = "SN7";
  const TemporaryFolder folder;
  const Result<std::string> problem =
      good(write_diagnosis(folder.path(), diagnosis_files(sample.diagnosis, sample_context(sample)), no_gnuplot));
  EXPECT_EQ(*problem, "no plots: /nonexistent/gnuplot is not installed (Debian package gnuplot-nox)");
  const std::string html = file_text(folder / "report.html");
  expect_sections_in_order(html);
  EXPECT_EQ(count_of(html, "<svg"), 0u);
  EXPECT_EQ(count_of(html, "This plot is missing"), 3u);
  EXPECT_EQ(file_text(folder / "diagnosis.conf"), format_diagnosis(sample.diagnosis));
  ASSERT_OK(read_parameter_file(folder / "parameters.conf"));
  std::vector<std::string> names = folder.names();
  std::ranges::sort(names);
  EXPECT_EQ(names, (std::vector<std::string>{"diagnosis.conf", "parameters.conf", "report.html"}));
}

TEST(Report, LeavesTheFolderAloneWhenTheParametersCannotBeWritten) {
  Sample sample = clean_sample();
  sample.recording.info.unit_serial = "SN7";
  sample.diagnosis.extended.parameters.n(0, 0) = std::numeric_limits<double>::quiet_NaN();
  const TemporaryFolder folder;
  EXPECT_FALSE(write_diagnosis(folder.path(), diagnosis_files(sample.diagnosis, sample_context(sample))).ok());
  EXPECT_TRUE(folder.names().empty());
}

TEST(Report, StaysSmallAndQuickForADayOfData) {
  if (!have_gnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  Sample sample = make_sample(second_order_x, no_error, 1800);  // 24.5 h
  sample.diagnosis.verdict = Verdict::unexplained;
  const auto began = std::chrono::steady_clock::now();
  const HtmlPage report = as_page(diagnosis_document(sample.diagnosis, sample_context(sample)));
  EXPECT_EQ(report.plot_problem, "");
  EXPECT_LT(report.html.size(), 3u << 20);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose own work takes several times as long
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(8));  // 1 s on a quiet machine
#endif
}

}  // namespace
}  // namespace turncal
