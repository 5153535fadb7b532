// `turncal navigate --reference`: a unit that goes along a parallel and climbs, beside where it truly was.

#include <Eigen/Geometry>

#include "calib/navigation/mechanisation.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

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

TEST_F(NavigateReference, RefusesOneThatCannotBe) {
  record_drive();
  expect_refused(beside("nothing.csv"), "nothing.csv");
  const std::string head = "time_s,latitude_deg,longitude_deg\n";
  for (const auto& [text, words] : std::vector<std::pair<std::string, const char*>>{
           {head + "0,29.53,10\n", "bad.csv: 1 rows: expected two and more"},
           {head + "0,29.53,10\n5,29.53,10\n4,29.53,10\n",
            "bad.csv:4: time_s = '4': expected more than in the row before"},
           {head + "0,29.53,10\n5,89,10\n", "bad.csv:3: latitude_deg = '89': expected -85 to 85"},
           {"time_s,latitude_deg\n0,29.53\n5,29.53\n", "'longitude_deg'"},
           {"time_s,latitude_deg,longitude_deg,velocity_east_mps\n0,29.53,10,1\n5,29.53,10,1\n",
            "expected both or neither"},
           {head + "0,40,10\n2000,40,10\n", "begins at latitude 40 deg: expected the recording's, 29.53 deg"},
           {head + "0,29.53,10\n200,29.53,10\n", "200 s to navigate, expected more than 300 s"},
           {head + "0,29.53,10\n2000,29.53,10.5\n", "the reference is nowhere at rest for 300 s"}}) {
    write("bad.csv", text);
    expect_refused(beside("bad.csv"), words);
  }
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
