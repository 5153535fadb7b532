// evaluate() against integration of the motion in steps of 50 us, and differentiate() against central differences
// of evaluate(). The integration and the checker of derivatives share nothing with the code they check.
#include "calib/statistics/block_motion.h"

#include "calib/model/attitude.h"
#include "tests/calib/closed_form_fixture.h"
#include "tests/calib/compress.h"
#include "tests/test.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using VectorFunction = std::function<Vector3d(double)>;

// ---- motion from functions of time

struct Motion {
  Matrix3d C = Matrix3d::Identity();  // body at t to body at the start
  Vector3d v = Vector3d::Zero();      // integral of C f, frame of the start
  Vector3d v_integral = Vector3d::Zero();
};

Matrix3d turn_by(const Vector3d& s) {
  const double angle = s.norm();
  return angle > 0.0 ? Eigen::AngleAxisd(angle, s / angle).toRotationMatrix() : Matrix3d::Identity();
}

// Midpoint rule with exact rotations: error of a step h is (h w)^2 of its increment over 24, below 1e-10 here.
Motion integrate(const VectorFunction& w, const VectorFunction& f, double duration_s) {
  const double h = 5e-5;
  const int steps = int(std::lround(duration_s / h));
  Motion m;
  for (int i = 0; i < steps; ++i) {
    const double t = (i + 0.5) * h;
    const Vector3d half = 0.5 * h * w(t);
    const Vector3d push = h * (m.C * turn_by(half) * f(t));
    m.v_integral += h * (m.v + 0.5 * push);
    m.v += push;
    m.C = m.C * turn_by(2.0 * half);
  }
  return m;
}

// Counts of a unit with real-valued pulses: five-point Gauss-Legendre a sample.
std::vector<ImuSample> counts(const VectorFunction& w, const VectorFunction& f, int samples, const SensorModel& model) {
  constexpr double node[5] = {0.0, 0.5384693101056831, -0.5384693101056831, 0.9061798459386640, -0.9061798459386640};
  constexpr double weight[5] = {0.5688888888888889, 0.4786286704993665, 0.4786286704993665, 0.2369268850561891,
                                0.2369268850561891};
  const Matrix3d gyro_inverse = model.gyro_scale.inverse(), accel_inverse = model.accel_scale.inverse();
  std::vector<ImuSample> out(static_cast<std::size_t>(samples));
  for (int i = 0; i < samples; ++i) {
    Vector3d angle = model.gyro_bias_radps * dt, speed = model.accel_bias_mps2 * dt;
    for (int k = 0; k < 5; ++k) {
      const double t = (i + 0.5 + 0.5 * node[k]) * dt;
      angle += 0.5 * dt * weight[k] * w(t);
      speed += 0.5 * dt * weight[k] * f(t);
    }
    ImuSample& s = out[i];
    s.counter = i;
    Vector3d::Map(s.gyro.data()) = gyro_inverse * angle;
    Vector3d::Map(s.accel.data()) = accel_inverse * speed;
  }
  return out;
}

// One block over all samples.
Block one_block(const std::vector<ImuSample>& samples) {
  CompressionOptions options;
  options.block_samples = int(samples.size());
  options.block_angle_rad = 10.0;
  const CompressedRecording r = compress_as(SegmentKind::rotate, samples, options);
  EXPECT_EQ(r.blocks.size(), 1u);
  return r.blocks.front();
}

double angle_between(const Matrix3d& a, const Matrix3d& b) {
  const Matrix3d d = a.transpose() * b;
  return 0.5 * Vector3d(d(2, 1) - d(1, 2), d(0, 2) - d(2, 0), d(1, 0) - d(0, 1)).norm();
}

struct MotionCase {
  const char* name;
  VectorFunction w, f;
  int samples;
  double angle_tolerance_rad;
  double velocity_tolerance_mps;
  double column_tolerance = 1e-6;
};

