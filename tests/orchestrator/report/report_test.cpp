// What is made of a diagnosis: diagnosis.conf, parameters.conf, the words, the terminal table, the figures and the HTML page.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <regex>
#include <set>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/drawing.h"
#include "orchestrator/figures/report_dwells.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/figures/residual_figures.h"
#include "orchestrator/figures/score_chart.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/report.h"
#include "orchestrator/report/report_tables.h"
#include "tests/imu_io/temporary_folder.h"
#include "tests/orchestrator/report/sample_diagnosis.h"

namespace turncal {
namespace {

using test::TemporaryFolder;
using testing::UnitTest;

std::size_t count_of(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size())) ++count;
  return count;
}

std::size_t characters(const std::string& utf8) {
  return static_cast<std::size_t>(
      std::count_if(utf8.begin(), utf8.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

bool have_gnuplot() { return run_gnuplot("set terminal svg\nplot x\n", 1).ok(); }

// --- diagnosis.conf

TEST(DiagnosisFile, HoldsTheContractForAnAddedEffect) {
  Sample sample = extended_sample();
  sample.diagnosis.candidates.resize(4);  // the three of accel_second_order and one of accel_scale_asymmetry
  EXPECT_EQ(format_diagnosis(sample.diagnosis),
            "# turncal diagnosis: which effect the 24 parameters lack, and the error before and after it was added\n"
            "# reason: held-out error 3.2 before, 1.01 after\n"
            "verdict = extended\n"
            "quality.trusted = false\n"
            "effects = accel_second_order\n"
            "effect.accel_second_order.x = 20.25\n"
            "sigma.effect.accel_second_order.x = 0.75\n"
            "effect.accel_second_order.z = -3.5\n"
            "sigma.effect.accel_second_order.z = 1.25\n"
            "alias.accel_second_order = accel_scale_asymmetry\n"
            "undetectable = accel_size_effect\n"
            "detectable.accel_second_order.x = 2.5\n"
            "detectable.accel_second_order.y = 3\n"
            "detectable.accel_second_order.z = 3.5\n"
            "detectable.accel_scale_asymmetry.x = 2.5\n"
            "error.before = 2.5\n"
            "error.after = 1.002\n"
            "holdout.before = 3.2\n"
            "holdout.after = 1.01\n"
            "holdout.velocity_rms_before_mps = 0.0071\n"
            "holdout.velocity_rms_after_mps = 0.0014\n"
            "holdout.source = second recording\n");
}

NavigationWorth sample_worth() {
  return {"second recording", 8, 3600.0, 0.75, 0.25, 0.5, {{"accel_second_order", 0.625}}};
}

TEST(DiagnosisFile, SaysWhatTheEffectsAreWorth) {
  const std::string text = format_diagnosis(extended_sample().diagnosis, sample_worth());
  EXPECT_TRUE(
      text.ends_with("\nholdout.source = second recording\n"
                     "navigation.source = second recording\n"
                     "navigation.free_s = 3600\n"
                     "navigation.before_nm_per_h = 0.75\n"
                     "navigation.after_nm_per_h = 0.25\n"
                     "navigation.noise_nm_per_h = 0.5\n"
                     "navigation.accel_second_order_nm_per_h = 0.625\n"))
      << text;
}

TEST(DiagnosisFile, KeepsEveryKeyWhenThereIsNothingToSay) {
  Diagnosis empty;
  empty.reason = "first line\nsecond line";  // must not become a line of its own
  empty.error_before = empty.error_after = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(format_diagnosis(empty),
            "# turncal diagnosis: which effect the 24 parameters lack, and the error before and after it was added\n"
            "# reason: first line second line\n"
            "verdict = unexplained\n"
            "quality.trusted = false\n"
            "effects =\n"
            "undetectable =\n"
            "error.before =\n"
            "error.after =\n"
            "holdout.before =\n"
            "holdout.after =\n"
            "holdout.velocity_rms_before_mps =\n"
            "holdout.velocity_rms_after_mps =\n"
            "holdout.source =\n");
}

TEST(DiagnosisFile, IsReadBackKeyByKey) {
  Sample sample = clean_sample();
  sample.diagnosis.error_before = 1.0 / 3.0;  // shortest round trip
  auto file = KeyValueFile::parse(format_diagnosis(sample.diagnosis), "diagnosis.conf");
  ASSERT_OK(file);
  EXPECT_EQ(file->text("verdict"), "clean");
  EXPECT_TRUE(file->list("effects").empty());
  EXPECT_EQ(file->number("error.before"), 1.0 / 3.0);
  EXPECT_EQ(file->list("undetectable"), std::vector<std::string>{"accel_size_effect"});
  EXPECT_FALSE(file->has("detectable.accel_size_effect.x_rx"));
  EXPECT_EQ(file->number("detectable.gyro_accel_flexure.zz"), 5.0 * (0.5 + 0.1 * 8));
  const char* verdicts[] = {"clean", "extended", "unexplained", "noise_model"};
  for (int k = 0; k < 4; ++k) {
    sample.diagnosis.verdict = static_cast<Verdict>(k);
    EXPECT_NE(format_diagnosis(sample.diagnosis).find(std::string("\nverdict = ") + verdicts[k] + "\n"),
              std::string::npos);
  }
}

// --- parameters.conf

TEST(DiagnosisParameters, HoldEffectsStrongestFirstNoiseAndVerdict) {
  Sample sample = extended_sample();
  sample.recording.info.unit_serial = "SN7";
  Diagnosis& d = sample.diagnosis;
  d.extended.effects.insert(d.extended.effects.begin(), estimated("gyro_warm_up", 1, 0.02, 0.01, 240.0));
  d.extended.sigma[5] = 0.0;  // A03 not determined
  const ParameterFile file = diagnosis_parameters(d, sample_context(sample));
  const auto text = format_parameter_file(file);
  ASSERT_OK(text);
  const auto read = parse_parameter_file(*text, "parameters.conf");
  ASSERT_OK(read);
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

TEST(DiagnosisParameters, AreThoseOfTheBaseModelWhenNothingWasAdded) {
  Sample sample = clean_sample();
  const ParameterFile file = diagnosis_parameters(sample.diagnosis, sample_context(sample));
  EXPECT_EQ(file.model, "base");
  EXPECT_TRUE(file.effects.empty());
  sample.recording.mean_temperature_c = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(diagnosis_parameters(sample.diagnosis, sample_context(sample)).reference_temperature_c);
}

// --- words

TEST(VerdictSentence, SaysWhatWasFoundWithNumbers) {
  const Sample clean = clean_sample();
  EXPECT_EQ(verdict_sentence(clean.diagnosis, sample_context(clean), Alphabet::plain),
            "Clean: the 24 parameters explain the data to the noise; the strongest of 146 candidates, "
            "gyro_g_squared.z_yz, "
            "scores 3.9 sigma where 4.1 are needed; on held-out data (second recording) the velocity error is 1.50 "
            "mm/s rms and "
            "the normalised residual 0.998.");
  const Sample extended = extended_sample();
  EXPECT_EQ(
      verdict_sentence(extended.diagnosis, sample_context(extended), Alphabet::plain),
      "Extended: one effect beyond the 24 parameters was found and added: accel_second_order, second-order "
      "nonlinearity K2 "
      "(IEEE 1293), x 20.25 +- 0.75 ug/g^2 (27 sigma), z -3.5 +- 1.2 ug/g^2 (2.8 sigma); with it the velocity error on "
      "held-out data (second recording) falls from 7.10 to 1.40 mm/s rms (-80 %), and the normalised residual there "
      "from "
      "3.200 to 1.010; this recording cannot tell accel_second_order from accel_scale_asymmetry.");
  EXPECT_NE(
      verdict_sentence(extended.diagnosis, sample_context(extended), Alphabet::typographic).find("20.25 ± 0.75 µg/g²"),
      std::string::npos);
  const Sample unexplained = unexplained_sample();
  const std::string text = verdict_sentence(unexplained.diagnosis, sample_context(unexplained), Alphabet::plain);
  EXPECT_TRUE(
      text.starts_with("Unexplained: a residual is left that is not noise and that no effect of the catalogue explains "
                       "(rms normalised residual 1.300 where noise explains 1"))
      << text;
  EXPECT_TRUE(text.ends_with(
      "it looks like: bias step of gyro x at about 2973 s (likelihood gain 66.5 where 18.4 is needed); no "
      "effect is named; the sigmas are widened by that."))
      << text;
  const Sample noise = noise_model_sample();
  EXPECT_TRUE(
      verdict_sentence(noise.diagnosis, sample_context(noise), Alphabet::plain)
          .starts_with(
              "Noise model: the assumed noise does not fit the data (innovations 3.10 times the expected variance, "
              "correlation from second to second 0.30"));
}

TEST(VerdictSentence, AdmitsWhenNothingConfirmsIt) {
  Sample sample = extended_sample();
  sample.diagnosis.holdout_before = sample.diagnosis.holdout_after = {};
  const std::string text = verdict_sentence(sample.diagnosis, sample_context(sample), Alphabet::plain);
  EXPECT_NE(text.find("from 2.500 to 1.002"), std::string::npos) << text;
  EXPECT_NE(text.find("no held-out data to confirm it"), std::string::npos) << text;
}

TEST(VerdictSentence, NamesTheEffectsThatStandBesideAnUnexplainedResidual) {
  Sample sample = unexplained_sample();
  sample.diagnosis.effect_names = {"accel_delay"};
  sample.diagnosis.extended.effects = {estimated("accel_delay", 0, 0.12, 0.003)};
  const std::string text = verdict_sentence(sample.diagnosis, sample_context(sample), Alphabet::plain);
  EXPECT_NE(text.find("beside it one effect beyond the 24 parameters was found and added: accel_delay"),
            std::string::npos)
      << text;
  EXPECT_EQ(text.find("no effect is named"), std::string::npos) << text;
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
    expect_fits(terminal_table(sample.diagnosis, sample_context(sample)));
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
  const std::vector<std::string> lines = terminal_table(d, sample_context(sample));
  expect_fits(lines);
  EXPECT_EQ(lines.size(), 30u);
  EXPECT_EQ(lines.back(), "... more in the report");
}

TEST(TerminalTable, ShowsErrorsEffectsScoresAndLimits) {
  const Sample sample = extended_sample();
  std::string all;  // runs of blanks as one
  for (const std::string& line : terminal_table(sample.diagnosis, sample_context(sample)))
    all += std::regex_replace(line, std::regex(" +"), " ") + "\n";
  for (const char* wanted :
       {"verdict Extended: one effect", "\n held-out data: velocity rms, first 20 s of dwells, mm/s 7.10 1.40 -80 %\n",
        "\n held-out data: energy beyond noise, % of the noise's 924 2.01 -100 %\n",
        "\n accel_second_order.x 20.25 0.75 ug/g^2 27.0\n", "\nscores accel_second_order 27",
        "\nmoved most A01 +12.0 sigma\n", "measured: ARW 0.00200 deg/sqrt(h), VRW 8.00 ug/sqrt(Hz)",
        "\nnot told apart accel_second_order | accel_scale_asymmetry; separated by", "\nnot visible accel_size_effect"})
    EXPECT_NE(all.find(wanted), std::string::npos) << wanted << "\nin\n" << all;
}

TEST(TerminalTable, ShowsWhatTheEffectsAreWorth) {
  const Sample sample = extended_sample();
  DiagnosisContext context = sample_context(sample);
  context.worth = sample_worth();
  const std::vector<std::string> lines = terminal_table(sample.diagnosis, context);
  expect_fits(lines);
  std::string all;
  for (const std::string& line : lines) all += std::regex_replace(line, std::regex(" +"), " ") + "\n";
  EXPECT_NE(all.find(": free navigation, rms of 8 starts, nm/h 0.750 0.250 -67 %\n"), std::string::npos) << all;
  EXPECT_NE(all.find("\nworth accel_second_order 0.62 nm/h"), std::string::npos) << all;
  // In the table of the page a column more, filled in the effect's first row.
  const std::string html = html_added_effects(sample.diagnosis, context);
  EXPECT_EQ(count_of(html, "0.62"), 1u) << html;
  EXPECT_EQ(count_of(html, "nm/h</th>"), 1u) << html;
  EXPECT_EQ(count_of(html_added_effects(sample.diagnosis, sample_context(sample)), "nm/h"), 0u);
}

// --- figures

TEST(DwellResiduals, FindTheErrorsOfTheSensorsInTheirOwnAxes) {
  const Sample sample = make_sample(second_order_x, gyro_of_force);
  const std::vector<DwellResidual> dwells = dwell_residuals(sample.diagnosis, sample.recording);
  ASSERT_EQ(dwells.size(), 7u);  // the first rest has no rotation before it
  for (std::size_t k = 0; k < dwells.size(); ++k) {
    const DwellResidual& d = dwells[k];
    const double pitch = std::remainder(90.0 * static_cast<double>(k + 1), 360.0);
    EXPECT_NEAR(d.table_deg[0], -90.0, 1e-9);
    EXPECT_NEAR(std::remainder(d.table_deg[1] - pitch, 360.0), 0.0, 1e-9);
    EXPECT_NEAR(d.turned_rad.z(), 90.0 * rad_per_deg, 1e-9);  // 9 s at 10 deg/s
    EXPECT_NEAR(d.fastest_radps.z(), 10.0 * rad_per_deg, 1e-9);
    EXPECT_NEAR(d.turned_rad.x(), 0.0, 1e-12);
    const SampleError accel = second_order_x(d.f_b_g);
    EXPECT_LT((d.before.accel_mps2 - accel.accel_mps2).norm(), 1e-9) << k;
    EXPECT_LT(d.before.gyro_radps.norm(), 1e-12) << k;
    // After: a gyro error, seen by horizontal axes only.
    const SampleError gyro = gyro_of_force(d.f_b_g);
    for (int axis = 0; axis < 3; ++axis) {
      const bool horizontal = d.level_share[axis] > 0.5;
      EXPECT_EQ(horizontal, std::abs(d.f_b_g[axis]) < 0.5);
      if (horizontal) {
        EXPECT_NEAR(d.after.gyro_radps[axis], gyro.gyro_radps[axis], 1e-12) << k << " axis " << axis;
      }
    }
  }
}

TEST(DwellResiduals, SeeTheTiltThatARotationLeft) {
  // 5 arcsec about body z, which is horizontal: v' = -f x psi.
  Sample sample = make_sample(no_error, no_error);
  const Eigen::Vector3d tilt_b(0.0, 0.0, 5.0 * rad_per_arcsec);
  for (ResidualPoint& p : sample.diagnosis.residuals) {
    const Segment& s = sample.recording.segments[static_cast<std::size_t>(p.segment)];
    const Eigen::Matrix3d C_nb = attitude_from_angles(s.heading_deg * rad_per_deg, s.pitch_deg * rad_per_deg, 0.0);
    const double t =
        p.time_s - std::floor((p.time_s) / (sample_rest_s + sample_turn_s)) * (sample_rest_s + sample_turn_s);
    p.velocity_before_mps = -Eigen::Vector3d(0.0, sample_gravity_mps2, 0.0).cross(C_nb * tilt_b) * t;
  }
  for (const DwellResidual& d : dwell_residuals(sample.diagnosis, sample.recording))
    EXPECT_NEAR(d.before.tilt_rad.z(), tilt_b.z(), 1e-12);
}

TEST(VelocityRms, CountsTheFirstSecondsOfEveryDwell) {
  Sample sample = clean_sample();
  std::vector<ResidualPoint>& points = sample.diagnosis.residuals;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const bool early = i % sample_rest_s < velocity_seconds;
    points[i].velocity_before_mps = Eigen::Vector3d(early ? 3.0 : 100.0, early ? 4.0 : 100.0, 0.0);
  }
  EXPECT_NEAR(velocity_rms_mps(sample.diagnosis, false), 5.0, 1e-12);
  EXPECT_EQ(velocity_rms_mps(sample.diagnosis, true), 0.0);
  EXPECT_TRUE(std::isnan(velocity_rms_mps(Diagnosis{}, false)));
}

TEST(EffectFigure, ShowsEveryEffectOfTheCatalogueAgainstWhatItDependsOn) {
  const std::pair<const char*, const char*> expected[] = {{"accel_second_order", "specific force along x, g"},
                                                          {"accel_cross_coupling", "fx fy, g²"},
                                                          {"accel_delay", "turned before the dwell, °"},
                                                          {"accel_bias_temperature", "temperature, °C"},
                                                          {"accel_bias_drift", "time, min"},
                                                          {"gyro_g_sensitivity", "specific force along x, g"},
                                                          {"gyro_rate_nonlinearity", "rate about z, °/s"},
                                                          {"gyro_magnetic", "heading, °"},
                                                          {"post_rotation_relaxation", "time since rotation, s"}};
  for (const EffectEntry& entry : effect_catalogue()) {
    Sample sample = extended_sample();
    const std::string name(entry.name);
    sample.diagnosis.effect_names = {name};
    sample.diagnosis.extended.effects.clear();
    for (int k = 0; k < static_cast<int>(entry.components.size()); ++k)
      sample.diagnosis.extended.effects.push_back(estimated(name.c_str(), k, 10.0 - k, 1.0));
    const Figure figure = effect_figure(sample.diagnosis, dwell_residuals(sample.diagnosis, sample.recording), name, 0);
    ASSERT_FALSE(figure.panels.empty()) << name;
    EXPECT_LE(figure.panels.size(), 3u) << name;
    for (const Panel& panel : figure.panels) {
      EXPECT_NE(panel.x_label.find(", "), std::string::npos) << name << ": no unit in '" << panel.x_label << "'";
      EXPECT_NE(panel.y_label.find(", "), std::string::npos) << name << ": no unit in '" << panel.y_label << "'";
      ASSERT_EQ(panel.series.size(), 2u) << name;
      EXPECT_FALSE(panel.series[0].points.empty()) << name;
      EXPECT_EQ(panel.series[0].points.size(), panel.series[1].points.size()) << name;
    }
    for (const auto& [effect, label] : expected)
      if (name == effect) {
        EXPECT_EQ(figure.panels.front().x_label, label) << name;
      }
  }
}

TEST(EffectFigure, PlotsTheErrorOfTheSensorAgainstItsSpecificForce) {
  const Sample sample = extended_sample();
  const Figure figure =
      effect_figure(sample.diagnosis, dwell_residuals(sample.diagnosis, sample.recording), "accel_second_order", 0);
  const Panel& panel = figure.panels.front();
  EXPECT_EQ(panel.title, "component x");
  EXPECT_EQ(panel.y_label, "accelerometer x, µg");
  for (const auto& [x, y] : panel.series[0].points) EXPECT_NEAR(y, 20.0 * x * x, 1e-3);  // K2 f^2
  for (const auto& [x, y] : panel.series[1].points) EXPECT_NEAR(y, 0.0, 1e-9);           // gone
}

TEST(UnexplainedFigures, ShowAnglesForceRateTemperatureAndTime) {
  const Sample sample = unexplained_sample();
  const std::vector<Figure> figures = unexplained_figures(dwell_residuals(sample.diagnosis, sample.recording));
  ASSERT_EQ(figures.size(), 2u);
  for (const Figure& figure : figures) {
    std::string labels;
    for (const Panel& panel : figure.panels) labels += panel.x_label + "|";
    EXPECT_EQ(labels,
              "heading, °|pitch, °|roll, °|specific force along x, g|specific force along y, g|specific force along z, "
              "g|rate about "
              "the axis before, °/s|temperature, °C|time, min|");
    for (const Panel& panel : figure.panels) EXPECT_EQ(panel.series.size(), 3u);
  }
}

TEST(TimeFigure, KeepsFaultsFromFlatteningTheRest) {
  Sample sample = clean_sample();
  for (std::size_t i = 0; i < sample.diagnosis.residuals.size(); ++i) {
    ResidualPoint& p = sample.diagnosis.residuals[i];
    p.velocity_before_mps = p.velocity_after_mps = Eigen::Vector3d::Constant(1e-3 * std::sin(static_cast<double>(i)));
  }
  EXPECT_EQ(time_figure(sample.diagnosis).panels[0].y_limit, 0.0);
  for (std::size_t i = 100; i < 105; ++i) sample.diagnosis.residuals[i].velocity_before_mps.x() = 0.5;
  const Figure figure = time_figure(sample.diagnosis);
  EXPECT_GT(figure.panels[0].y_limit, 0.9);  // mm/s
  EXPECT_LT(figure.panels[0].y_limit, 5.0);
  EXPECT_EQ(figure.panels[1].y_limit, 0.0);
  EXPECT_NE(figure.caption.find("leave the frame"), std::string::npos);
}

TEST(Outline, KeepsExtremesAndBreaksWithinTheLimit) {
  std::vector<std::pair<double, double>> points;
  for (int i = 0; i < 100000; ++i) points.emplace_back(i, std::sin(i * 1e-3));
  points[54321].second = 7.0;
  points[12345].second = -7.0;
  points[77777].second = std::numeric_limits<double>::quiet_NaN();
  const auto thin = outline(points, 3000);
  EXPECT_LE(thin.size(), 3000u);
  EXPECT_GT(thin.size(), 1500u);
  EXPECT_EQ(std::count(thin.begin(), thin.end(), std::pair(54321.0, 7.0)), 1);
  EXPECT_EQ(std::count(thin.begin(), thin.end(), std::pair(12345.0, -7.0)), 1);
  EXPECT_EQ(std::count_if(thin.begin(), thin.end(), [](const auto& p) { return std::isnan(p.second); }), 1);
  EXPECT_TRUE(std::is_sorted(thin.begin(), thin.end(), [](const auto& a, const auto& b) { return a.first < b.first; }));
  EXPECT_EQ(outline(points, 200000).size(), points.size());
}

TEST(ScoreBars, AreSortedAndCoverTheWholeCatalogue) {
  const Sample sample = extended_sample();
  const double threshold = family_threshold_z(sample.diagnosis, 0.005);
  EXPECT_NEAR(threshold, 4.125, 0.01);  // 0.5 % over 135 visible components, two-sided
  const std::vector<ScoreBar> bars = score_bars(sample.diagnosis, threshold);
  ASSERT_EQ(bars.size(), effect_catalogue().size());
  EXPECT_EQ(bars.front().name, "accel_second_order");
  EXPECT_EQ(bars.front().role, ScoreBar::Role::added);
  EXPECT_EQ(bars.front().remark, "27.0  (x)");
  EXPECT_EQ(bars.back().name, "accel_size_effect");
  EXPECT_EQ(bars.back().role, ScoreBar::Role::invisible);
  EXPECT_EQ(bars.back().remark, "cannot be seen in this recording");
  for (std::size_t k = 2; k < bars.size(); ++k) EXPECT_GE(bars[k - 1].z, bars[k].z);
}

// --- gnuplot

TEST(Gnuplot, FailsInOneLine) {
  const auto missing = run_gnuplot("plot x\n", 1, {"/nonexistent/gnuplot", 5.0});
  EXPECT_ERROR(missing, "no plots: /nonexistent/gnuplot is not installed (Debian package gnuplot-nox)");
  // A program that neither reads nor draws must not take us down with it.
  const auto silent = run_gnuplot(std::string(1 << 20, '\n'), 1, {"/bin/true", 5.0});
  EXPECT_ERROR(silent, "no plots: /bin/true drew 0 of 1 plots");
  const auto failing = run_gnuplot("plot x\n", 1, {"/bin/false", 5.0});
  ASSERT_FALSE(failing.ok());
  EXPECT_TRUE(failing.error().message.starts_with("no plots: /bin/false stopped with an error"))
      << failing.error().message;
}

TEST(Gnuplot, IsKilledAtTheDeadline) {
  const auto began = std::chrono::steady_clock::now();
  const auto result = run_gnuplot("10\n", 1, {"/bin/cat", 0.2});  // fails at once: cat takes no such option
  EXPECT_FALSE(result.ok());
  if (have_gnuplot()) {
    const auto stuck = run_gnuplot("set terminal svg\npause 30\nplot x\n", 1, {"gnuplot", 0.3});
    EXPECT_ERROR(stuck, "no plots: gnuplot took longer than 0.300 s");
  }
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(10));
}

TEST(Gnuplot, SaysWhatIsWrongWithAScript) {
  if (!have_gnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  const auto wrong = run_gnuplot("set terminal svg\nplot nonsense(\n", 1);
  ASSERT_FALSE(wrong.ok());
  EXPECT_EQ(count_of(wrong.error().message, "\n"), 0u);
  const auto two = run_gnuplot("set terminal svg\nplot x\nreset session\nset terminal svg\nplot x*x\n", 2);
  ASSERT_OK(two);
  EXPECT_TRUE((*two)[0].starts_with("<svg"));
  EXPECT_TRUE((*two)[1].ends_with("</svg>"));
}

TEST(EmbeddableSvg, HasIdsAndLabelOfItsOwn) {
  const std::string svg =
      "<svg \n viewBox=\"0 0 8 8\"><title>t</title><g id=\"gnuplot_canvas\"><circle id='gpDot'/><use "
      "xlink:href='#gpDot'/>"
      "<text font-family=\"Sans\" font-size=\"13\">a</text></g></svg>";
  EXPECT_EQ(embeddable_svg(svg, "time", "a < b", "50%"),
            "<svg role=\"img\" aria-label=\"a &lt; b\" style=\"width:50%\" \n viewBox=\"0 0 8 8\"><g><circle "
            "id='timegpDot'/><use "
            "xlink:href='#timegpDot'/><text font-size=\"13\">a</text></g></svg>");
}

// --- the page

const char* const section_ids[] = {"error",  "time",   "scores",    "parameters", "allan",
                                   "limits", "faults", "selection", "reading",    "components"};

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
  static const std::set<std::string> single = {"meta", "br", "img", "!DOCTYPE"};
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
    const Report report = make_report(sample.diagnosis, sample_context(sample));
    const std::string& html = report.html;
    SCOPED_TRACE(to_string(sample.diagnosis.verdict));
    expect_sections_in_order(html);
    expect_balanced(html);
    EXPECT_NE(html.find("<div class=\"verdict " + std::string(to_string(sample.diagnosis.verdict)) + "\">"),
              std::string::npos);
    EXPECT_NE(html.find("unit SN&lt;7&gt;&amp;&quot;quoted&quot;"), std::string::npos);
    EXPECT_EQ(html.find("SN<7>"), std::string::npos);
    // Self-contained: no scripts, nothing fetched. Namespaces are names, not links.
    EXPECT_EQ(html.find("<script"), std::string::npos);
    EXPECT_EQ(html.find("<link"), std::string::npos);
    EXPECT_EQ(html.find("url(http"), std::string::npos);
    EXPECT_EQ(count_of(html, "http://") + count_of(html, "https://"), 2 * count_of(html, "<svg"));
    EXPECT_EQ(html.find(">nan"), std::string::npos);
    EXPECT_EQ(html.find(">inf"), std::string::npos);
    EXPECT_LT(html.size(), 3u << 20);
    // All 24 parameters.
    for (const std::string_view key : parameter_keys)
      EXPECT_NE(html.find("<td class=\"name\">" + std::string(key) + "</td>"), std::string::npos) << key;
    const bool named = sample.diagnosis.verdict == Verdict::extended;
    const bool nameless =
        sample.diagnosis.verdict == Verdict::unexplained || sample.diagnosis.verdict == Verdict::noise_model;
    EXPECT_EQ(html.find("<h2 id=\"effects\">") != std::string::npos, named);
    EXPECT_EQ(html.find("<h2 id=\"residual\">") != std::string::npos, nameless);
    if (!plots) continue;
    EXPECT_EQ(report.plot_problem, "");
    EXPECT_EQ(count_of(html, "<svg"), named ? 4u : nameless ? 5u : 3u);
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
  auto context = sample_context(sample);
  context.gnuplot.program = "/nonexistent/gnuplot";
  const std::string html = make_report(d, context).html;
  for (const char* wanted : {"<b>accel_second_order</b> could as well be accel_scale_asymmetry.",
                             "Positions or rates that would separate them: accel_scale_asymmetry: dwells at 45 deg",
                             "3400 to 3403", "<td class=\"n\">12.000</td>", "gap of &lt;1&gt; sample", "leg set aside",
                             "0.71 n12 − 0.71 n21", "not determined", "accel_scale_asymmetry 725",
                             "<td class=\"name\">accel_size_effect</td><td class=\"w\">rotations with velocity carried",
                             "gyro_bias_drift: fitted the recording better", "error of the local gravity",
                             "20.25</td><td class=\"n\">0.75</td><td>µg/g²</td>", "+12.0"})
    EXPECT_NE(html.find(wanted), std::string::npos) << wanted;
}

TEST(Report, SaysSoWhenThereIsNoGnuplot) {
  Sample sample = extended_sample();
  sample.recording.info.unit_serial = "SN7";
  auto context = sample_context(sample);
  context.gnuplot.program = "/nonexistent/gnuplot";
  const TemporaryFolder folder;
  const DiagnosisFiles files = diagnosis_files(sample.diagnosis, context);
  ASSERT_OK(write_diagnosis(folder.path(), files));
  EXPECT_EQ(files.report.plot_problem, "no plots: /nonexistent/gnuplot is not installed (Debian package gnuplot-nox)");
  const std::string html = test::read_file(folder / "report.html");
  expect_sections_in_order(html);
  expect_balanced(html);
  EXPECT_EQ(count_of(html, "<svg"), 0u);
  EXPECT_EQ(count_of(html, "This plot is missing"), 4u);
  EXPECT_EQ(test::read_file(folder / "diagnosis.conf"), format_diagnosis(sample.diagnosis));
  ASSERT_OK(read_parameter_file(folder / "parameters.conf"));
  std::vector<std::string> names = folder.names();
  std::sort(names.begin(), names.end());
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
  const Report report = make_report(sample.diagnosis, sample_context(sample));
  EXPECT_EQ(report.plot_problem, "");
  EXPECT_LT(report.html.size(), 3u << 20);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(8));  // 1 s on a quiet machine
}

// --- numbers

TEST(Format, Numbers) {
  EXPECT_EQ(significant(28.345, 3), "28.3");
  EXPECT_EQ(significant(0.00123456, 3), "0.00123");
  EXPECT_EQ(significant(9.996, 3), "10.0");
  EXPECT_EQ(significant(-1.234e-7, 3), "-1.23e-07");
  EXPECT_EQ(significant(-1.234e-7, 3, Alphabet::typographic), "-1.23×10⁻⁷");
  EXPECT_EQ(significant(6654.3, 3), "6654");
  EXPECT_EQ(significant(0.0), "0");
  EXPECT_EQ(significant(std::numeric_limits<double>::infinity()), "-");
  EXPECT_EQ(value_with_sigma(28.3456, 0.91), "28.35");
  EXPECT_EQ(value_with_sigma(0.932920123, 3.6e-7), "0.93292012");
  EXPECT_EQ(value_with_sigma(-0.0001, 0.91), "0.00");
  EXPECT_EQ(value_with_sigma(12345.6, 310.0), "12346");
  EXPECT_EQ(value_with_sigma(2.0, 0.0), "2.00000");
  EXPECT_EQ(quantity(28.3456, 0.91, "ug/g^2", Alphabet::typographic), "28.35 ± 0.91 µg/g²");
  EXPECT_EQ(percent_change(4.0, 1.0), "-75 %");
  EXPECT_EQ(percent_change(4.0, 4.1), "+2.5 %");
  EXPECT_EQ(percent_change(4.0, 4.0), "0 %");
  EXPECT_EQ(percent_change(0.0, 4.0), "-");
  EXPECT_EQ(signed_number(-0.01, 1), "+0.0");
  EXPECT_EQ(clock_time(6342.0), "1:45:42");
}

TEST(Format, Texts) {
  EXPECT_EQ(html_escape("a<b>&\"c'\n\x7f é \xff \xc3"), "a&lt;b&gt;&amp;&quot;c&#39;   é ? ?");
  EXPECT_EQ(unit_text("deg/h/C", Alphabet::typographic), "°/h/°C");
  EXPECT_EQ(unit_text("ug/g^3", Alphabet::typographic), "µg/g³");
  EXPECT_EQ(unit_text("deg/h/G", Alphabet::typographic), "°/h/G");
  EXPECT_EQ(unit_text("arcsec/g", Alphabet::typographic), "″/g");
  EXPECT_EQ(unit_text("ug/g^3", Alphabet::plain), "ug/g^3");
  EXPECT_EQ(wrap("one two three", 7), (std::vector<std::string>{"one two", "three"}));
  EXPECT_EQ(shorten("0123456789", 6), "012...");
}

}  // namespace
}  // namespace turncal
