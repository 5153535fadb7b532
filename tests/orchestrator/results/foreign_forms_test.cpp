// Each form of another program, read back and applied as that program does: the same calibrated sample.
#include "orchestrator/jobs/navigation/foreign_forms.h"

#include "tests/test.h"

#include <regex>

#include <Eigen/LU>

#include "calib/model/parameters.h"
#include "imu_io/recordings/csv_map_import.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

ParameterFile made(IncrementKind kind, bool diagonal) {
  ParameterFile file;
  file.unit_serial = "F1";
  file.sample_period_s = 0.005;
  file.gyro_increment = file.accel_increment = kind;
  file.accel_pulse_mps = kind == IncrementKind::pulses ? 0.0005 : 0.0;
  Parameters p;
  p.n = Matrix3d::Identity() +
        (diagonal ? Matrix3d(Vector3d(0.01, -0.02, 0.03).asDiagonal())
                  : (Matrix3d() << 0.01, 0.002, -0.003, 0.004, -0.02, 0.005, -0.006, 0.007, 0.03).finished());
  p.a =
      Matrix3d::Identity() + (diagonal ? Matrix3d(Vector3d(-0.01, 0.02, 0.005).asDiagonal())
                                       : (Matrix3d() << -0.01, 0.003, 0.002, 0, 0.02, -0.004, 0, 0, 0.005).finished());
  if (kind == IncrementKind::pulses) p.n *= 0.932920;
  p.N0_degph = {100.0, -200.0, 300.0};
  p.A0_g = {0.001, -0.002, 0.003};
  file.parameters = to_vector(p);
  for (const char axis : {'x', 'y', 'z'}) {
    file.add_further(std::string("noise.angle_random_walk.") + axis + "_deg_per_rt_h", 0.1 * (axis - 'w'));
    file.add_further(std::string("noise.velocity_random_walk.") + axis + "_ug_per_rt_hz", 50.0 * (axis - 'w'));
  }
  file.add_further("noise.gyro_bias_instability_degph", 0.5);
  file.add_further("noise.accel_bias_instability_ug", 20.0);
  return file;
}

const Vector3d raw_w{0.3, -0.7, 1.1}, raw_f{3.0, 9.0, -4.0};  // counts times their nominal weight over the period

// The numbers behind `key` and its colon or equals sign.
Eigen::MatrixXd read(const std::string& text, const std::string& key, Eigen::Index rows, Eigen::Index columns) {
  const auto begins_a_line = [&](std::size_t at) {
    const std::size_t before = at == 0 ? std::string::npos : text.find_last_not_of(" #", at - 1);
    return before == std::string::npos || text[before] == '\n' || text[before] == '\t';
  };
  std::size_t at = text.find(key);
  while (at != std::string::npos && !begins_a_line(at)) at = text.find(key, at + 1);
  EXPECT_NE(at, std::string::npos) << key;
  const std::string rest = text.substr(std::min(text.find_first_of(":=\t", at + key.size() - 1), text.size() - 1));
  Eigen::MatrixXd M(rows, columns);
  const std::regex number("[-+]?[0-9]+\\.?[0-9]*(e[-+]?[0-9]+)?");
  std::sregex_iterator next(rest.begin(), rest.end(), number);
  for (Eigen::Index k = 0; k < rows * columns; ++k, ++next) M(k / columns, k % columns) = std::stod(next->str());
  return M;
}
Vector3d triple(const std::string& text, const std::string& key) { return read(text, key, 3, 1); }

// From body axes to those of the program's own files, as the shipped map reads them.
Matrix3d axes_of_map(const std::string& name) {
  const CsvMap map = expect_value(read_csv_map(TURNCAL_SOURCE_DIR "/docs/maps/" + name + ".map"));
  EXPECT_EQ(map.gyro.axes, map.accel.axes);
  Matrix3d P = Matrix3d::Zero();
  for (std::size_t k = 0; k < 3; ++k) P(map.gyro.axes.from[k], Eigen::Index(k)) = map.gyro.axes.sign[k];
  return P;
}

