// Closed-form calibration: the fourteen steps of Wang (2020), with the formulas of docs/closed-form.md.
//
// Each step looks at one or two legs (calib/closed_form/leg_navigation.h) with the parameters that the steps before it have
// corrected, turns the velocity gained in the dwell into the parameter that made it, and corrects that parameter. The
// fourteen steps are repeated over the same recording until a whole pass changes nothing: the formulas are first order,
// and each pass leaves about 1e-2 of what was wrong before.
//
// Where things are is found in the segment list, by step number and commanded angles (initial angles up to whole
// turns); lengths of alignments and dwells, rates and the times between them are free. Further steps and segments are
// ignored.
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

#include <functional>
#include <string>
#include <vector>

#include "calib/closed_form/closed_form_formulas.h"
#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "calib/types/status.h"

namespace turncal {

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
  double min_dwell_s = 10.0;
  double max_misfit_deg = 5.0;
};

struct ClosedFormResult {
  Parameters parameters;
  bool converged = false;
  int passes = 0;
  std::vector<ParameterDistance> corrections;  // what each pass moved
  std::string message = "not run";
};

// `start`: those of Wang (start_parameters), or anything nearer. Pure: no state, no I/O.
Result<ClosedFormResult> closed_form_calibrate(const CompressedRecording& recording, const Parameters& start,
                                               const ClosedFormOptions& options = {});

// The same with other formulas in place of correct_parameters(): how a test shows what the printed ones give.
using StepCorrection = std::function<void(const StepMeasurement&, Parameters&)>;
Result<ClosedFormResult> closed_form_calibrate_with(const CompressedRecording& recording, const Parameters& start,
                                                    const ClosedFormOptions& options, const StepCorrection& correct);

}  // namespace turncal
