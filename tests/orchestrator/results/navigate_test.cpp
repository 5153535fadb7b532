// `turncal navigate` as a program: what it writes, and what it refuses.

#include <Eigen/Geometry>
#include "calib/navigation/mechanisation.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

TEST_F(Navigate, TrueParametersStayWhereTheyAreAndWrongOnesDoNot) {
  record_rest_and_truth();
  write_truth("rest", "wrong.conf", 1, 0.1);  // N02, the gyro that points up: 0.1 deg/h
  const ProgramResult navigated =
      ends("navigate rest --parameters true.conf --against wrong.conf --out nav --for 1500s --branches 3", 0);
  EXPECT_EQ(navigated.err, "");
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.integer("branches"), 3);
  EXPECT_EQ(conf.integer("against.branches"), 3);
  EXPECT_NEAR(conf.number("branch.1.heading_deg"), 30.0, 1e-3);
  EXPECT_NEAR(conf.number("branch.1.pitch_deg"), 0.0, 1.3e-4);  // half a gyro pulse
  EXPECT_NEAR(conf.number("branch.1.roll_deg"), 0.0, 1.3e-4);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.05);  // of counting in pulses
  // Until the first turn the alignment hides a constant gyro error up in nothing: the heading drifts by w t, and with it the Earth's
  // rate east by W cos L w t: v_N' = -g W cos L w t^2 / 2, 2 m/s after 1500 s, less by Schuler's feedback.
  EXPECT_GT(conf.number("against.drift.rms_nm_per_h"), 20.0 * conf.number("drift.rms_nm_per_h"));
  EXPECT_EQ(conf.text("expected.from"), "none");
  EXPECT_GT(conf.number("expected.cep_nm_per_h"), 0.0);
  // A row a second and branch, and the start.
  const std::string track = file_text(folder_ / "nav/track.csv");
  EXPECT_EQ(std::ranges::count(track, '\n'), 1 + 3 * 1501);
  EXPECT_EQ(std::count(track.begin(), track.begin() + std::ptrdiff_t(track.find('\n')), ','), 10);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "nav/track_against.csv"));
  const std::string page = file_text(folder_ / "nav/navigation.html");
  for (const char* part : {"<b>Drift:</b> rms ", "<svg", "</i> first start<", "</i> compared with<"})
    EXPECT_SAYS(page, part);
  // What docs/examples has for it reads the same rates.
  if (std::system("python3 -c 'import numpy' 2> /dev/null") == 0) {
    const std::string command = std::string("python3 ") + TURNCAL_SOURCE_DIR + "/docs/examples/read_track.py " +
                                path("nav/track.csv") + " > " + path("nav/read");
    ASSERT_EQ(std::system(command.c_str()), 0);
    const std::string read = file_text(folder_ / "nav/read");
    for (int k = 1; k <= 3; ++k) {
      char rate[40];
      std::snprintf(rate, sizeof rate, ", %.3f NM/h\n", conf.number("branch." + std::to_string(k) + ".nm_per_h"));
      EXPECT_SAYS(read, rate);
    }
  }
  // Again, in the same folder: the same bytes.
  const std::string before = file_text(folder_ / "nav/navigation.conf");
  EXPECT_EQ(run("navigate rest --parameters true.conf --against wrong.conf --out nav --for 1500s --branches 3").code,
            0);
  EXPECT_EQ(file_text(folder_ / "nav/navigation.conf"), before);
  // Without the other file nothing of it is left.
  EXPECT_EQ(run("navigate rest --parameters true.conf --out nav --branches 1").code, 0);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "nav/track_against.csv"));
}

// Nothing is aligned or navigated over more than two lost samples.
TEST_F(Navigate, LostSamplesEndABranch) {
  record_rest_and_truth();
  const auto navigate = [&](const std::string& recording) {
    return run({"navigate", recording, "--parameters", path("true.conf"), "--out", "nav", "--for", "1500s",
                "--branches", "1"});
  };
  const std::int64_t first = segments_of("rest").front().start_sample;
  lose("rest", first + 150000, 1, "one");
  const ProgramResult one = navigate("one");
  ASSERT_EQ(one.code, 0) << one.err;
  EXPECT_SAYS(one.out, "1 sample lost or bad");
  EXPECT_EQ(result("nav/navigation.conf").number("branch.1.free_s"), 1500.0);
  EXPECT_LT(result("nav/navigation.conf").number("drift.rms_nm_per_h"), 0.05);
  // 300 s of alignment and 950 s: more than half of what was asked for.
  lose("rest", first + 250000, 1000, "late");
  const ProgramResult late = navigate("late");
  ASSERT_EQ(late.code, 0) << late.err;
  const std::string said = "1000 samples lost from sample " + std::to_string(first + 250000) + " on";
  EXPECT_SAYS(late.out, "branch from 0 s ends early: " + said);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_NEAR(conf.number("branch.1.free_s"), 950.0, 0.2);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.05);
  EXPECT_EQ(conf.text("lost.1"), "branch from 0 s ends early: " + said);
  // In the alignment: there is no such branch.
  lose("rest", first + 20000, 1000, "early");
  std::filesystem::remove_all(folder_ / "nav");
  expect_refused("navigate early --parameters true.conf --out nav --for 1500s --branches 1",
                 "branch from 0 s left out: 1000 samples lost from sample " + std::to_string(first + 20000) + " on");
}

