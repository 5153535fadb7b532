// What a run checks of the unit in its first step, so that it stops there and not at the calibration: is it mounted as the
// sequence supposes, do axes and signs fit, does the earth turn the right way, does every sensor live.
//
// What it finds is told by unit_fits(), as an error of kind device: somebody has to look. At rest the specific force must point up, a turn
// must be measured about the body axis that follows from the table's angles, and the earth must turn as at the station's latitude
// (EarthRateCheck); neither sensor may be off by a factor that two units differ by; pulses of the gyros must be of a weight from which a
// calibration finds it; and the temperature, where there is one, must be one that can be. Coarse on purpose: what a calibration estimates
// (biases, scale factors, misalignments) is not judged.
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
#include "orchestrator/run/run_observer.h"

namespace turncal {

// What a unit on a table at known angles must measure, coarsely: gravity upwards at rest, C_bn (0, g, 0), and the turn of one axis about the
// body axis that follows from the angles (C_nb = Ry(-H) Rz(P) Rx(R)), with that sign. An error says in one line what was measured instead.
struct DirectionLimits {
  double direction_deg = 20.0;     // of gravity, and of a turn
  double force_tolerance = 0.2;    // of 1
  double smallest_turn_deg = 2.0;  // that is judged
};

// Of the body, for a turn by + about an axis of the table.
Eigen::Vector3d body_axis_of(Axis axis, const AxisTriple& at_deg);
bool points_along(const Eigen::Vector3d& v, const Eigen::Vector3d& direction, double within_deg);
std::string nearest_axis(const Eigen::Vector3d& v);  // "-z": the one that a direction is nearest to

// Means over a rest: m/s^2.
Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const DirectionLimits& limits);

// Does the earth turn as site.latitude_deg says? From the rests of a run's first step, before anything is estimated.
//
//   rest k:  w_k = b + C_k^T e + noise     b: the gyros' biases;  e: the earth's rate in the table's base, north, up, east
//
// C_k is the attitude by the table's angles, turned so that up is where the accelerometers feel it. b begins as 0 +- what a bias may well
// be: 1 deg/h where the first rest's rate is of the earth's size as that of a laser gyro is, and else ten times what it is off by. Poses that
// turn over tell b from e. So the first rest finds the other hemisphere, and the third a latitude that is a few degrees off. What is judged is e_up / |e| = sin(latitude):
// a common scale error of the gyros does not matter. Linear least squares, rest by rest.
//
// Nothing is judged while |e| is not of the earth's size (units, dead gyros: other checks), nor after a rest that contradicts those
// before it (an axis or a sign: checked by the turns). Coarse on purpose, see its limits.
class EarthRateCheck {
 public:
  explicit EarthRateCheck(double latitude_deg) : latitude_deg_(latitude_deg) {}
  // rad/s, body axes, by the nominal scale; sigma of the mean of one axis. C_nb by the table's angles; up: the specific force.
  // What is wrong, in one line; empty: nothing that is seen.
  std::string add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                       const Eigen::Vector3d& up);

 private:
  static constexpr double sigmas = 5.0;
  static constexpr double least_difference = 0.05;   // of sin(latitude): more than effects of the field on the gyros
  static constexpr double least_bias_degph = 1.0;    // sigma
  static constexpr double strange_bias = 10.0;       // sigma, times what the first rest's rate is off from the earth's
  static constexpr double misalignment_rad = 0.005;  // of gyros and fixture, against what the table's angles say
  static constexpr double contradiction = 16.0;      // chi squared of one rest, of three: 0.1 %
  static constexpr double smallest = 0.5, largest = 2;  // of the earth's rate
  double latitude_deg_;
  Eigen::Matrix<double, 6, 1> x_ = Eigen::Matrix<double, 6, 1>::Zero();  // b, e
  Eigen::Matrix<double, 6, 6> P_ = Eigen::Matrix<double, 6, 6>::Zero();
  int rests_ = 0;
  bool contradictory_ = false;
};

class FirstStepCheck : public RunSink {
 public:
  Status start(const RecordingInfo& info) override;
  Status resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) override;
  Status begin_segment(const Segment& segment) override;
  Status add(std::span<const ImuSample> samples) override;
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override;
  Status unit_fits() const override { return found_; }

 private:
  void begin(const RecordingInfo& info);
  Status judge_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg);
  Status judge_rest(const SensorModel& model, const AxisTriple& angles_deg, double samples);
  Status judge_units(double ratio) const;
  Status judge_pulses(double ratio) const;
  Status judge_life(const AxisTriple& angles_deg);
  void end_stretch();

  static constexpr DirectionLimits limits{};
  static constexpr double detour = 1.3;        // a way longer than this times the gyros' sum was not one turn
  static constexpr double least_times = 20.0;  // the earth's rate: from there on units are judged by a rest
  static constexpr double least_turn_of_units_deg = 10.0;
  // Ratio of the gyros' angle by their nominal pulse to the turn. Within it a calibration finds the weight of the pulse.
  static constexpr double least_pulses = 0.42, most_pulses = 1.6;
  RecordingInfo info_;
  bool active_ = false;
  std::optional<int> step_;
  // Of the segment that goes on. The path of the gyros, half a second at a time, so that noise adds little to it; the mean of the last rest is
  // subtracted.
  struct Sums {
    std::int64_t start_sample = 0, samples = 0;
    Eigen::Vector3d gyro{0, 0, 0}, accel{0, 0, 0};
    Eigen::Vector3d stretch{0, 0, 0};
    std::int64_t stretch_samples = 0;
    double way = 0.0, stretches = 0.0;
    Eigen::Vector3d stretch_squares{0, 0, 0};  // for each axis the sum over the stretches
    std::int64_t impossible_temperatures = 0;
    float temperature_c = 0.0F;  // the last of them
  };
  Sums sums_;
  std::optional<AxisTriple> before_deg_;      // where the segment before ended
  std::optional<Eigen::Vector3d> rest_gyro_;  // mean of a sample in the last rest
  std::optional<EarthRateCheck> earth_;
  std::optional<SpikeFinder> spikes_;
  std::optional<ChannelLife> life_;
  std::optional<AxisTriple> turned_to_deg_;  // of every step
  Status found_;                             // what is wrong, first
};

}  // namespace turncal
