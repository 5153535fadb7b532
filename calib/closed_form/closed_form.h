// Closed-form calibration: the fourteen steps of Wang (2020), with the formulas of docs/estimator.md.
//
// Each step evaluates rests, or one or two legs, with the parameters as corrected by the steps before it. It converts
// the velocity gained in the dwell into the error of the parameter that caused it, and corrects that parameter. The
// fourteen steps are repeated over the same recording until a whole pass changes nothing: the formulas are first order,
// and each pass leaves about 1e-2 of the error before.
//
// Segments are found by step number and commanded angles (initial angles up to whole turns); lengths of alignments and
// dwells, rates and the times between them are free. Further steps and segments are ignored.
//
//   parameter        step  from
//   a_ii, A0i        1     mean specific force with each axis up and down (y down: the dwell at roll 180 of step 5)
//   n11 n33 n22      2 3 4   two legs of +360 and -360 deg
//   A03 A01 A02 a23 a12 a13, n21 n31 n12 n32 n23 n13   5-12   two legs of +180/-180 or +90/-90 deg
//   N01 N02 N03      13 14   600 s at rest
//
// Bad input is an Error of kind input with one line: a step or leg that is missing, a static segment that is needed and
// shorter than min_dwell_s, gravity or latitude out of range, an accelerometer axis that never stands vertical, data
// that contradict the commanded angles by more than max_misfit_deg, samples lost in a rotation that is needed.
// Not converged is not an error of the input: see `converged` and `message`.
//
// Not modelled: noise (no weights, no sigma: that is the joint estimator), anything beyond the 24 parameters.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "calib/types/status.h"

namespace turncal {

inline constexpr int closed_form_steps = 14;

// A leg goes from one static segment (alignment or dwell) of a step to the next one of the same step: levelled by the mean specific force
// over the first, with the heading commanded there, navigated on the blocks up to the end of the second,
//   C_nb(t + dt) = Exp(-w_ie dt) C_nb(t) Exp(rotation),   v_n += Exp(-w_ie dt / 2) C_nb(t) velocity - g dt U
// (n turns with the Earth while a block passes: what was gained is seen from a frame half a block later). The navigated velocity is an error of cm/s:
// no Schuler loop, no Coriolis term. In the dwell the attitude error phi is constant and V = slope * T, slope (+g phi_E, -g phi_N).
// Lost samples: at rest the block is stretched to its length, which is exact; in motion the angle is lost, an error. No glitches.
struct LegMotion {
  Eigen::Vector3d velocity_mps;     // n frame, gained in the dwell: from its first sample to its last
  double dwell_s = 0.0;             // T
  double before_dwell_s = 0.0;      // from levelling to the start of the dwell
  double heading_change_rad = 0.0;  // since levelling, clockwise; for legs that do not turn
  Eigen::Matrix3d C_nb_start;       // levelled
  Eigen::Matrix3d C_nb_arrived;     // at the start of the dwell
  double turned_rad = 0.0;          // about axis_b, signed, on the way (0 when axis_b is zero)
};

// What a step measures, and the formula that turns it into parameters, from the error equations of a unit at rest (docs/estimator.md;
// n = north, up, east; phi the attitude error, C_computed = (I - [phi x]) C; dw_b the excess reading of the calibrated gyros):
//   phi' = -w_ie x phi - C_nb dw_b,     dV_N' = +g phi_E,     dV_E' = -g phi_N
// The document's formulas are for dwells of one length T; the code takes each leg's own, V/T instead of V.
struct StepMeasurement {
  int step = 0;
  double gravity_mps2 = 0.0;
  double earth_north_radps = 0.0;  // w_N
  // Step 1: mean calibrated specific force with body axis i up and down, m/s^2, body frame.
  std::array<Eigen::Vector3d, 3> up{};
  std::array<Eigen::Vector3d, 3> down{};
  // Steps 2 to 14.
  LegMotion leg1;
  LegMotion leg2;  // steps 2 to 12
};

// Corrects the parameters that the step determines, by the derived formulas.
void correct_parameters(const StepMeasurement& measured, Parameters& parameters);

// Finds what the steps need in a recording, by step number and commanded angles. The data are checked against the
// segment list before anything is computed, so that a wrong list gives one clear line and not wrong parameters.
class ClosedFormLayout {
 public:
  // Indices into the segment list, and the turn of the table between them: about one axis, given in the body.
  struct Leg {
    std::size_t from = 0, to = 0;
    double turn_deg = 0.0;
    Eigen::Vector3d axis_b = Eigen::Vector3d::Zero();
  };
  // The recording must outlive the layout.
  explicit ClosedFormLayout(const CompressedRecording& recording);

  // Checks the site and finds steps, dwells and legs. Call it first; after an error nothing else may be called.
  Status find();
  // Checks every segment and leg that was found: long enough, at rest, the right way up, nothing lost on the way,
  // turned as commanded. `model` may be as wrong as start_parameters().
  Status check_data(const SensorModel& model) const;

  StepMeasurement measure(int step, const SensorModel& model) const;

 private:
  Status check_static(std::size_t segment, const SensorModel& model) const;
  Status check_way(const Leg& leg, const SensorModel& model) const;

  const CompressedRecording& recording_;
  const std::vector<std::size_t> first_block_;
  std::vector<std::size_t> verticals_;  // segments, in the order of `verticals` (closed_form.cpp)
  std::vector<std::vector<Leg>> legs_;  // by step number
};

// The largest difference of two parameter sets in each group of keys.
struct ParameterDistance {
  double gyro_bias_degph = 0.0;
  double accel_bias_g = 0.0;
  double gyro_matrix = 0.0;   // n, in parts of the nominal scale factor (0.93 arcsec per pulse, or 1)
  double accel_matrix = 0.0;  // a
};
ParameterDistance distance(const Parameters& one, const Parameters& other, const RecordingInfo& info);

struct ClosedFormOptions {
  int max_passes = 10;
  // Converged when a whole pass moves nothing by more than this.
  ParameterDistance tolerance = {1e-6, 1e-9, 1e-9, 1e-9};
  // Formulas in place of these: a test shows what the printed ones give.
  std::function<void(const StepMeasurement&, Parameters&)> correct = correct_parameters;
};

struct ClosedFormResult {
  Parameters parameters;
  bool converged = false;
  int passes = 0;
  std::vector<ParameterDistance> corrections;  // what each pass moved
  std::string message = "not run";
};

// `start`: start_parameters(), or anything nearer. Pure: no state, no I/O.
Result<ClosedFormResult> closed_form_calibrate(const CompressedRecording& recording, const Parameters& start,
                                               const ClosedFormOptions& options = {});

}  // namespace turncal
