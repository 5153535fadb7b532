// The figures of a diagnosis, and gnuplot, which draws them.
#include "orchestrator/figures/diagnosis_figures.h"
#include "calib/evidence/holdout.h"
#include "orchestrator/figures/drawing.h"
#include "tests/orchestrator/report/sample_diagnosis.h"
#include "tests/test.h"

namespace turncal {
namespace {

TEST(DwellResiduals, FindTheErrorsOfTheSensorsInTheirOwnAxes) {
  const Sample sample = make_sample(second_order_x, gyro_of_force);
  const std::vector<DwellResidual> dwells = dwell_residuals(sample.diagnosis, sample.recording);
  ASSERT_EQ(dwells.size(), 7u);  // the first rest has no rotation before it
  for (std::size_t k = 0; k < dwells.size(); ++k) {
    const DwellResidual& d = dwells[k];
    const double pitch = std::remainder(90.0 * double(k + 1), 360.0);
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
    const Segment& s = sample.recording.segments[std::size_t(p.segment)];
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
    for (int k = 0; k < int(entry.components.size()); ++k)
      sample.diagnosis.extended.effects.push_back(estimated(name.c_str(), k, 10.0 - k, 1.0));
    const Figure figure = effect_figure(sample.diagnosis, dwell_residuals(sample.diagnosis, sample.recording), name, 0);
    ASSERT_FALSE(figure.panels.empty()) << name;
    EXPECT_LE(figure.panels.size(), 3u) << name;
    for (const Panel& panel : figure.panels) {
      EXPECT_SAYS(panel.x_label, ", ") << name << ": no unit";
      EXPECT_SAYS(panel.y_label, ", ") << name << ": no unit";
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
              "g|rate about the axis before, °/s|temperature, °C|time, min|");
    for (const Panel& panel : figure.panels) EXPECT_EQ(panel.series.size(), 3u);
  }
}

TEST(TimeFigure, KeepsFaultsFromFlatteningTheRest) {
  Sample sample = clean_sample();
  for (std::size_t i = 0; i < sample.diagnosis.residuals.size(); ++i) {
    ResidualPoint& p = sample.diagnosis.residuals[i];
    p.velocity_before_mps = p.velocity_after_mps = Eigen::Vector3d::Constant(1e-3 * std::sin(double(i)));
  }
  EXPECT_EQ(time_figure(sample.diagnosis).panels[0].y_limit, 0.0);
  for (std::size_t i = 100; i < 105; ++i) sample.diagnosis.residuals[i].velocity_before_mps.x() = 0.5;
  const Figure figure = time_figure(sample.diagnosis);
  EXPECT_GT(figure.panels[0].y_limit, 0.9);  // mm/s
  EXPECT_LT(figure.panels[0].y_limit, 5.0);
  EXPECT_EQ(figure.panels[1].y_limit, 0.0);
  EXPECT_SAYS(figure.caption, "leave the frame");
}

TEST(TimeFigure, ItsAxesSayWhereTheStepsBegin) {
  CompressedRecording recording;
  recording.info.sample_period_s = 0.5;
  recording.blocks.resize(1);
  recording.blocks.front().start_sample = 100;
  for (const auto& [step, start] : {std::pair{1, 100}, std::pair{1, 200}, std::pair{2, 7300}}) {
    Segment segment{.step = step, .start_sample = start};
    recording.segments.push_back(segment);
  }
  using Marks = std::vector<std::pair<double, std::string>>;
  for (const auto& [label, second] : {std::pair{"time, h", 1.0}, std::pair{"time, min", 60.0}}) {
    Figure figure;
    figure.panels.resize(2);
    figure.panels[0].x_label = label;
    figure.panels[1].x_label = "angle, deg";
    mark_steps(recording, figure);
    EXPECT_EQ(figure.panels[0].marks, (Marks{{0.0, "1"}, {second, "2"}})) << label;
    EXPECT_TRUE(figure.panels[1].marks.empty());
    EXPECT_SAYS(figure.caption, "where the steps");
  }
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
  EXPECT_EQ(std::ranges::count(thin, std::pair(54321.0, 7.0)), 1);
  EXPECT_EQ(std::ranges::count(thin, std::pair(12345.0, -7.0)), 1);
  EXPECT_EQ(std::ranges::count_if(thin, [](const auto& p) { return std::isnan(p.second); }), 1);
  EXPECT_TRUE(std::ranges::is_sorted(thin, [](const auto& a, const auto& b) { return a.first < b.first; }));
  EXPECT_EQ(outline(points, 200000).size(), points.size());
}

TEST(Scores, AreOfWhatTheRecordingCanShowTheStrongestFirst) {
  const Sample sample = extended_sample();
  // 0.5 % over 146 visible components, two-sided
  EXPECT_NEAR(family_threshold_z(sample.diagnosis, 0.005), 4.143, 0.002);
  const std::vector<const CandidateScore*> scores = strongest_candidates(sample.diagnosis);
  EXPECT_EQ(scores.front()->column.key(), "accel_second_order.x");
  EXPECT_NEAR(scores.front()->z, 27.0, 0.05);
  for (std::size_t k = 1; k < scores.size(); ++k) {
    EXPECT_GE(std::abs(scores[k - 1]->z), std::abs(scores[k]->z));
    EXPECT_NE(scores[k]->column.entry->name, "accel_size_effect");  // the sample does not show it
  }
}

TEST(Gnuplot, FailsInOneLine) {
  const auto missing = run_gnuplot("plot x\n", 1, {"/nonexistent/gnuplot", 5.0});
  EXPECT_ERROR(missing, "no plots: /nonexistent/gnuplot is not installed (Debian package gnuplot-nox)");
  // A program that neither reads nor draws must not take us down with it.
  const auto silent = run_gnuplot(std::string(1 << 20, '\n'), 1, {"/bin/true", 5.0});
  EXPECT_ERROR(silent, "no plots: /bin/true drew 0 of 1 plots");
  const auto failing = run_gnuplot("plot x\n", 1, {"/bin/false", 5.0});
  EXPECT_TRUE(fails(failing, "no plots: /bin/false stopped with an error"));
}

TEST(Gnuplot, IsKilledAtTheDeadline) {
  const auto began = std::chrono::steady_clock::now();
  if (have_gnuplot()) {
    const auto stuck = run_gnuplot("set terminal svg\npause 30\nplot x\n", 1, {"gnuplot", 0.3});
    EXPECT_ERROR(stuck, "no plots: gnuplot did not end within its time and was killed");
  }
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(10));
}

TEST(Gnuplot, SaysWhatIsWrongWithAScript) {
  if (!have_gnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  const auto wrong = run_gnuplot("set terminal svg\nplot nonsense(\n", 1);
  ASSERT_FALSE(wrong.ok());
  EXPECT_EQ(count_of(wrong.error().message, "\n"), 0u);
  const auto two = good(run_gnuplot("set terminal svg\nplot x\nreset session\nset terminal svg\nplot x*x\n", 2));
  EXPECT_TRUE((*two)[0].starts_with("<svg"));
  EXPECT_TRUE((*two)[1].ends_with("</svg>"));
}

}  // namespace
}  // namespace turncal
