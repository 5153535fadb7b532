#include "calib/closed_form/leg_navigation.h"

#include <algorithm>

#include "calib/model/attitude.h"
#include "calib/statistics/block_motion.h"

namespace turncal {
namespace {

// What turns a unit at rest by less: earth rate, bias and a few pulses of quantisation.
constexpr double rest_rate_radps = 0.02 * rad_per_deg;
constexpr double rest_angle_rad = 2e-5;

bool turns(const Block& block, const SensorModel& model, double period_s) {
  const double time_s = block.samples * period_s;
  return (model.gyro_scale * block.gyro - model.gyro_bias_radps * time_s).norm() >
         rest_rate_radps * time_s + rest_angle_rad;
}

// A block at rest from which samples are missing, as if they had come: everything is even over the block.
Block stretched(const Block& block) {
  Block full = block;
  const double factor = static_cast<double>(block.samples + block.missing) / block.samples;
  full.gyro *= factor;
  full.accel *= factor;
  full.gyro_time = 0.5 * block.duration_s * full.gyro;
  full.accel_time = 0.5 * block.duration_s * full.accel;
  full.coning.setZero();
  full.sculling = 0.5 * full.gyro * full.accel.transpose();
  return full;
}

class Navigator {
 public:
  Navigator(const CompressedRecording& recording, const SensorModel& model, const Eigen::Matrix3d& start_C_nb)
      : C_nb(start_C_nb), recording_(recording), model_(model), earth_(earth_rate_n(recording.info.latitude_deg)) {}

  void advance(std::size_t index) {
    const Block& block = recording_.blocks[index];
    const double t = block.duration_s;
    const BlockMotion motion = block.missing > 0 && !lost_in_motion(recording_, index, model_)
                                   ? evaluate(stretched(block), model_, recording_.info.sample_period_s)
                                   : evaluate(block, model_, recording_.info.sample_period_s);
    const Eigen::Matrix3d half_turn = rotation_exp(-0.5 * t * earth_);
    velocity += half_turn * (C_nb * motion.velocity) - Eigen::Vector3d(0.0, recording_.info.gravity_mps2 * t, 0.0);
    C_nb = half_turn * half_turn * C_nb * rotation_exp(motion.rotation);
    rotation = motion.rotation;
  }

  Eigen::Matrix3d C_nb;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // of the block last passed

 private:
  const CompressedRecording& recording_;
  const SensorModel& model_;
  const Eigen::Vector3d earth_;
};

}  // namespace

std::vector<std::size_t> first_blocks(const CompressedRecording& recording) {
  std::vector<std::size_t> first(recording.segments.size() + 1, recording.blocks.size());
  for (std::size_t i = recording.blocks.size(); i-- > 0;)
    first[static_cast<std::size_t>(recording.blocks[i].segment)] = i;
  // a segment without blocks begins where the next one does
  for (std::size_t k = recording.segments.size(); k-- > 0;) first[k] = std::min(first[k], first[k + 1]);
  return first;
}

Eigen::Vector3d mean_specific_force(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                                    std::size_t segment, const SensorModel& model) {
  Eigen::Vector3d counts = Eigen::Vector3d::Zero();
  double time_s = 0.0;
  for (std::size_t i = first_block[segment]; i < first_block[segment + 1]; ++i) {
    counts += recording.blocks[i].accel;
    time_s += recording.blocks[i].samples * recording.info.sample_period_s;
  }
  return model.accel_scale * counts / time_s - model.accel_bias_mps2;
}

bool lost_in_motion(const CompressedRecording& recording, std::size_t index, const SensorModel& model) {
  const Block& block = recording.blocks[index];
  if (block.missing == 0) return false;
  if (turns(block, model, recording.info.sample_period_s)) return true;
  return index > 0 && turns(recording.blocks[index - 1], model, recording.info.sample_period_s);
}

LegMotion navigate_leg(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                       std::size_t from_segment, std::size_t to_segment, const SensorModel& model,
                       const Eigen::Vector3d& axis_b) {
  const Segment& from = recording.segments[from_segment];
  const Eigen::Matrix3d commanded =
      attitude_from_angles(from.heading_deg * rad_per_deg, from.pitch_deg * rad_per_deg, from.roll_deg * rad_per_deg);
  LegMotion leg;
  leg.C_nb_start = level(commanded, mean_specific_force(recording, first_block, from_segment, model));
  Navigator navigator(recording, model, leg.C_nb_start);
  for (std::size_t i = first_block[from_segment + 1]; i < first_block[to_segment]; ++i) {
    navigator.advance(i);
    leg.before_dwell_s += recording.blocks[i].duration_s;
    leg.turned_rad += axis_b.dot(navigator.rotation);
  }
  leg.C_nb_arrived = navigator.C_nb;
  navigator.velocity.setZero();
  for (std::size_t i = first_block[to_segment]; i < first_block[to_segment + 1]; ++i) {
    navigator.advance(i);
    leg.dwell_s += recording.blocks[i].duration_s;
  }
  leg.velocity_mps = navigator.velocity;
  const Eigen::Matrix3d turn = navigator.C_nb * leg.C_nb_start.transpose();
  leg.heading_change_rad = -0.5 * (turn(0, 2) - turn(2, 0));  // up is the second axis of n
  return leg;
}

}  // namespace turncal
