// A diagnosis in words: the sentence of the verdict and the table for the terminal.
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "orchestrator/report/report.h"
#include "tests/orchestrator/report/sample_diagnosis.h"
#include "tests/outcome.h"

namespace turncal {
namespace {

std::size_t characters(const std::string& utf8) {
  return static_cast<std::size_t>(
      std::count_if(utf8.begin(), utf8.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

TEST(VerdictSentence, SaysWhatWasFoundWithNumbers) {
  const Sample clean = clean_sample();
  EXPECT_EQ(
      plain(verdict_sentence(clean.diagnosis)),
      "Clean: the 24 parameters explain the data to the noise; the probability that something is missing is 0.04; "
      "the strongest of 146 candidates, gyro_g_squared.z_yz, scores 3.9 sigma; on held-out data (second "
      "recording) the velocity error is 1.50 "
      "mm/s rms and "
      "the normalised residual 0.998.");
  const Sample extended = extended_sample();
  EXPECT_EQ(
      plain(verdict_sentence(extended.diagnosis)),
      "Extended: one effect beyond the 24 parameters was found and added: accel_second_order, second-order "
      "nonlinearity K2 "
      "(IEEE 1293), x 20.25 +- 0.75 ug/g^2 (27 sigma), z -3.5 +- 1.2 ug/g^2 (2.8 sigma); with it the velocity error on "
      "held-out data (second recording) falls from 7.10 to 1.40 mm/s rms (-80 %), and the normalised residual there "
      "from "
      "3.200 to 1.010; this recording cannot tell accel_second_order from accel_scale_asymmetry.");
  EXPECT_SAYS(verdict_sentence(extended.diagnosis), "20.25 ± 0.75 µg/g²");
  const Sample unexplained = unexplained_sample();
  const std::string text = plain(verdict_sentence(unexplained.diagnosis));
  EXPECT_TRUE(
      text.starts_with("Unexplained: a residual is left that is not noise and that no effect of the catalogue explains "
                       "(rms normalised residual 1.300 where noise explains 1"))
      << text;
  EXPECT_TRUE(
      text.ends_with("it looks like: the bias of gyro x changes with time (0.99): gyro_bias_drift 0.40; no effect is "
                     "named; the sigmas "
                     "hold what it may be."))
      << text;
  const Sample noise = noise_model_sample();
  EXPECT_TRUE(
      plain(verdict_sentence(noise.diagnosis))
          .starts_with(
              "Noise model: the assumed noise does not fit the data (innovations 3.10 times the expected variance, "
              "correlation from second to second 0.30"));
}

TEST(VerdictSentence, AdmitsWhenNothingConfirmsIt) {
  Sample sample = extended_sample();
  sample.diagnosis.holdout_before = sample.diagnosis.holdout_after = {};
  const std::string text = plain(verdict_sentence(sample.diagnosis));
  EXPECT_SAYS(text, "from 2.500 to 1.002");
  EXPECT_SAYS(text, "no held-out data to confirm it");
}

TEST(VerdictSentence, NamesTheEffectsThatStandBesideAnUnexplainedResidual) {
  Sample sample = unexplained_sample();
  sample.diagnosis.effect_names = {"accel_delay"};
  sample.diagnosis.extended.effects = {estimated("accel_delay", 0, 0.12, 0.003)};
  const std::string text = plain(verdict_sentence(sample.diagnosis));
  EXPECT_SAYS(text, "beside it one effect beyond the 24 parameters was found and added: accel_delay");
  EXPECT_SAYS_NOT(text, "no effect is named");
}

std::vector<std::string> lines_of(const Diagnosis& diagnosis, const DiagnosisContext& context) {
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
    expect_fits(lines_of(sample.diagnosis, sample_context(sample)));
  // As much of everything as there can be.
  Sample sample = extended_sample();
  Diagnosis& d = sample.diagnosis;
  for (const EffectEntry& entry : effect_catalogue()) {
    const std::string name(entry.name);
    if (name != "accel_second_order") d.effect_names.push_back(name);
    for (int k = 0; k < static_cast<int>(entry.components.size()); ++k)
      d.extended.effects.push_back(estimated(name.c_str(), k, 1e5, 0.1));
    for (const EffectEntry& other : effect_catalogue()) d.aliases[name].push_back(std::string(other.name));
    d.separate_by[name] = std::string(entry.seen_by);
    d.undetectable.push_back(name);
    d.gated_out.push_back(name);
  }
  d.base.faults.assign(30, {123456789012, 123456789013, 5, "velocity step of -0.049 m/s up", "leg set aside"});
  for (int k = 0; k < 9; ++k)
    d.extended.undetermined.push_back({{{"n12", 0.7}, {"n21", -0.7}, {"gyro_magnetic.xx", 0.1}}});
  const std::vector<std::string> lines = lines_of(d, sample_context(sample));
  expect_fits(lines);
  EXPECT_EQ(lines.size(), 30u);
  EXPECT_EQ(lines.back(), "... more in the report");
}

}  // namespace
}  // namespace turncal
