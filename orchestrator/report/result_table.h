// The result of a calibration as a table for people: the 24 parameters with unit and, where they are known, standard deviation,
// truth, error and error in standard deviations.
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "calib/diagnosis/diagnosis.h"
#include "calib/model/parameters.h"
#include "calib/prediction/predict.h"
#include "calib/rests/single_pose.h"
#include "imu_io/recordings/matrix_writer.h"
#include "imu_io/recordings/parameter_file.h"

namespace turncal {

void print_results(const ParameterFile& file, const std::optional<ParameterVector>& truth, std::ostream& out);

// What `turncal predict --navigate` prints: the free navigation that each sequence would allow, side by side.

// REQUIRES at least one column; each has at least one point.
void print_predicted_drift(const std::vector<std::pair<std::string, ExpectedDrift>>& columns, const DriftPlan& plan,
                           std::ostream& out);

// What a recording of one pose tells (calib/rests/single_pose.h), for the terminal and for diagnosis.conf.
std::vector<std::string> pose_table(const SinglePose& pose);
// diagnosis.conf: verdict = not_tested, `noise.*` and `coefficient.<effect>.<axis>` with their sigmas.
std::string format_pose(const SinglePose& pose);

// The residuals of a diagnosis as columns of numbers, a row a second at rest (docs/report.md).
std::vector<NumberColumn> residual_columns(const Diagnosis& diagnosis);

}  // namespace turncal
