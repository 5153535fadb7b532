// What a run checks of the unit in its first step, so that it stops there and not at the calibration: is it mounted as the
// sequence supposes, do axes and signs fit, does the earth turn the right way, does every sensor live.
//
// A sink on the way to the recording; what it finds is told by unit_fits(), as an error of kind device: somebody has to look. At rest the
// specific force must point up, a turn must be measured about the body axis that follows from the table's angles (felt_directions.h), and the earth must
// turn as at the station's latitude (EarthRateCheck); neither sensor may be off by a factor that two units differ by; pulses of the
// gyros must be of a weight from which a calibration finds it; and the temperature, where there is one, must be one that can be. Coarse on
// purpose: what a calibration estimates (biases, scale factors, misalignments) is not judged.
//
// A person may turn another axis first and back again: from a move whose path in the gyros is much longer than their sum nothing
// is concluded.
// Not seen: the sign of a gyro that neither a turn nor the earth's rotation shows in that step; gyro scale factors.
// A run that goes on after an interruption has passed this. In every step, not the first alone: no channel may give one and the same
// value while the table turns (data_screen.h). An impossible sample (data_screen.h) is not counted.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/data_screen.h"
#include "orchestrator/devices/felt_directions.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

struct FirstStepLimits : DirectionLimits {
  double detour = 1.3;        // a way longer than this times the gyros' sum was not one turn
  double least_times = 20.0;  // the earth's rate: from there on units are judged by a rest
  double least_turn_of_units_deg = 10.0;
  // Ratio of the gyros' angle by their nominal pulse to the turn. Within it a calibration finds the weight of the pulse.
  double least_pulses = 0.42, most_pulses = 1.6;
};

class FirstStepCheck : public RunSink {
 public:
  explicit FirstStepCheck(RunSink& sink, FirstStepLimits limits = {}) : sink_(sink), limits_(limits) {}

  Status start(const RecordingInfo& info) override;
  Status resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) override;
  Status begin_segment(const Segment& segment) override;
  Status add(std::span<const ImuSample> samples) override;
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override;
  Status sync() override { return sink_.sync(); }
  Status finish() override { return sink_.finish(); }
  std::optional<std::uint32_t> written() const override { return sink_.written(); }
  Status unit_fits() const override { return found_; }

 private:
  Status judge_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg);
  Status judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples);
  Status judge_units(double ratio) const;
  Status judge_pulses(double ratio) const;
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
  // The path of the gyros, half a second at a time, so that noise adds little to it; the mean of the last rest is subtracted.
  Eigen::Vector3d stretch_ = Eigen::Vector3d::Zero();
  std::int64_t stretch_samples_ = 0;
  double way_ = 0.0;
  double stretches_ = 0.0;  // of the segment, and for each axis the sum of their squares
  Eigen::Vector3d stretch_squares_ = Eigen::Vector3d::Zero();
  std::optional<AxisTriple> before_deg_;      // where the segment before ended
  std::optional<Eigen::Vector3d> rest_gyro_;  // mean of a sample in the last rest
  std::optional<EarthRateCheck> earth_;
  std::optional<SpikeFinder> spikes_;
  std::optional<ChannelLife> life_;
  std::optional<AxisTriple> turned_to_deg_;   // of every step
  std::int64_t impossible_temperatures_ = 0;  // of the segment
  float temperature_c_ = 0.0F;                // the last of them
  Status found_;                              // what is wrong, first
};

}  // namespace turncal