TEST_F(Navigate, SamplesLostInATurnAreCountedThere) {
  record_rest_and_truth();
  const Segments segments = segments_of("rest");
  const auto turn = std::ranges::find_if(segments, [&](const Segment& s) {
    return s.kind == SegmentKind::rotate && s.start_sample > segments.front().start_sample + 100000;
  });
  ASSERT_NE(turn, segments.end());
  // From the rest before to the rest after it: 100 and 200 samples of them.
  const std::int64_t length = turn->end_sample - turn->start_sample;
  lose("rest", turn->start_sample - 100, length + 300, "turn");
  const ProgramResult navigated = ends("navigate turn --parameters true.conf --out nav --for 600s", 0);
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.integer("filled_samples"), length + 300);
  EXPECT_EQ(conf.integer("filled_in_motion"), length);
  EXPECT_SAYS_NOT(navigated.out, "LATITUDE");
  EXPECT_NEAR(conf.number("felt_latitude_deg"), 29.53, 0.01);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.1);
}

TEST_F(Navigate, AFullDiskLeavesNothing) {
  record_rest_and_truth();
  const Arguments arguments = "navigate rest --parameters true.conf --out nav";
  const long points = count_points(arguments);
  std::filesystem::remove_all(folder_ / "nav");
  const std::set<std::string> before = everything();
  ASSERT_GT(points, 5);
  for (long point = 1; point <= points; ++point) {
    const ProgramResult full = run_struck(arguments, point, "full");
    const bool written = std::filesystem::exists(folder_ / "nav/navigation.conf");
    EXPECT_EQ(full.code == 0, written) << point << full.err;
    if (!written) {
      EXPECT_EQ(full.code, 50) << point;
      EXPECT_EQ(full.err_lines(), 1) << full.err;
      EXPECT_EQ(everything(), before) << point;
    }
    std::filesystem::remove_all(folder_ / "nav");
  }
}

// ---- navigate data: on data that no unit gives, tests/golden/navigated.sh ----

// ---- navigate reference ----

// `turncal navigate --reference`: a unit that goes along a parallel and climbs, beside where it truly was.

using Eigen::Vector3d;

// From 0 to 1 between two times, smoothly; and its rate.
double ramp(double t, double from, double to) {
  const double s = std::clamp((t - from) / (to - from), 0.0, 1.0);
  return s * s * (3.0 - 2.0 * s);
}
double ramp_rate(double t, double from, double to) {
  const double s = std::clamp((t - from) / (to - from), 0.0, 1.0);
  return 6.0 * s * (1.0 - s) / (to - from);
}

// It stands for 400 s, goes east with up to 200 m/s, climbs with 10 m/s for a while. Its axes are north, up and east all the time: the
// gyros read what turns these, w_ie + w_en, the accelerometers v' + (2 w_ie + w_en) x v - g. Crosses the longitude of 180 deg.
class NavigateReference : public RigUnit {
 protected:
  static constexpr double latitude = 29.53 * rad_per_deg, gravity = 9.7914, dt = 0.05, length_s = 2000.0;
  static constexpr double longitude_deg = 179.5;

  void record_drive() {
    const double W = 7.292115e-5, e2 = 2.0 * wgs84_flattening - wgs84_flattening * wgs84_flattening;
    const double radius = wgs84_semi_major_m / std::sqrt(1.0 - e2 * std::sin(latitude) * std::sin(latitude));
    std::string rows = "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n";
    reference_ = "time_s,latitude_deg,longitude_deg,height_m,velocity_north_mps,velocity_east_mps\n";
    double height = 0.0, east_rad = 0.0;
    char row[300];
    for (int k = 0; k < std::lround(length_s / dt); ++k) {
      if (k % 20 == 0) {  // each second
        double longitude = longitude_deg + east_rad / rad_per_deg;
        if (longitude > 180.0) longitude -= 360.0;
        std::snprintf(row, sizeof row, "%.1f,29.53,%.12f,%.6f,0,%.9f\n", k * dt, longitude, height, east(k * dt));
        reference_ += row;
      }
      const double t = (k + 0.5) * dt, up = climb(t);
      height += up * dt;
      const double out = radius + height - 0.5 * up * dt;
      east_rad += east(t) / (out * std::cos(latitude)) * dt;
      const Vector3d earth(W * std::cos(latitude), W * std::sin(latitude), 0.0);
      const Vector3d transport(east(t) / out, east(t) / out * std::tan(latitude), 0.0);
      const double g = gravity + normal_gravity_mps2(latitude, height) - normal_gravity_mps2(latitude, 0.0);
      const Vector3d v(0.0, up, east(t));
      const Vector3d rate(0.0, 10.0 * (ramp_rate(t, 900, 950) - ramp_rate(t, 1300, 1350)),
                          200.0 * ramp_rate(t, 400, 500));
      const Vector3d gyro = dt * (earth + transport);
      const Vector3d accel = dt * (rate + (2.0 * earth + transport).cross(v) + Vector3d(0.0, g, 0.0));
      std::snprintf(row, sizeof row, "%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", k, gyro[0], gyro[1], gyro[2], accel[0],
                    accel[1], accel[2]);
      rows += row;
    }
    std::filesystem::create_directory(folder_ / "drive");
    write("drive/imu.csv", rows);
    write("drive/segments.csv", "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n");
    write("drive/recording.conf",
          "format = 1\nsample_period_s = 0.05\nlatitude_deg = 29.53\ngravity_mps2 = 9.7914\nunit_serial = SN7\n"
          "gyro_increment = rad\naccel_increment = mps\n");
    write("reference.csv", reference_);
    ParameterFile file = file_of("drive");
    file.parameters = to_vector(start_parameters((*RecordingSource::open(path("drive")))->info()));
    keep(file, "true.conf");
  }
  static double east(double t) { return 200.0 * ramp(t, 400, 500); }
  static double climb(double t) { return 10.0 * (ramp(t, 900, 950) - ramp(t, 1300, 1350)); }
  std::vector<std::string> beside(const std::string& reference) const {
    return {"navigate", "drive", "--parameters", path("true.conf"), "--out", "nav", "--reference", path(reference)};
  }
  std::string reference_;
};