// What a program corrects in the axes of its own files, imported with the shipped map, is what turncal corrects in the body's.
TEST(ForeignForms, EachGivesTheSameSample) {
  const Matrix3d rfu = axes_of_map("psins_imu"), frd = axes_of_map("kf_gins");
  for (const IncrementKind kind : {IncrementKind::physical, IncrementKind::pulses})
    for (const bool diagonal : {false, true}) {
      const ParameterFile file = made(kind, diagonal);
      const ForeignCalibration of = *foreign_calibration(file, "p.conf");
      const Parameters p = from_vector(file.parameters);
      const double nominal = kind == IncrementKind::pulses ? 0.932920 : 1.0;
      const Vector3d w = p.n / nominal * raw_w - p.N0_degph * radps_per_degph,
                     f = p.a * raw_f - p.A0_g * standard_gravity_mps2;
      const auto same = [&](const Vector3d& a, const Vector3d& b, const char* what) {
        EXPECT_LT((a - b).norm(), 1e-12) << what << ": " << a.transpose() << " / " << b.transpose();
      };
      const auto text_of = [&](const char* form) { return *write_foreign_form(file, "p.conf", form); };
      for (const char* form : {"kalibr", "open_vins"}) {
        const std::string text = text_of(form);
        const bool k = std::string(form) == "kalibr";
        const Matrix3d C_i_b = read(text, "C_i_b:", 3, 3),
                       Ma = read(text.substr(k ? text.find("accelerometers:") : 0), k ? "M:" : "Ta:", 3, 3),
                       Mg = read(text.substr(k ? text.find("gyroscopes:") : 0), k ? "M:" : "Tw:", 3, 3),
                       C = read(text, k ? "C_gyro_i:" : "R_IMUtoGYRO:", 3, 3);
        EXPECT_EQ(Ma(0, 1) + Ma(0, 2) + Ma(1, 2) + Mg(0, 1) + Mg(0, 2) + Mg(1, 2), 0.0);
        EXPECT_NEAR(C.determinant(), 1.0, 1e-12);
        same(C_i_b.transpose() * (C.transpose() * Mg.inverse() * (raw_w - triple(text, "bias of the raw gyros"))), w,
             form);
        same(C_i_b.transpose() * (Ma.inverse() * (raw_f - triple(text, "bias of the raw accelerometers"))), f, form);
        EXPECT_NEAR(read(text, "gyroscope_noise_density", 1, 1)(0), of.noise.angle_random_walk.norm() / std::sqrt(3.0),
                    1e-15);
      }
      const std::string psins = text_of("psins");
      same(rfu.transpose() * (read(psins, "Kg", 3, 3) * (rfu * raw_w) - triple(psins, "eb ") * radps_per_degph), w,
           "psins");
      same(rfu.transpose() * (read(psins, "Ka ", 3, 3) * (rfu * raw_f) - triple(psins, "db ") * mpsprs_per_ugprHz), f,
           "psins");
      const std::string ros = text_of("ros");
      EXPECT_NEAR(read(ros, "angular_velocity_covariance", 3, 3)(1, 1),
                  of.noise.angle_random_walk[1] * of.noise.angle_random_walk[1] / 0.005, 1e-18);
      if (!diagonal) continue;  // what follows holds no misalignment
      const std::string gins = text_of("kf_gins");
      const auto by_axis = [&](const Vector3d& raw, const char* bias, double unit, const char* scale) {
        return Vector3d(
            frd.transpose() *
            (frd * raw - unit * triple(gins, bias)).cwiseQuotient(Vector3d::Ones() + 1e-6 * triple(gins, scale)));
      };
      same(by_axis(raw_w, "initgyrbias", radps_per_degph, "initgyrscale"), w, "kf_gins");
      same(by_axis(raw_f, "initaccbias", 1e-5, "initaccscale"), f, "kf_gins");
      same(triple(gins, "arw"), Vector3d(0.1, 0.3, 0.2), "arw");
      const std::string px4 = text_of("px4");
      const auto parameter = [&](const std::string& name) {
        Vector3d v;
        for (Eigen::Index k = 0; k < 3; ++k) {
          std::string key = "CAL_" + name;
          key.insert(key.find('_', 4) + 1, 1, "XYZ"[k]);
          v[k] = read(px4, key, 1, 1)(0);
        }
        return v;
      };
      same(frd.transpose() * (frd * raw_f - parameter("ACC0_OFF")).cwiseProduct(parameter("ACC0_SCALE")), f, "px4");
      const Vector3d without_bias = frd.transpose() * (frd * raw_w - parameter("GYRO0_OFF"));
      same(p.n / nominal * without_bias, w, "px4 gyros, their scale factors beside it");
    }
}

