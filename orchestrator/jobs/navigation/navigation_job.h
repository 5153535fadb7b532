// Navigates a recording freely with one or two parameter files, from its samples to the report.
//
// A table turns the unit about a fixed point, so the whole walk is navigated, turns included, and any displacement is error. Branches
// navigate the same recording from other starts, spread evenly over the time that leaves each its full length; each begins
// at the next rest.
//
// Effects of a diagnosis are valued by navigating a recording freely with the 24 parameters estimated alone, with those of the extended
// model and its effects subtracted, and without each effect. An effect's worth is the radial rate of the distance between the tracks with all
// effects and without that one. Noise is the same in both and cancels. The parameters p and the other effects are then those that
// would have been estimated without it,
//   p' = p - P_pe P_ee^-1 e      (P the covariance of the joint estimate, e the effect's components; least squares with e = 0)
// Units of the catalogue and of the parameter file throughout.
#pragma once

#include <string>

#include "calib/evidence/diagnosis.h"
#include "calib/navigation/free_navigation.h"
#include "calib/types/status.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/report/navigation_report.h"
#include "orchestrator/report/report.h"

namespace turncal {

// Errors: kind input for unusable files, and for a recording that is too short or has no rest.
Result<NavigationReport> navigate_recording(const NavigationRequest& request);

// Reads the reference of `turncal navigate`: a table with the columns time_s, latitude_deg, longitude_deg and, where known, height_m,
// velocity_north_mps and velocity_east_mps. Text (CSV) or .mat; the names are those of track.csv.
// Errors, kind input: file, line, and what was expected.
Result<ReferenceTrack> read_reference(const std::string& path);

// Values effects on the blocks of a recording; `recording` is its path. Errors: it is too short, or has no rest.
// REQUIRES that effects were added.
Result<NavigationWorth> worth_of_effects(const Diagnosis& diagnosis, const DiagnosisContext& context,
                                         const std::string& recording, const CompressedRecording& blocks);

// The extended model with one of its effects held at zero. `covariance`: of the fit, not widened; its rows are extended.free.
struct ModelWithout {
  ParameterVector parameters;
  std::vector<double> effects;  // as JointResult::effects; 0 for those of `name`
};
ModelWithout model_without(const JointResult& extended, const Eigen::MatrixXd& covariance, const std::string& name);

}  // namespace turncal