TEST_F(NavigateReference, ErrorsAreThoseBesideIt) {
  record_drive();
  const ProgramResult navigated = ends(beside("reference.csv"), 0);
  EXPECT_SAYS_NOT(navigated.out, "expected");
  KeyValueFile conf = result("nav/navigation.conf");
  EXPECT_EQ(conf.text("reference"), path("reference.csv"));
  EXPECT_GE(conf.integer("branches"), 1);
  // The branch that begins first has 300 km behind it; a pulse of nothing is lost: what is left are the steps of the integration.
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 0.01);
  EXPECT_LT(conf.number("velocity_rms_mps"), 0.01);
  // Without it, all of the way is error.
  ASSERT_EQ(run("navigate drive --parameters true.conf --out nav").code, 0);
  EXPECT_GT(result("nav/navigation.conf").number("drift.rms_nm_per_h"), 100.0);
  // Its own track is a reference, too; without velocity and height the climb is not known: v_U x 2 W cos L east.
  std::string plain;
  for (const std::string& line : lines_of(reference_)) {
    std::size_t comma = 0;
    for (int k = 0; k < 3; ++k) comma = line.find(',', comma + 1);
    plain += line.substr(0, comma) + "\n";
  }
  write("plain.csv", plain);
  ASSERT_EQ(run(beside("plain.csv")).code, 0);
  conf = result("nav/navigation.conf");
  EXPECT_GT(conf.number("drift.rms_nm_per_h"), 0.02);
  EXPECT_LT(conf.number("drift.rms_nm_per_h"), 5.0);
}

// ---- a model without one of its effects

TEST(EffectWorth, WithoutAnEffectIsTheFitThatNeverHadIt) {
  // 40 equations for N01, n11 and three components: two of K2, one of the drift.
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd A(40, 5);
  Eigen::VectorXd b(40);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = normal(random);
  for (Eigen::Index i = 0; i < b.size(); ++i) b(i) = normal(random);
  const Eigen::VectorXd all = (A.transpose() * A).ldlt().solve(A.transpose() * b);
  JointResult fit;
  ParameterVector parameters = ParameterVector::Zero();
  const int n11 = 6;
  parameters[0] = all[0];
  parameters[n11] = all[1];
  fit.parameters = from_vector(parameters);
  const EffectEntry *k2 = find_effect("accel_second_order"), *drift = find_effect("gyro_bias_drift");
  fit.effects = {{{k2, 0, 0.0}, all[2], 1.0}, {{drift, 1, 0.0}, all[3], 1.0}, {{k2, 2, 0.0}, all[4], 1.0}};
  fit.free = {0, n11, parameter_count, parameter_count + 1, parameter_count + 2};
  const Eigen::MatrixXd covariance = (A.transpose() * A).inverse();

  const Eigen::MatrixXd left = A(Eigen::all, std::vector<int>{0, 1, 3});
  const Eigen::VectorXd without = (left.transpose() * left).ldlt().solve(left.transpose() * b);
  const ModelWithout model = model_without(fit, covariance, "accel_second_order");
  EXPECT_NEAR(model.parameters[0], without[0], 1e-12);
  EXPECT_NEAR(model.parameters[n11], without[1], 1e-12);
  ASSERT_EQ(model.effects.size(), 3u);
  EXPECT_EQ(model.effects[0], 0.0);
  EXPECT_NEAR(model.effects[1], without[2], 1e-12);
  EXPECT_EQ(model.effects[2], 0.0);
}

}  // namespace
}  // namespace turncal
