// Checks the unit in the first step of a run, so that a wrong one stops the run there and not at the calibration: mounting, axes and signs,
// the sign of the Earth rate, and whether every sensor lives.
//
// unit_fits() reports a defect as an error of kind device: somebody has to look. At rest the specific force must point up; a turn
// must be measured about the body axis that follows from the table's angles; the Earth rate must fit the station's latitude
// (EarthRateCheck); neither sensor may be off by a factor between two units of measure; the weight of gyro pulses must be near enough for a
// calibration to find it; and the temperature, if there is one, must be possible. Coarse on purpose: what a calibration estimates
// (biases, scale factors, misalignments) is not judged.
//
// A person may turn another axis first and back again, so nothing is concluded from a move whose path in the gyros is much longer than
// their sum.
// Not seen: the sign of a gyro that neither a turn nor the Earth rate shows in that step; gyro scale factors.
// A resumed run has passed this. In every step, not only the first: no channel may give one and the same
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

// Limits for what a unit on a table at known angles measures: gravity upwards at rest, C_bn (0, g, 0), and the turn of one axis about the
// body axis that follows from the angles (C_nb = Ry(-H) Rz(P) Rx(R)), with that sign. An error is one line with the measured value.
struct DirectionLimits {
  double direction_deg = 20.0;     // direction of gravity, and of a turn
  double force_tolerance = 0.2;    // relative
  double smallest_turn_deg = 2.0;  // smaller turns are not judged
};

// Returns the body axis of a positive turn about an axis of the table.
Eigen::Vector3d body_axis_of(Axis axis, const AxisTriple& at_deg);
bool points_along(const Eigen::Vector3d& v, const Eigen::Vector3d& direction, double within_deg);
std::string nearest_axis(const Eigen::Vector3d& v);  // axis nearest to a direction: "-z"

// Judges the mean specific force of a rest.
Status judge_force(const Eigen::Vector3d& force_mps2, const AxisTriple& angles_deg, double gravity_mps2,
                   const DirectionLimits& limits);

// Checks site.latitude_deg against the measured Earth rate, from the rests of a run's first step, before anything is estimated.
//
//   rest k:  w_k = b + C_k^T e + noise     b: gyro biases;  e: Earth rate in the table's base, north, up, east
//
// C_k is the attitude by the table's angles, turned so that up agrees with the accelerometers. The prior of b is 0 with the sigma of a large
// bias: 1 deg/h when the first rest's rate is near the Earth rate, as a laser gyro's is, else ten times its distance from it. Inverted poses
// separate b from e. So the first rest finds the wrong hemisphere, and the third a latitude that is a few degrees off. The judged quantity is
// e_up / |e| = sin(latitude), which a common scale error of the gyros does not change. Linear least squares, rest by rest.
//
// Nothing is judged while |e| is far from the Earth rate (units, dead gyros: other checks), nor after a rest that contradicts the
// earlier ones (an axis or a sign: checked by the turns). Coarse on purpose, see its limits.
class EarthRateCheck {
 public:
  explicit EarthRateCheck(double latitude_deg) : latitude_deg_(latitude_deg) {}
  // Rates are in rad/s, body axes, by the nominal scale; sigma: of the mean of one axis. C_nb by the table's angles; up: the specific force.
  // Returns what is wrong, in one line; empty: nothing seen.
  std::string add_rest(const Eigen::Vector3d& rate_radps, double sigma_radps, const Eigen::Matrix3d& C_nb,
                       const Eigen::Vector3d& up);

 private:
  static constexpr double sigmas = 5.0;
  static constexpr double least_difference = 0.05;      // of sin(latitude); larger than magnetic effects on the gyros
  static constexpr double least_bias_degph = 1.0;       // sigma
  static constexpr double strange_bias = 10.0;          // sigma, times the first rest's distance from the Earth rate
  static constexpr double misalignment_rad = 0.005;     // of gyros and fixture against the table's angles
  static constexpr double contradiction = 16.0;         // chi-square of one rest, 3 degrees of freedom: 0.1 %
  static constexpr double smallest = 0.5, largest = 2;  // relative to the Earth rate
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
  static constexpr double detour = 1.3;        // a path longer than this times the gyros' sum is not a single turn
  static constexpr double least_times = 20.0;  // times the Earth rate: from there on a rest judges the units of measure
  static constexpr double least_turn_of_units_deg = 10.0;
  // Ratio of the gyros' angle, by their nominal pulse, to the turn. Within these limits a calibration finds the weight of the pulse.
  static constexpr double least_pulses = 0.42, most_pulses = 1.6;
  RecordingInfo info_;
  bool active_ = false;
  std::optional<int> step_;
  // Sums of the present segment. The path of the gyros is summed in stretches of half a second, so that noise adds little to it; the mean of the
  // last rest is subtracted.
  struct Sums {
    std::int64_t start_sample = 0, samples = 0;
    Eigen::Vector3d gyro{0, 0, 0}, accel{0, 0, 0};
    Eigen::Vector3d stretch{0, 0, 0};
    std::int64_t stretch_samples = 0;
    double way = 0.0, stretches = 0.0;
    Eigen::Vector3d stretch_squares{0, 0, 0};  // sum over the stretches, for each axis
    std::int64_t impossible_temperatures = 0;
    float temperature_c = 0.0F;  // last impossible one
  };
  Sums sums_;
  std::optional<AxisTriple> before_deg_;      // end of the previous segment
  std::optional<Eigen::Vector3d> rest_gyro_;  // mean per sample in the last rest
  std::optional<EarthRateCheck> earth_;
  std::optional<SpikeFinder> spikes_;
  std::optional<ChannelLife> life_;
  std::optional<AxisTriple> turned_to_deg_;  // checked in every step
  Status found_;                             // first defect
};

}  // namespace turncal
