// What a run learns of the unit on the table in its first step, so that it stops there and not at the calibration: is it mounted as the
// sequence supposes, do axes and signs fit, does the earth turn the right way, does every sensor live.
//
// A sink on the way to the recording. At rest the specific force must point up, C_bn (0, g, 0), within direction_deg, and have that size
// within force_tolerance; a turn of one axis must be felt about the body axis that the table's angles say (C_nb = Ry(-H) Rz(P) Rx(R)),
// with that sign; the mean rate along the vertical must not be that of the other hemisphere; neither may be off by a factor that two units
// differ by; and the temperature, where there is one, must be one that can be. Coarse on purpose: what a calibration estimates (biases, scale factors, installation errors) is not judged.
//
// A person may turn another axis first and back again: of a move whose way in the gyros is much longer than what they add up to nothing
// is concluded.
// Not seen: the sign of a gyro that neither a turn nor the earth's rotation along the vertical shows in that step; gyro scale factors.
// A run that goes on after an interruption has passed this. In every step, not the first alone: no channel may give one and the same
// value while the table turns (channel_life.h). A sample that cannot be (implausible.h) is not counted. What is found is an error of kind device: somebody has to look.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/channel_life.h"
#include "calib/statistics/implausible.h"
#include "orchestrator/run/run_sink.h"

namespace turncal {

struct FirstStepLimits {
  double direction_deg = 20.0;        // of gravity, and of a turn
  double force_tolerance = 0.2;       // of 1
  double smallest_turn_deg = 2.0;     // that is judged
  double detour = 1.3;                // a way longer than this times the gyros' sum was not one turn
  double least_vertical_degph = 3.0;  // earth rate along the vertical; below that the hemisphere is not judged
  double other_way = 0.3;             // it is the other hemisphere's when it is -1 times the expected within this
  double least_times = 20.0;          // the expected rate along the vertical: from there on units are judged by it
  double least_turn_of_units_deg = 10.0;
};

// Means over a rest: m/s^2, rad/s. Error: what is wrong, in one line.
Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const FirstStepLimits& limits);
// The gyros' sum over a turn from `from` to `to`, which differ in one axis; any unit.
Status judge_felt(const Eigen::Vector3d& sum, const AxisTriple& from_deg, const AxisTriple& to_deg,
                  const FirstStepLimits& limits);

class FirstStepCheck : public RunSink {
 public:
  explicit FirstStepCheck(RunSink& sink, FirstStepLimits limits = {}) : sink_(sink), limits_(limits) {}

  Status start(const RecordingInfo& info) override;
  Status resume(const RecordingInfo& info, std::int64_t end_sample) override;
  Status begin_segment(const Segment& segment) override;
  Status add(std::span<const ImuSample> samples) override;
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override;
  Status sync() override { return sink_.sync(); }
  Status finish() override;

 private:
  Status judge_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg);
  Status judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples);
  Status judge_units(double ratio) const;
  Status judge_step() const;
  Status judge_life(const AxisTriple& angles_deg);
  void end_stretch();

  RunSink& sink_;
  FirstStepLimits limits_;
  RecordingInfo info_;
  bool active_ = false;
  std::optional<int> step_;
  Segment segment_;
  Eigen::Vector3d gyro_ = Eigen::Vector3d::Zero(), accel_ = Eigen::Vector3d::Zero();  // sums over the segment
  std::int64_t samples_ = 0;
  // The way that the gyros felt, half a second at a time, so that noise adds little to it; the mean of the last rest taken off.
  Eigen::Vector3d stretch_ = Eigen::Vector3d::Zero();
  std::int64_t stretch_samples_ = 0;
  double way_ = 0.0;
  std::optional<AxisTriple> before_deg_;      // where the segment before ended
  std::optional<Eigen::Vector3d> rest_gyro_;  // mean of a sample in the last rest
  int rests_ = 0, rests_other_way_ = 0;
  std::optional<SpikeFinder> spikes_;
  std::optional<ChannelLife> life_;
  std::optional<AxisTriple> turned_to_deg_;   // of every step
  std::int64_t impossible_temperatures_ = 0;  // of the segment
  float temperature_c_ = 0.0F;                // the last of them
};

}  // namespace turncal