// A unit turning about body axis `axis` under gravity, at rate(t) with angle(t) since the start.
VectorFunction gravity_seen_turning(const Vector3d& axis, const std::function<double(double)>& angle) {
  return [=](double t) -> Vector3d { return Eigen::AngleAxisd(-angle(t), axis) * Vector3d(2.0, 9.4, 1.5); };
}

std::vector<MotionCase> cases() {
  const Vector3d skew_axis = Vector3d(0.6, -0.64, 0.48);
  const double rate = 10.0 * rad_per_deg;
  std::vector<MotionCase> list;
  // A static second. What is left: the bias times the first moments, exact; rotation^3.
  list.push_back({"rest", [](double) { return Vector3d(4e-5, 5e-5, 3e-5); },
                  [](double) { return Vector3d(0.3, 9.7, -0.2); }, 200, 1e-12, 1e-12});
  // Even turns of 0.012 and 0.05 rad. Angle: exact. Velocity: of gravity, which does not turn with the unit, the sixth
  // order is left, and what the sample before the first one would have told.
  list.push_back({"even turn", [=](double) -> Vector3d { return rate * skew_axis; },
                  gravity_seen_turning(skew_axis, [=](double t) { return rate * t; }), 14, 1e-12, 4e-9});
  list.push_back({"long even turn", [=](double) -> Vector3d { return rate * skew_axis; },
                  gravity_seen_turning(skew_axis, [=](double t) { return rate * t; }), 57, 1e-12, 1e-8, 2e-6});
  // Getting up to speed, 20 deg/s^2. r x (r x dv)/6 is for even turns: it should be /10 here, r = 1.7 mrad.
  list.push_back({"run-up", [=](double t) -> Vector3d { return 20.0 * rad_per_deg * t * skew_axis; },
                  gravity_seen_turning(skew_axis, [](double t) { return 10.0 * rad_per_deg * t * t; }), 20, 1e-12,
                  3e-7});
  // Coning: the axis goes round at 5 Hz, a = 0.2 mrad. Angle gained about z in 0.2 s: 0.5 a^2 2 pi 5 * 0.2 = 1.3e-7
  // rad. What is left: the sample before the block's first one, which is not known here, and a^2 of the velocity.
  const double a = 2e-4, nu = 2.0 * pi * 5.0;
  list.push_back({"coning",
                  [=](double t) -> Vector3d { return a * nu * Vector3d(-std::sin(nu * t), std::cos(nu * t), 0.0); },
                  [](double) { return Vector3d(0.0, 9.8, 0.0); }, 40, 1e-9, 3e-7, 3e-4});
  // Sculling: rocking about x in step with a push along y makes a steady push along z.
  list.push_back({"sculling", [=](double t) { return Vector3d(a * nu * std::cos(nu * t), 0.0, 0.0); },
                  [=](double t) { return Vector3d(0.0, 9.8 + 2.0 * std::sin(nu * t), 0.0); }, 40, 1e-9, 1e-7});
  return list;
}

TEST(Evaluate, IsTheMotionOfManyFineSteps) {
  const SensorModel model = sensor_model(wrong_unit(), pulses_info());
  for (const MotionCase& c : cases()) {
    const Block block = one_block(counts(c.w, c.f, c.samples, model));
    const BlockMotion motion = evaluate(block, model, dt);
    const Motion truth = integrate(c.w, c.f, c.samples * dt);
    EXPECT_LT(angle_between(rotation_exp(motion.rotation), truth.C), c.angle_tolerance_rad) << c.name;
    EXPECT_LT((motion.velocity - truth.v).norm(), c.velocity_tolerance_mps) << c.name;
    if (std::string(c.name) != "rest") continue;
    // First order in rotation: 8e-5^2 of 4.9 m/s.
    EXPECT_LT((motion.mean_velocity - truth.v_integral).norm(), 5e-8);
  }
}