// What the gyros read of the force, in Kalibr's frame of the gyros and in OpenVINS' of the unit: the raw reading of both is the unit's.
TEST(ForeignForms, HoldGSensitivity) {
  ParameterFile file = made(IncrementKind::physical, false);
  Matrix3d G;
  for (int k = 0; k < 9; ++k) {
    G(k / 3, k % 3) = 300.0 - 70.0 * k;
    file.effects.push_back({"gyro_g_sensitivity", std::string{"xyz"[k / 3], "xyz"[k % 3]}, G(k / 3, k % 3), 1.0});
  }
  const Parameters p = from_vector(file.parameters);
  const Vector3d w(0.4, -0.2, 0.9), f(2.0, 9.0, -3.0);
  const Vector3d raw = p.n.inverse() * (w + (p.N0_degph + G * f / standard_gravity_mps2) * radps_per_degph);
  for (const bool kalibr : {true, false}) {
    const std::string text = *write_foreign_form(file, "p.conf", kalibr ? "kalibr" : "open_vins");
    EXPECT_SAYS(text, "not held: biases (estimated by ");
    EXPECT_EQ(text.find("gyro_g_sensitivity"), std::string::npos);
    const Matrix3d C_i_b = read(text, "C_i_b:", 3, 3), C = read(text, kalibr ? "C_gyro_i:" : "R_IMUtoGYRO:", 3, 3),
                   M = read(text.substr(kalibr ? text.find("gyroscopes:") : 0), kalibr ? "M:" : "Tw:", 3, 3),
                   A = read(text, kalibr ? "A:" : "Tg:", 3, 3);
    const Vector3d w_i = C_i_b * w, f_i = C_i_b * f, bias = triple(text, "bias of the raw gyros");
    const Vector3d reads = M * C * w_i + A * (kalibr ? Vector3d(C * f_i) : f_i) + bias;
    EXPECT_LT((reads - raw).norm(), 1e-12) << text;
  }
}

// A bias instability of 0 is none that was seen.
TEST(ForeignForms, NothingSeenIsNotZero) {
  ParameterFile file = made(IncrementKind::physical, true);
  file.further.pop_back();
  file.further.pop_back();
  const std::string gins = *write_foreign_form(file, "p.conf", "kf_gins");
  for (const char* key : {"gbstd", "abstd"}) EXPECT_SAYS(gins, std::string("  # ") + key + ": not seen");
}

