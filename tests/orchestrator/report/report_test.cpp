// The page of a diagnosis: complete, well-formed, small, and whole without gnuplot.
#include "tests/test.h"

#include <regex>

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

// Well-formed enough: every tag that is opened is closed in order.
void expect_balanced(const std::string& html) {
  static const std::set<std::string> single = {"meta", "link", "br", "img", "!DOCTYPE"};
  std::vector<std::string> open;
  for (std::size_t at = html.find('<'); at != std::string::npos; at = html.find('<', at + 1)) {
    const std::size_t end = html.find('>', at);
    ASSERT_NE(end, std::string::npos);
    const bool closing = html[at + 1] == '/';
    const std::size_t name_at = at + (closing ? 2 : 1);
    const std::string name = html.substr(name_at, html.find_first_of(" \n>/", name_at) - name_at);
    if (closing) {
      ASSERT_FALSE(open.empty()) << "</" << name << ">";
      ASSERT_EQ(open.back(), name) << html.substr(at > 80 ? at - 80 : 0, 160);
      open.pop_back();
    } else if (html[end - 1] != '/' && single.count(name) == 0) {
      open.push_back(name);
    }
    at = end;
  }
  EXPECT_TRUE(open.empty());
}

TEST(Report, IsCompleteForEveryVerdict) {
  const bool plots = have_gnuplot();
  for (const Sample& sample : {clean_sample(), extended_sample(), unexplained_sample(), noise_model_sample()}) {
    const HtmlPage report = as_page(diagnosis_document(sample.diagnosis, sample_context(sample)));
    const std::string& html = report.html;
    SCOPED_TRACE(to_string(sample.diagnosis.verdict));
    expect_sections_in_order(html);
    expect_balanced(html);
    EXPECT_SAYS(html, "<div class=\"verdict " + std::string(to_string(sample.diagnosis.verdict)) + "\">");
    EXPECT_SAYS(html, "unit SN&lt;7&gt;&amp;&quot;quoted&quot;");
    EXPECT_SAYS_NOT(html, "SN<7>");
    // Self-contained: no scripts, nothing fetched. Namespaces are names, not links.
    EXPECT_SAYS_NOT(html, "<script");
    EXPECT_EQ(count_of(html, "<link"), count_of(html, "<link rel=\"icon\" href=\"data:,\">")) << "no icon is asked for";
    EXPECT_SAYS_NOT(html, "url(http");
    EXPECT_EQ(count_of(html, "http://") + count_of(html, "https://"), 2 * count_of(html, "<svg"));
    EXPECT_SAYS_NOT(html, ">nan");
    EXPECT_SAYS_NOT(html, ">inf");
    EXPECT_LT(html.size(), 3u << 20);
    // All 24 parameters.
    for (const std::string_view key : parameter_keys)
      EXPECT_SAYS(html, "<td class=\"name\">" + std::string(key) + "</td>") << key;
    const bool named = sample.diagnosis.verdict == Verdict::extended;
    const bool nameless =
        sample.diagnosis.verdict == Verdict::unexplained || sample.diagnosis.verdict == Verdict::noise_model;
    EXPECT_EQ(html.find("<h2 id=\"effects\">") != std::string::npos, named);
    EXPECT_EQ(html.find("<h2 id=\"residual\">") != std::string::npos, nameless);
    if (!plots) continue;
    EXPECT_EQ(report.plot_problem, "");
    EXPECT_EQ(count_of(html, "<svg"), named ? 5u : nameless ? 21u : 3u) << "a drawing a panel";
    std::set<std::string> ids;
    const std::regex id("[ \n]id=['\"]([^'\"]+)['\"]");
    for (std::sregex_iterator i(html.begin(), html.end(), id), end; i != end; ++i)
      EXPECT_TRUE(ids.insert((*i)[1]).second) << "twice: " << (*i)[1];
    const std::regex use("href='#([^']+)'");
    for (std::sregex_iterator i(html.begin(), html.end(), use), end; i != end; ++i)
      EXPECT_EQ(ids.count((*i)[1]), 1u) << (*i)[1];
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
       {"<b>accel_second_order</b> could as well be accel_scale_asymmetry.",
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
  expect_balanced(html);
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
