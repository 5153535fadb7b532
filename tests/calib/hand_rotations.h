// A synthetic unit turned by hand from rest to rest, independent of the estimator: the attitude is a product of turns
// about axes fixed in the body with a smooth angle, sampled exactly; the sensors read through the inverse of the true
// model.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/rests/rest_data.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/segmentation.h"
#include "calib/types/recording_types.h"
#include "tests/calib/compress.h"
#include "tests/disturbance.h"

namespace turncal {

struct HandData {
  RecordingInfo info;
  Segments segments;
  std::vector<ImuSample> samples;
  Parameters truth;
};

inline Segmentation find_rests(const RecordingInfo& info, std::span<const ImuSample> samples,
                               const SegmentationOptions& options = {}) {
  RestFinder finder(info, options);
  finder.add(samples);
  return finder.finish();
}

struct HandPlan {
  int rests = 20;
  double rest_s = 6.0;
  double turn_s = 4.0;
  double period_s = 0.01;
  double gyro_noise_radps = 0.005;  // a sample, white
  double accel_noise_mps2 = 0.008;
  unsigned seed = 1;
  Eigen::Vector3d fixed_axis = Eigen::Vector3d::Zero();  // not zero: every turn is about it
  std::optional<double> latitude_deg = {};               // none: an earth that stands still
  Disturbance effect = nullptr;                          // of time, true rate and force
};

inline HandData make_hand_data(const HandPlan& plan) {
  std::mt19937_64 random(plan.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  HandData data;
  data.info.sample_period_s = plan.period_s;
  data.info.gravity_mps2 = 9.81;
  data.info.unit_serial = "hand";
  data.info.latitude_deg = plan.latitude_deg.value_or(0.0);
  const Eigen::Vector3d earth = plan.latitude_deg
                                    ? 7.292115e-5 * Eigen::Vector3d(std::cos(*plan.latitude_deg * M_PI / 180.0),
                                                                    std::sin(*plan.latitude_deg * M_PI / 180.0), 0.0)
                                    : Eigen::Vector3d(Eigen::Vector3d::Zero());
  data.info.gyro_increment = IncrementKind::physical;
  data.info.accel_increment = IncrementKind::physical;
  data.truth.n = Eigen::Matrix3d::Identity();
  data.truth.a = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      data.truth.n(i, j) += 0.02 * uniform(random);
      if (j >= i) data.truth.a(i, j) += 0.02 * uniform(random);
    }
    data.truth.N0_degph[i] = 3000.0 * uniform(random);
    data.truth.A0_g[i] = 0.03 * uniform(random);
  }
  const Eigen::Matrix3d n_inverse = data.truth.n.inverse();
  const Eigen::Matrix3d a_inverse = data.truth.a.inverse();
  const Eigen::Vector3d gyro_bias = data.truth.N0_degph * radps_per_degph;
  const Eigen::Vector3d accel_bias = data.truth.A0_g * standard_gravity_mps2;
  const double period_s = plan.period_s;
  Eigen::Matrix3d C_nb = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY() * data.info.gravity_mps2;

  const auto emit = [&](const Eigen::Vector3d& turn, const Eigen::Vector3d& f) {
    const Eigen::Vector3d w = turn + C_nb.transpose() * earth;
    const double t = (double(data.samples.size()) + 0.5) * period_s;
    DisturbedMoment moment;
    moment.time_s = t, moment.rate_radps = w, moment.force_g = f / standard_gravity_mps2;
    const AddedReading extra = plan.effect ? plan.effect(moment) : AddedReading{};
    const Eigen::Vector3d noise_w(normal(random), normal(random), normal(random));
    const Eigen::Vector3d noise_f(normal(random), normal(random), normal(random));
    const Eigen::Vector3d gyro = n_inverse * (w + extra.gyro_radps + gyro_bias) + noise_w * plan.gyro_noise_radps;
    const Eigen::Vector3d accel = a_inverse * (f + extra.accel_mps2 + accel_bias) + noise_f * plan.accel_noise_mps2;
    ImuSample sample;
    sample.counter = std::int64_t(data.samples.size());
    for (std::size_t k = 0; k < 3; ++k) {
      sample.gyro[k] = gyro[int(k)] * period_s;
      sample.accel[k] = accel[int(k)] * period_s;
    }
    data.samples.push_back(sample);
  };
  const auto segment = [&](SegmentKind kind, std::int64_t from) {
    data.segments.push_back({.kind = kind, .start_sample = from, .end_sample = std::ssize(data.samples)});
  };

