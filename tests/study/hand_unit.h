// A unit turned by hand, drawn at random: what moves it and what it reads, without any code of the estimators.
//
// The motion is one of attitude and place, four times as fine as the samples: a hand turns the unit about two axes that overlap, carries it
// some decimetres, and puts it down. It then creeps by `creep_rad` and trembles (six sines of 2 to 9 Hz an axis, 20 times as much while it is
// held as at rest). Rates are the rotation from one step to the next, forces the second difference of place: all of it is motion that the
// sensors feel alike, none is noise. Of the sensors: scale and misalignment, bias, white noise. Not modelled: bias that wanders, any effect.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/types/recording_types.h"

namespace turncal {

struct HandUnitPlan {
  double angle_random_walk_deg_per_rt_h = 0.3;
  double tremor = 1.0;  // 0: as a table holds it; 1: as the control of docs/import.md stands still
  unsigned seed = 1;
};

struct HandUnit {
  RecordingInfo info;
  std::vector<ImuSample> samples;
  Parameters truth;
  int rests = 0;
  double rest_s = 0.0;  // mean
};

class HandUnitMaker {
 public:
  explicit HandUnitMaker(const HandUnitPlan& plan) : plan_(plan), random_(plan.seed) {}
  HandUnit make() {
    draw_unit();
    move();
    for (std::size_t k = 1; k + step_count <= poses_.size() - 1; k += step_count) add_sample(k);
    return std::move(unit_);
  }

 private:
  using Vector3d = Eigen::Vector3d;
  struct Pose {
    Eigen::Matrix3d C;  // C_nb
    Vector3d at;        // m
  };
  static constexpr std::size_t step_count = 4;  // a sample
  static constexpr double sample_s = 0.01, h = sample_s / step_count;
  static constexpr double creep_rad = 2e-3, tremor_rad = 1e-4, tremor_m = 1e-5, held = 20.0;

  double uniform(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random_); }
  double log_uniform(double from, double to) { return std::exp(uniform(std::log(from), std::log(to))); }
  Vector3d normal() {
    const double x = normal_(random_), y = normal_(random_), z = normal_(random_);
    return {x, y, z};
  }

