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

// ---- in words: the sentence of the verdict, the table for the terminal, the files ----

std::size_t characters(const std::string& utf8) {
  return std::size_t(
      std::ranges::count_if(utf8, [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

TEST(VerdictSentence, AdmitsWhenNothingConfirmsIt) {
  Sample sample = extended_sample();
  sample.diagnosis.holdout_before = sample.diagnosis.holdout_after = {};
  const std::string text = plain(verdict_sentence(sample.diagnosis));
  EXPECT_SAYS(text, "from 2.500 to 1.002");
  EXPECT_SAYS(text, "no held-out data confirm it");
}

TEST(VerdictSentence, NamesTheEffectsThatStandBesideAnUnexplainedResidual) {
  Sample sample = unexplained_sample();
  sample.diagnosis.effect_names = {"accel_delay"};
  sample.diagnosis.extended.effects = {estimated("accel_delay", 0, 0.12, 0.003)};
  const std::string text = plain(verdict_sentence(sample.diagnosis));
  EXPECT_SAYS(text, "beside it one effect beyond the 24 parameters was found and added: accel_delay");
  EXPECT_SAYS_NOT(text, "no effect is named");
}

std::vector<std::string> document_lines(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  std::istringstream text(as_text(diagnosis_document(diagnosis, context), diagnosis_lines));
  std::vector<std::string> lines;
  for (std::string line; std::getline(text, line);) lines.push_back(line);
  return lines;
}

void expect_fits(const std::vector<std::string>& lines) {
  EXPECT_LE(lines.size(), 30u);
  for (const std::string& line : lines) {
    EXPECT_LE(characters(line), 100u) << line;
    EXPECT_EQ(line.find('\n'), std::string::npos) << line;
  }
}

TEST(TerminalTable, StaysWithinThirtyLinesOfAHundredColumns) {
  for (Sample sample : {clean_sample(), extended_sample(), unexplained_sample(), noise_model_sample()})
    expect_fits(document_lines(sample.diagnosis, sample_context(sample)));
  // As much of everything as there can be.
  Sample sample = extended_sample();
  Diagnosis& d = sample.diagnosis;
  for (const EffectEntry& entry : effect_catalogue()) {
    const std::string name(entry.name);
    if (name != "accel_second_order") d.effect_names.push_back(name);
    for (int k = 0; k < int(entry.components.size()); ++k)
      d.extended.effects.push_back(estimated(name.c_str(), k, 1e5, 0.1));
    for (const EffectEntry& other : effect_catalogue()) d.aliases[name].push_back(std::string(other.name));
    d.separate_by[name] = std::string(entry.seen_by);
    d.undetectable.push_back(name);
    d.gated_out.push_back(name);
  }
  d.base.faults.assign(30, {123456789012, 123456789013, 5, "velocity step of -0.049 m/s up", "leg set aside"});
  for (int k = 0; k < 9; ++k)
    d.extended.undetermined.push_back({{{"n12", 0.7}, {"n21", -0.7}, {"gyro_magnetic.xx", 0.1}}});
  const std::vector<std::string> lines = document_lines(d, sample_context(sample));
  expect_fits(lines);
  EXPECT_EQ(lines.size(), 30u);
  EXPECT_EQ(lines.back(), "... more in the report");
}

// ---- its files

TEST(DiagnosisFile, AReasonOfSeveralLinesIsOne) {
  Diagnosis empty;
  empty.reason = "first line\nsecond line";
  EXPECT_SAYS(format_diagnosis(empty), "\nstatement = first line second line\n");
}

TEST(DiagnosisParameters, HoldEffectsStrongestFirstNoiseAndVerdict) {
  Sample sample = extended_sample();
  sample.recording.info.unit_serial = "SN7";
  Diagnosis& d = sample.diagnosis;
  d.extended.effects.insert(d.extended.effects.begin(), estimated("gyro_warm_up", 1, 0.02, 0.01, 240.0));
  d.extended.sigma[5] = 0.0;  // A03 not determined
  const ParameterFile file = diagnosis_parameters(d, sample_context(sample));
  const auto text = good(format_parameter_file(file));
  const auto read = good(parse_parameter_file(*text, "parameters.conf"));
  EXPECT_EQ(read->model, "extended");
  EXPECT_EQ(read->method, "joint");
  EXPECT_EQ(read->recording_hash, "00112233445566778899aabbccddeeff");
  EXPECT_EQ(read->unit_serial, "SN7");
  EXPECT_EQ(read->reference_temperature_c, 25.5);
  const std::vector<EffectValue> expected = {{"accel_second_order", "x", 20.25, 0.75},
                                             {"accel_second_order", "z", -3.5, 1.25},
                                             {"gyro_warm_up", "y", 0.02, 0.01},
                                             {"gyro_warm_up", "tau_s", 240.0, {}}};
  EXPECT_EQ(read->effects, expected);
  EXPECT_EQ(read->sigma[0], 0.002);
  EXPECT_FALSE(read->sigma[5]);   // not determined: no sigma
  EXPECT_FALSE(read->sigma[18]);  // a21
  const auto further = [&](const std::string& key) -> std::string {
    for (const auto& [k, v] : read->further)
      if (k == key) return v;
    return "missing";
  };
  EXPECT_EQ(further("verdict.diagnosis"), "extended");
  EXPECT_EQ(further("noise.source"), "measured");
  EXPECT_NEAR(std::stod(further("noise.angle_random_walk.y_deg_per_rt_h")), 0.002, 1e-12);
  EXPECT_NEAR(std::stod(further("noise.velocity_random_walk.z_ug_per_rt_hz")), 8.0, 1e-9);
}

}  // namespace
}  // namespace turncal