  for (int rest = 0; rest < plan.rests; ++rest) {
    auto from = std::int64_t(data.samples.size());
    for (int k = 0; k < std::lround(plan.rest_s / period_s); ++k) emit(Eigen::Vector3d::Zero(), C_nb.transpose() * up);
    segment(SegmentKind::still, from);
    if (rest + 1 == plan.rests) break;
    from = std::int64_t(data.samples.size());
    const Eigen::Vector3d any(normal(random), normal(random), normal(random));
    const Eigen::Vector3d axis = (plan.fixed_axis.norm() > 0.0 ? plan.fixed_axis : any).normalized();
    const double angle = 2.0 + 0.8 * uniform(random);
    const int count = int(std::lround(plan.turn_s / period_s));
    const auto profile = [&](int k) {  // smooth from 0 to angle
      const double x = double(k) / count;
      return angle * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
    };
    const Eigen::Matrix3d start = C_nb;
    for (int k = 0; k < count; ++k) {
      const double turned = 0.5 * (profile(k) + profile(k + 1));
      C_nb = start * Eigen::AngleAxisd(turned, axis).toRotationMatrix();
      emit(axis * (profile(k + 1) - profile(k)) / period_s, C_nb.transpose() * up);
    }
    C_nb = start * Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    segment(SegmentKind::rotate, from);
  }
  return data;
}

// How far two lists of segments agree on what is at rest.
struct Agreement {
  int rests_a = 0, rests_b = 0, matched = 0;              // matched: rests of a that overlap one of b
  double common_s = 0.0, only_a_s = 0.0, only_b_s = 0.0;  // at rest in both, in one
};

inline Agreement compare_rests(const Segments& a, const Segments& b, double sample_period_s) {
  const auto is_rest = [](const Segment& s) { return s.kind != SegmentKind::rotate; };
  const auto seconds = [&](std::int64_t from, std::int64_t to) {
    return double(std::max<std::int64_t>(0, to - from)) * sample_period_s;
  };
  Agreement result;
  for (const Segment& y : b) {
    if (!is_rest(y)) continue;
    ++result.rests_b;
    result.only_b_s += seconds(y.start_sample, y.end_sample);
  }
  for (const Segment& x : a) {
    if (!is_rest(x)) continue;
    double common = 0.0;
    for (const Segment& y : b)
      if (is_rest(y)) common += seconds(std::max(x.start_sample, y.start_sample), std::min(x.end_sample, y.end_sample));
    ++result.rests_a;
    result.matched += common > 0.0 ? 1 : 0;
    result.common_s += common;
    result.only_a_s += seconds(x.start_sample, x.end_sample) - common;
    result.only_b_s -= common;
  }
  return result;
}

// What was compressed, and what was found at rest in it; it stays where it is, for the data point to the recording.
struct HandRecording {
  HandData hand;
  CompressedRecording recording;
  RestData data;
  explicit HandRecording(HandData made) : hand(std::move(made)) {
    recording = compress(hand.info, hand.segments, hand.samples, rest_compression_options());
    ClippingFinder clipping;
    for (const ImuSample& sample : hand.samples) clipping.add(sample);
    clipping.note(recording.events);
    data = make_rest_data(recording);
  }
  explicit HandRecording(const HandPlan& plan) : HandRecording(make_hand_data(plan)) {}
  HandRecording(const HandRecording&) = delete;
};

inline void scale(HandData& hand, double gyro, double accel) {
  for (ImuSample& sample : hand.samples)
    for (std::size_t k = 0; k < 3; ++k) sample.gyro[k] *= gyro, sample.accel[k] *= accel;
}

// Gyros that end at `limit` (increments); how many samples of an axis did.
inline std::int64_t clip_gyros(HandData& hand, double limit) {
  std::int64_t clipped = 0;
  for (ImuSample& sample : hand.samples)
    for (double& x : sample.gyro)
      if (std::abs(x) > limit) {
        x = std::copysign(limit, x);
        ++clipped;
      }
  return clipped;
}

}  // namespace turncal
