// Finds what would stop a run later, before anything moves: `run` then refuses to begin, and `check` lists all of it.
//
// Checks that output folder, results database and parameter store can be written; there is room for the recordings; names are short
// enough for the file system; the hooks' commands exist and the shell can parse them; the table's file accepts the plan's positions; the
// table's calibration is not overdue. Files made for a check are removed again.
//
// Also finds the parameters that a plan leaves undetermined (calib/prediction/predict.h): a run of such a
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

// Errors are of kind device for the storage, input for what has to be written otherwise. folder: of the run; empty: not checked. Of `run`
// the station, plan, units and the reason for an overdue table are used. utc_s: now.
std::vector<Error> preflight(const RunPlan& run, const std::string& folder, double utc_s);

// Returns a plan in the form that the pure functions of calib take.
PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan);

// Returns the keys of the undetermined free parameters, in order. info: period, site and increments of the unit. The noise is
// that of a good laser-gyro unit (0.002 deg/sqrt(h), 8 ug/sqrt(Hz)); what no rotation excites is undetermined at any noise.
// Empty for a plan of more than 20 000 items, so that nobody waits for long.
std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info);

// Returns the keys of the parameters that have a number above 0 in `asked` and that the prediction leaves undetermined.
std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked);

// Returns "does not determine n11 n12: expected ...", to follow the name of the sequence.
std::string coverage_text(const std::vector<std::string>& keys);

}  // namespace turncal