  void draw_unit() {
    unit_.info.sample_period_s = sample_s;
    unit_.info.gravity_mps2 = 9.81;
    unit_.info.unit_serial = "drawn";
    unit_.info.gyro_increment = unit_.info.accel_increment = IncrementKind::physical;
    unit_.info.latitude_deg = uniform(-70.0, 70.0);
    const double largest_bias = std::min(3000.0, 1.0 + 3000.0 * plan_.angle_random_walk_deg_per_rt_h);
    Parameters& p = unit_.truth;
    p.n = p.a = Eigen::Matrix3d::Identity();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        p.n(i, j) += uniform(-0.05, 0.05);
        if (j >= i) p.a(i, j) += uniform(-0.05, 0.05);
      }
      p.N0_degph[i] = largest_bias * uniform(-1.0, 1.0);
      p.A0_g[i] = 0.03 * uniform(-1.0, 1.0);
    }
    gyro_noise_ = plan_.angle_random_walk_deg_per_rt_h * M_PI / 180.0 / 60.0 * std::sqrt(sample_s);
    accel_noise_ = log_uniform(10.0, 300.0) * 9.80665e-6 * std::sqrt(sample_s);
    for (auto* waves : {&turns_, &shifts_})
      for (Wave& wave : *waves)
        wave = {normal() / std::sqrt(3.0), 2.0 * M_PI * uniform(2.0, 9.0), uniform(0.0, 2.0 * M_PI)};
  }

  // Adds a step of the motion that is meant; the tremor comes on top.
  void add_pose(const Eigen::Matrix3d& C, const Vector3d& at, double loud) {
    const double t = h * double(poses_.size());
    Vector3d turned = Vector3d::Zero(), shifted = Vector3d::Zero();
    for (const Wave& wave : turns_) turned += wave.size * std::sin(wave.rate * t + wave.phase);
    for (const Wave& wave : shifts_) shifted += wave.size * std::sin(wave.rate * t + wave.phase);
    poses_.push_back(
        {C * exp(plan_.tremor * loud * tremor_rad * turned), at + plan_.tremor * loud * tremor_m * shifted});
  }
  static Eigen::Matrix3d exp(const Vector3d& r) {
    return r.norm() > 0.0 ? Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix()
                          : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
  }
  static double smooth(double x) {  // from 0 to 1, at rest at both ends
    x = std::min(std::max(x, 0.0), 1.0);
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
  }

  void move() {
    unit_.rests = int(uniform(12.0, 41.0));
    const double longest_s = log_uniform(4.0, 30.0);
    Eigen::Matrix3d C = exp(normal());
    Vector3d at = Vector3d::Zero();
    for (int k = 0; k < unit_.rests; ++k) {
      const double rest_s = uniform(0.5 * longest_s, longest_s), settling_s = uniform(1.0, 5.0);
      const Vector3d creep = plan_.tremor * creep_rad * normal();
      const Eigen::Matrix3d down = C;
      const auto count = int(rest_s / h);
      for (int i = 0; i < count; ++i) {
        C = down * exp(creep * (1.0 - std::exp(-i * h / settling_s)));
        add_pose(C, at, 1.0);
      }
      unit_.rest_s += rest_s / unit_.rests;
      if (k + 1 < unit_.rests) turn(C, at);
    }
  }

  void turn(Eigen::Matrix3d& C, Vector3d& at) {
    const Vector3d first = normal().normalized() * uniform(1.2, 2.8),
                   second = normal().normalized() * uniform(0.0, 0.8);
    const Vector3d there = plan_.tremor * 0.2 * normal(), lever = plan_.tremor * 0.1 * normal();
    const Eigen::Matrix3d from = C;
    const Vector3d pivot = at - C * lever;
    const auto count = int(uniform(2.0, 5.0) / h);
    for (int i = 1; i <= count; ++i) {
      const double x = double(i) / count;
      C = from * exp(smooth(1.4 * x) * first) * exp(smooth(1.4 * x - 0.4) * second);
      at = pivot + C * lever + smooth(x) * there;
      const double loud = 1.0 + (held - 1.0) * (smooth(5.0 * x) - smooth(5.0 * x - 4.0));
      add_pose(C, at, loud);
    }
  }

  void add_sample(std::size_t first) {
    const double g = unit_.info.gravity_mps2, latitude = unit_.info.latitude_deg * M_PI / 180.0;
    const Vector3d earth = 7.292115e-5 * Vector3d(std::cos(latitude), std::sin(latitude), 0.0);
    Vector3d turned = Vector3d::Zero(), pushed = Vector3d::Zero();
    for (std::size_t k = first; k < first + step_count; ++k) {
      const Eigen::Matrix3d by = poses_[k].C.transpose() * poses_[k + 1].C;
      const Eigen::AngleAxisd turn{Eigen::Quaterniond(by)};
      const Eigen::Matrix3d middle = poses_[k].C * exp(0.5 * turn.angle() * turn.axis());
      const std::size_t after = std::min(k + 2, poses_.size() - 1);
      const Vector3d gained = (poses_[after].at - poses_[k + 1].at - poses_[k].at + poses_[k - 1].at) / (2.0 * h);
      turned += turn.angle() * turn.axis() + middle.transpose() * earth * h;
      pushed += middle.transpose() * (gained + Vector3d(0.0, g * h, 0.0));
    }
    const Parameters& p = unit_.truth;
    const Vector3d gyro =
        p.n.inverse() * (turned + p.N0_degph * (M_PI / 180.0 / 3600.0) * sample_s) + gyro_noise_ * normal();
    const Vector3d accel = p.a.inverse() * (pushed + p.A0_g * 9.80665 * sample_s) + accel_noise_ * normal();
    ImuSample sample;
    sample.counter = std::int64_t(unit_.samples.size());
    for (std::size_t k = 0; k < 3; ++k) {
      sample.gyro[k] = gyro[Eigen::Index(k)];
      sample.accel[k] = accel[Eigen::Index(k)];
    }
    unit_.samples.push_back(sample);
  }

  struct Wave {
    Vector3d size;
    double rate = 0.0, phase = 0.0;
  };
  const HandUnitPlan plan_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  HandUnit unit_;
  std::vector<Pose> poses_;
  std::array<Wave, 6> turns_, shifts_;
  double gyro_noise_ = 0.0, accel_noise_ = 0.0;  // of an increment
};

inline HandUnit draw_hand_unit(const HandUnitPlan& plan) { return HandUnitMaker(plan).make(); }

}  // namespace turncal