// Samples of a unit of the file, counted or not, and calibrated, scatter about the truth by the covariances of the message. Sampling error: 1 %.
TEST(ForeignForms, RosCovariancesAreTheScatterOfSamples) {
  for (const IncrementKind kind : {IncrementKind::physical, IncrementKind::pulses}) {
    ParameterFile file = made(kind, true);
    if (kind == IncrementKind::pulses) file.add_further("noise.gyro_pulse_arcsec", 0.932920);
    const ForeignCalibration of = *foreign_calibration(file, "p.conf");
    const std::string ros = *write_foreign_form(file, "p.conf", "ros");
    EXPECT_EQ(read(ros, "orientation_covariance", 1, 1)(0), -1.0);  // REP 145: there is no orientation
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    constexpr int samples = 20000;
    const double dt = file.sample_period_s;
    for (const bool gyro : {true, false}) {
      const Matrix3d covariance =
          read(ros, gyro ? "angular_velocity_covariance" : "linear_acceleration_covariance", 3, 3);
      const Matrix3d S = gyro ? of.gyro : of.accel;
      const Vector3d bias = gyro ? of.gyro_bias_radps : of.accel_bias_mps2,
                     density = gyro ? of.noise.angle_random_walk : of.noise.velocity_random_walk;
      const double pulse = gyro ? of.noise.gyro_pulse_rad : of.noise.accel_pulse_mps;
      Vector3d squares = Vector3d::Zero(), angle = squares, counted = squares;
      for (int k = 0; k < samples; ++k) {
        const Vector3d truth = Vector3d::NullaryExpr([&] { return 0.3 * normal(random); });
        const Vector3d noise =
            Vector3d::NullaryExpr([&] { return normal(random); }).cwiseProduct(density) / std::sqrt(dt);
        angle += S.inverse() * (truth + noise + bias) * dt;
        const Vector3d now = pulse > 0.0 ? Vector3d((angle / pulse).array().floor() * pulse) : angle;
        squares += (S * (now - counted) / dt - bias - truth).cwiseAbs2();
        counted = now;
      }
      EXPECT_EQ(Matrix3d(covariance.diagonal().asDiagonal()), covariance);
      for (Eigen::Index axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(squares[axis] / samples / covariance(axis, axis), 1.0, 0.1) << gyro << axis;
    }
  }
}

// As the two autopilots take temperature off: the readings of a unit at other temperatures are those of the file there, beside its scale factors.
TEST(ForeignForms, AutopilotsFollowTheTemperature) {
  ParameterFile file = made(IncrementKind::pulses, true);
  TemperaturePolynomials& t = file.temperature.emplace();
  t.reference_c = 20.0, t.low_c = -30.0, t.high_c = 70.0;
  for (Eigen::Index k = 0; k < 6; ++k)
    t.coefficient.row(k) << 0.02 * file.parameters[k], -3e-4 * file.parameters[k], 2e-6 * file.parameters[k];
  const std::string px4 = *write_foreign_form(file, "p.conf", "px4"),
                    pilot = *write_foreign_form(file, "p.conf", "ardupilot");
  const auto value = [](const std::string& text, const std::string& name) {
    const std::size_t at = text.find(name);
    EXPECT_NE(at, std::string::npos) << name;
    return std::stod(text.substr(at + name.size() + 1));
  };
  for (const double temperature : {-30.0, -7.0, 20.0, 44.0, 70.0, 90.0}) {
    ParameterFile there = file;
    there.parameters = t.at(file.parameters, temperature);
    const ForeignCalibration of = *foreign_calibration(there, "p.conf");
    const Matrix3d frd = (Matrix3d() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished();
    const Vector3d gyro = frd * of.gyro.inverse().diagonal().cwiseProduct(of.gyro_bias_radps),
                   accel = frd * of.accel.inverse().diagonal().cwiseProduct(of.accel_bias_mps2);
    const double at = std::clamp(temperature, t.low_c, t.high_c), x = at - value(px4, "TC_A0_TREF");
    const auto cubic = [](double c1, double c2, double c3, double d) { return ((c3 * d + c2) * d + c1) * d; };
    for (int k = 0; k < 3; ++k)
      for (const bool is_gyro : {true, false}) {
        const std::string n = std::to_string(k), tc = std::string("TC_") + (is_gyro ? "G0_X" : "A0_X"),
                          axis(1, "XYZ"[k]);
        const double off = value(px4, std::string("CAL_") + (is_gyro ? "GYRO0_" : "ACC0_") + axis + "OFF") +
                           value(px4, tc + "0_" + n) +
                           cubic(value(px4, tc + "1_" + n), value(px4, tc + "2_" + n), value(px4, tc + "3_" + n), x);
        const double expected = is_gyro ? gyro[k] : accel[k];
        EXPECT_NEAR(off, expected, 1e-9 * std::abs(expected)) << "px4 " << temperature << axis;
        const std::string tcal = std::string("INS_TCAL1_") + (is_gyro ? "GYR" : "ACC");
        const auto poly = [&](double c) {
          return 1e-6 * cubic(value(pilot, tcal + "1_" + axis), value(pilot, tcal + "2_" + axis),
                              value(pilot, tcal + "3_" + axis), c - 35.0);
        };
        const double taken = value(pilot, std::string("INS_") + (is_gyro ? "GYROFFS_" : "ACCOFFS_") + axis) +
                             poly(std::clamp(temperature, value(pilot, "TCAL1_TMIN"), value(pilot, "TCAL1_TMAX"))) -
                             poly(value(pilot, is_gyro ? "GYR1_CALTEMP" : "ACC1_CALTEMP"));
        EXPECT_NEAR(taken, expected, 1e-9 * std::abs(expected)) << "ardupilot " << temperature << axis;
      }
  }
  EXPECT_SAYS(px4, "not held: accelerometer scale factors at other temperatures");
  EXPECT_SAYS(*write_foreign_form(file, "p.conf", "psins"), "not held: noise, temperature (all is at 20 C)");
}

TEST(ForeignForms, SayWhatTheyDoNotHold) {
  ParameterFile file = made(IncrementKind::physical, false);
  file.effects = {{"accel_second_order", "x", 20.0, 1.0}, {"gyro_lock_in", "x", 0.1, 0.1}};
  EXPECT_NE(
      write_foreign_form(file, "p.conf", "kf_gins")->find("not held: misalignment (n_ij, a_ij), accel_second_order"),
      std::string::npos);
  const std::string psins = *write_foreign_form(file, "p.conf", "psins");
  EXPECT_NE(psins.find("not held: noise, gyro_lock_in"), std::string::npos);
  EXPECT_EQ(triple(psins, "Ka2"), Vector3d(0.0, 20.0, 0.0));  // x is the front, the second axis of PSINS
  file.further.clear();
  EXPECT_ERROR(write_foreign_form(file, "p.conf", "ros"),
               "p.conf: has no noise. keys: expected a calibration that measured the noise, for ros");
}

}  // namespace
}  // namespace turncal
