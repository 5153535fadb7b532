// The result of a calibration as a table for people: the 24 parameters with unit and, if known, standard deviation,
// truth, error and error in standard deviations.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/model/parameters.h"
#include "calib/prediction/predict.h"
#include "calib/rests/single_pose.h"
#include "imu_io/recordings/number_table.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/document.h"

namespace turncal {

// Returns the table; its digits follow the sigma.
Table result_table(const ParameterFile& file, const std::optional<ParameterVector>& truth);
// Returns the document of a calibration without a diagnosis: verdict, defects of the data, the table above.
Document calibration_document(const ParameterFile& file, const std::vector<std::string>& notes,
                              const std::optional<ParameterVector>& truth);
// The same verdict, and the keys of its parameter file.
Result<std::string> format_calibration(const ParameterFile& file);

// Adds what `turncal predict --navigate` prints: the expected free navigation after each sequence, side by side.
// REQUIRES at least one column; each has at least one point.
void add_predicted_drift(const std::vector<std::pair<std::string, ExpectedDrift>>& columns, const DriftPlan& plan,
                         Document& document);

// Returns what a recording of one pose tells (calib/rests/single_pose.h), for the terminal and for diagnosis.conf.
Facts pose_facts(const SinglePose& pose);
// Returns diagnosis.conf: verdict = not_tested, `noise.*` and `coefficient.<effect>.<axis>` with their sigmas.
std::string format_pose(const SinglePose& pose, const std::string& why_not_trusted);

// Returns the residuals of a diagnosis as columns of numbers, one row for each second at rest (docs/report.md).
std::vector<NumberColumn> residual_columns(const Diagnosis& diagnosis);

// The tables of `turncal predict`: sigmas side by side, undetermined directions, and the smallest detectable effects.

struct NamedPrediction {
  std::string name;  // name of the sequence
  Prediction prediction;
  double station_s = 0.0;
};

// REQUIRES at least one prediction, all of the same unit.
Table sigma_table(const std::vector<NamedPrediction>& columns, const RecordingInfo& info);
void add_undetermined(const std::vector<NamedPrediction>& columns, Document& document);
// REQUIRES predictions with the same effects.
void add_detectable(const std::vector<NamedPrediction>& columns, Document& document);

// Returns "+0.82 n12 -0.41 a12".
std::string describe(const Undetermined& direction);

}  // namespace turncal