// Block by block through a turn of 360 deg: long ones where it is steady, short ones where it begins and ends.
TEST(Evaluate, BlocksOfAWholeTurnAddUp) {
  const SensorModel model = sensor_model(wrong_unit(), pulses_info());
  const Vector3d axis = Vector3d(0.999, 0.03, -0.02).normalized();
  const double rate = 10.0 * rad_per_deg, accel = 20.0 * rad_per_deg, total_s = 37.0, up_s = 0.5;
  const auto angle = [=](double t) {
    const double turning = std::min(t, 36.5);  // half a second of rest at the end
    const double up = std::min(turning, up_s), even = std::clamp(turning - up_s, 0.0, 35.5),
                 down = std::max(turning - 36.0, 0.0);
    return 0.5 * accel * up * up + rate * even + rate * down - 0.5 * accel * down * down;
  };
  const auto speed = [=](double t) {
    return t < up_s ? accel * t : t < 36.0 ? rate : t < 36.5 ? rate - accel * (t - 36.0) : 0.0;
  };
  const VectorFunction w = [=](double t) -> Vector3d { return speed(t) * axis; };
  const VectorFunction f = gravity_seen_turning(axis, angle);
  const CompressedRecording r = compress_as(SegmentKind::rotate, counts(w, f, int(std::lround(total_s / dt)), model));
  Matrix3d C = Matrix3d::Identity();
  Vector3d v = Vector3d::Zero();
  for (const Block& block : r.blocks) {
    const BlockMotion motion = evaluate(block, model, dt);
    v += C * motion.velocity;
    C = C * rotation_exp(motion.rotation);
  }
  EXPECT_LT(angle_between(C, Matrix3d::Identity()), 2e-10);  // a whole turn, 6.28 rad
  // Seen from the start gravity does not turn: 9.7 m/s^2 for 37 s. With r^4 / 360 of its share that each block left
  // before it would be 6e-6 m/s off at 0.05 rad, and with those of 0.012 rad 2e-8. What is left comes from both ends.
  EXPECT_LT((v - Vector3d(2.0, 9.4, 1.5) * total_s).norm(), 6e-7);
  EXPECT_LT(r.blocks.size(), 200u);  // 126 of 0.05 rad in the turn, and those of half a second each at both ends
}

// A fast table and a slow unit: 0.02 to 0.2 rad a sample, one block each. With the sample before alone, gravity came dt r^2 / 24 late: 7e-5
// m/s in this second at 0.06 rad, 0.003 at 0.2; with both neighbours and k = 1 (compression.h) 2e-6 and 2e-4.
TEST(Evaluate, FastTurnsAddUp) {
  const SensorModel model = sensor_model(wrong_unit(), pulses_info());
  const Vector3d axis = Vector3d(0.6, -0.64, 0.48);
  for (const auto& [turned_rad, tolerance_mps] :
       {std::pair{0.02, 1e-9}, {0.06, 4e-9}, {0.1, 6e-8}, {0.15, 5e-7}, {0.2, 1.5e-6}}) {
    const double rate = turned_rad / dt;
    const VectorFunction w = [=](double) -> Vector3d { return rate * axis; };
    const VectorFunction f = gravity_seen_turning(axis, [=](double t) { return rate * t; });
    const CompressedRecording r = compress_as(SegmentKind::rotate, counts(w, f, 202, model));
    Matrix3d C = Matrix3d::Identity();
    Vector3d v = Vector3d::Zero();
    double time_s = 0.0;
    for (std::size_t k = 0; k < r.blocks.size(); ++k) {
      const BlockMotion motion = evaluate(r.blocks[k], model, dt);
      if (k > 0 && k + 1 < r.blocks.size()) {  // the first and the last sample have one neighbour
        v += C * motion.velocity;
        time_s += r.blocks[k].duration_s;
      }
      C = C * rotation_exp(motion.rotation);
    }
    EXPECT_LT((v - Vector3d(2.0, 9.4, 1.5) * time_s).norm(), tolerance_mps) << turned_rad;
  }
}

// ---- derivatives

