// Finds what would stop a run, before anything moves: `run` then refuses to begin, and `check` lists all of it.
//
// Checks that output folder, results database and parameter store can be written; room for the recordings; lengths of names; that the hooks'
// commands exist and parse; positions in the table's file; the date of the table's calibration. Files made for a check are removed again.
//
// Also finds the parameters that a plan leaves undetermined (calib/prediction/predict.h). A run of such a sequence is refused unless it only
// captures (--capture-only) or may be estimated in part (--partial).
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

// Returns all errors: kind device for the storage, input for what has to be written otherwise. folder: of the run; empty: not checked. Of `run`
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
