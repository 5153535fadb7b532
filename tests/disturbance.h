// For tests and studies: a recording with something added to what its sensors read, block by block.
//
// Any function of the moment will do, so this knows no catalogue: it shares no formula with the estimator's effects or with the rig's.
// Over a block (a second at rest, some 0.01 rad in a turn) the addition is taken as constant; with alpha, beta constant over a block
// its sums change by gyro_time = t/2 gyro and sculling = gyro accel' / 2, and its coning not at all.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include <Eigen/LU>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"

namespace turncal {

inline constexpr double degph = pi / 180.0 / 3600.0;
inline constexpr double ug = 9.80665e-6;

struct DisturbedMoment {
  double time_s = 0.0;  // middle of the block, from the first sample
  double length_s = 0.0;
  double temperature_c = 0.0;
  bool at_rest = false;
  int turn = 0;                         // turns before this moment, or the turn it lies in
  double since_turn_s = 1e9;            // at rest
  Eigen::Vector3d force_g, rate_radps;  // as measured, body axes
  Eigen::Vector3d table_rad;            // heading, pitch, roll: as commanded at rest, on the way in a turn
};
struct AddedReading {
  Eigen::Vector3d gyro_radps = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_mps2 = Eigen::Vector3d::Zero();
};
inline AddedReading to_gyro(int axis, double radps) { return {.gyro_radps = radps * Eigen::Vector3d::Unit(axis)}; }
inline AddedReading to_accel(int axis, double mps2) { return {.accel_mps2 = mps2 * Eigen::Vector3d::Unit(axis)}; }
using Disturbance = std::function<AddedReading(const DisturbedMoment&)>;

// Of one reading alone, in its unit; `value` of a moment.
template <class Value>
Disturbance on_gyro(int axis, Value value) {
  return [=](const DisturbedMoment& m) mutable { return to_gyro(axis, value(m)); };
}
template <class Value>
Disturbance on_accel(int axis, Value value) {
  return [=](const DisturbedMoment& m) mutable { return to_accel(axis, value(m)); };
}

// What the force along an axis is beyond itself lagged by tau.
inline Disturbance accel_creep(int axis, double micro_g, double tau_s) {
  return on_accel(axis, [=, last = 0.0, left = 0.0, time = 1e9](const DisturbedMoment& m) mutable {
    const double now = m.force_g[axis];
    if (m.time_s < time) left = 0.0, last = now, time = m.time_s;
    left = left * std::exp(-(m.time_s - time) / tau_s) + (now - last);
    last = now;
    time = m.time_s;
    return micro_g * ug * left;
  });
}

// Of the scale factor of one gyro, another number in each turn.
inline Disturbance scattered_scale(int axis, double size, std::uint64_t seed) {
  return on_gyro(axis, [=](const DisturbedMoment& m) {
    std::mt19937_64 own(seed + std::uint64_t(m.turn));
    own.discard(3);
    return size * std::normal_distribution<double>()(own) * m.rate_radps[axis];
  });
}

// Of a gyro's rate what lock-in takes: `part` of it far below `rate_degph`, next to nothing above.
inline double locked_in(double rate_radps, double part, double rate_degph) {
  const double square = std::pow(rate_degph * degph, 2);
  return part * rate_radps * square / (square + rate_radps * rate_radps);
}

// Calls `visit(block, moment)` for every block. `truth`: of the unit.
template <class Visit>
void each_moment(const CompressedRecording& recording, const Parameters& truth, Visit visit) {
  const SensorModel model = sensor_model(truth, recording.info);
  const double period = recording.info.sample_period_s;
  const auto start_s = [&](const Block& b) {
    return double(b.start_sample - recording.blocks.front().start_sample) * period;
  };
  const double length = start_s(recording.blocks.back()) + recording.blocks.back().duration_s;
  double rest_began = -1e9;
  int turn = 0;
  bool turning = false;
  // What has been turned by the middle of a block, and in all of its segment.
  std::vector<double> turned(recording.blocks.size()), in_all(recording.segments.size(), 0.0);
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    const Block& b = recording.blocks[k];
    const double angle = (model.gyro_scale * b.gyro - model.gyro_bias_radps * b.duration_s).norm();
    double& all = in_all[std::size_t(b.segment)];
    turned[k] = all + 0.5 * angle;
    all += angle;
  }
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    const Block& block = recording.blocks[k];
    const Segment& segment = recording.segments[block.segment];
    const bool rotating = segment.kind == SegmentKind::rotate;
    const Segment& from = recording.segments[rotating && block.segment > 0 ? block.segment - 1 : block.segment];
    DisturbedMoment m;
    m.time_s = start_s(block) + 0.5 * block.duration_s;
    m.length_s = length;
    m.temperature_c = block.temperature_c;
    m.at_rest = !rotating;
    if (rotating && !turning) ++turn;
    if (!rotating && turning) rest_began = start_s(block);
    turning = rotating;
    m.turn = turn;
    m.since_turn_s = rotating ? 1e9 : m.time_s - rest_began;
    m.rate_radps = model.gyro_scale * block.gyro / block.duration_s - model.gyro_bias_radps;
    m.force_g = (model.accel_scale * block.accel / block.duration_s - model.accel_bias_mps2) / 9.80665;
    const double part = rotating ? turned[k] / in_all[std::size_t(block.segment)] : 1.0;
    const Eigen::Vector3d before(from.heading_deg, from.pitch_deg, from.roll_deg),
        after(segment.heading_deg, segment.pitch_deg, segment.roll_deg);
    m.table_rad = pi / 180.0 * (before + part * (after - before));
    visit(k, m);
  }
}

inline void disturb(CompressedRecording& recording, const Parameters& truth, const Disturbance& disturbance) {
  const SensorModel model = sensor_model(truth, recording.info);
  const Eigen::Matrix3d gyro_counts = model.gyro_scale.inverse(), accel_counts = model.accel_scale.inverse();
  each_moment(recording, truth, [&](std::size_t k, const DisturbedMoment& m) {
    Block& b = recording.blocks[k];
    const AddedReading added = disturbance(m);
    const Eigen::Vector3d g = gyro_counts * added.gyro_radps * b.duration_s;
    const Eigen::Vector3d a = accel_counts * added.accel_mps2 * b.duration_s;
    b.sculling += 0.5 * (g * b.accel.transpose() + b.gyro * a.transpose() + g * a.transpose());
    b.gyro += g;
    b.accel += a;
    b.gyro_time += 0.5 * b.duration_s * g;
    b.accel_time += 0.5 * b.duration_s * a;
  });
}

}  // namespace turncal