struct Worst {
  double difference = 0.0;  // of any column, over the size of the largest column of its sensor
  int column = -1;
  const char* what = "";
};

// Columns against central differences of evaluate(), each column in its own unit.
Worst check_columns(const Block& block, const Parameters& parameters, const BlockDerivatives& columns, bool with_mean) {
  const RecordingInfo info = pulses_info();
  const ParameterVector base = to_vector(parameters);
  Worst worst;
  const auto compare = [&](const ParameterRows& analytic, const ParameterRows& numeric, int first, int last,
                           const char* what) {
    const double size = numeric.middleRows(first, last - first).rowwise().norm().maxCoeff();
    if (size == 0.0) return;
    for (int k = first; k < last; ++k) {
      const double difference = (analytic.row(k) - numeric.row(k)).norm() / size;
      if (difference > worst.difference) worst = {difference, k, what};
    }
  };
  ParameterRows rotation, velocity, mean;
  for (int k = 0; k < parameter_count; ++k) {
    const double h = k < 3 ? 100.0 : 1e-3;  // deg/h; g, arcsec a pulse, m/s a pulse: evaluate() is nearly linear in all
    ParameterVector above = base, below = base;
    above[k] += h;
    below[k] -= h;
    const BlockMotion high = evaluate(block, sensor_model(from_vector(above), info), dt);
    const BlockMotion low = evaluate(block, sensor_model(from_vector(below), info), dt);
    rotation.row(k) = (high.rotation - low.rotation).transpose() / (2.0 * h);
    velocity.row(k) = (high.velocity - low.velocity).transpose() / (2.0 * h);
    mean.row(k) = (high.mean_velocity - low.mean_velocity).transpose() / (2.0 * h);
  }
  // N0, A0, n, a apart: their units have nothing to do with one another
  for (const auto& [first, last] : {std::pair{0, 3}, {3, 6}, {6, 15}, {15, 24}}) {
    compare(columns.rotation, rotation, first, last, "rotation");
    compare(columns.velocity, velocity, first, last, "velocity");
    if (with_mean) compare(columns.mean_velocity, mean, first, last, "mean velocity");
  }
  return worst;
}

BlockDerivatives columns_of(const Block& block, const Parameters& parameters) {
  const SensorModel model = sensor_model(parameters, pulses_info());
  BlockDerivatives columns;
  differentiate(block, evaluate(block, model, dt), model, si_per_unit(pulses_info()), true, columns);
  return columns;
}

// Dropped: what a parameter does to the first-order terms inside the third-order one. (The gyro increments of whole coning turns add up to
// nothing, so there is little to compare with.)
TEST(ParameterColumns, AgreeWithCentralDifferences) {
  for (const MotionCase& c : cases()) {
    const bool rest = std::string(c.name) == "rest";
    const Block block = one_block(counts(c.w, c.f, c.samples, sensor_model(wrong_unit(), pulses_info())));
    const Worst worst = check_columns(block, wrong_unit(), columns_of(block, wrong_unit()), rest);
    EXPECT_LT(worst.difference, c.column_tolerance)
        << c.name << ": column " << parameter_keys[std::max(worst.column, 0)] << " of " << worst.what;
  }
}

// The checker must see a wrong column, or it proves nothing.
TEST(ParameterColumns, AWrongColumnIsCaught) {
  const MotionCase turn = cases()[1];
  const Block block = one_block(counts(turn.w, turn.f, turn.samples, sensor_model(wrong_unit(), pulses_info())));
  const BlockDerivatives good = columns_of(block, wrong_unit());
  for (int k = 0; k < parameter_count; ++k) {
    BlockDerivatives bad = good;
    bad.velocity.row(k) *= -1.0;
    const Worst worst = check_columns(block, wrong_unit(), bad, false);
    EXPECT_GT(worst.difference, 1e-3) << parameter_keys[k];
    EXPECT_EQ(worst.column, k);
  }
}

}  // namespace
}  // namespace turncal
