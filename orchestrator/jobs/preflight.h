// What would stop a run later, looked for before anything moves: `run` refuses to begin, and `check` tells all of it.
//
// Output folder, results database and parameter store can be written; there is room for the recordings; names are short enough for
// the file system; the commands of the hooks exist and the shell can read them; the table's own file believes the positions of the plan; the table's calibration is not overdue. What is made for a try is removed again.
//
// Which of the parameters a plan would leave undetermined, found before anything moves (calib/prediction/predict.h): a run of such a
// sequence is refused unless it only captures (--capture-only) or may be estimated in part (--partial).
#pragma once

#include <string>
#include <vector>

#include "calib/model/parameters.h"
#include "calib/prediction/planned_motion.h"
#include "calib/prediction/predict.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "orchestrator/jobs/run_request.h"

namespace turncal {

// Kind device for what the storage cannot do, input for what has to be written otherwise. folder: of the run; empty: not looked at. Of `run`
// station, plan, units and the reason for an overdue table are looked at. utc_s: now.
std::vector<Error> preflight(const RunPlan& run, const std::string& folder, double utc_s);

// A plan as the pure functions of calib take it.
PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan);

// Keys of the free parameters, in their order; empty: all are determined. info: period, site and increments of the unit. The noise is
// that of a good laser-gyro unit (0.002 deg/sqrt(h), 8 ug/sqrt(Hz)); what no rotation shows stays undetermined at any noise.
// Of a plan of more than 20 000 items nothing is said, so that nobody waits for long.
std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info);

// Keys of the parameters with a number above 0 in `asked` that the prediction leaves undetermined.
std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked);

// "does not determine n11 n12: expected ...": to follow the name of the sequence.
std::string coverage_text(const std::vector<std::string>& keys);

}  // namespace turncal
