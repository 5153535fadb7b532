// A synthetic unit turned by hand from rest to rest, independent of the estimator: the attitude is a product of turns
// about axes fixed in the body with a smooth angle, sampled exactly; the sensors read through the inverse of the true
// model.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <optional>
#include <random>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/statistics/segmentation.h"
#include "calib/types/recording_types.h"

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
  double scale_accel = 1.0;                              // of what is written: another unit
  Eigen::Vector3d fixed_axis = Eigen::Vector3d::Zero();  // not zero: every turn is about it
  std::optional<double> latitude_deg = {};               // none: an earth that stands still
  // Added to the true rate (rad/s) and specific force (m/s^2), of true w, f and time.
  std::function<void(const Eigen::Vector3d&, const Eigen::Vector3d&, double, Eigen::Vector3d&, Eigen::Vector3d&)>
      effect = nullptr;
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
    Eigen::Vector3d extra_w = Eigen::Vector3d::Zero();
    Eigen::Vector3d extra_f = Eigen::Vector3d::Zero();
    if (plan.effect) plan.effect(w, f, t, extra_w, extra_f);
    const Eigen::Vector3d noise_w(normal(random), normal(random), normal(random));
    const Eigen::Vector3d noise_f(normal(random), normal(random), normal(random));
    const Eigen::Vector3d gyro = n_inverse * (w + extra_w + gyro_bias) + noise_w * plan.gyro_noise_radps;
    const Eigen::Vector3d accel = a_inverse * (f + extra_f + accel_bias) + noise_f * plan.accel_noise_mps2;
    ImuSample sample;
    sample.counter = std::int64_t(data.samples.size());
    for (std::size_t k = 0; k < 3; ++k) {
      sample.gyro[k] = gyro[int(k)] * period_s;
      sample.accel[k] = accel[int(k)] * period_s * plan.scale_accel;
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
