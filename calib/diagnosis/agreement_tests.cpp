#include "calib/diagnosis/lack_of_fit_tests.h"

#include <algorithm>
#include <cmath>

#include "calib/diagnosis/holdout.h"
#include "calib/joint/several_recordings.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

void test_recordings(const FitPass& pass, const VectorXd& ranges, LackOfFit& result) {
  const auto n = static_cast<Eigen::Index>(pass.columns.size());
  const Quadratic nothing = {MatrixXd::Zero(n, n), VectorXd::Zero(n)};
  std::vector<Quadratic> parts = {nothing};
  for (const FilterStep& step : pass.filter.steps) {
    if (step.begins_recording) parts.push_back(nothing);
    if (!step.observed) continue;
    MatrixXd N = step.N(pass.columns, Eigen::all);
    if (parts.size() > 1)
      N.topRows<6>().setZero();  // its biases are its turn-on columns: the first recording's are another matter
    parts.back().A += N * step.S_inverse * N.transpose();
    parts.back().c += N * step.S_inverse * step.nu;
  }
  if (parts.size() < 2) return;
  const Fall apart = disagreement(parts, ranges(pass.columns));
  add_test({.family = "recordings, parameters",
            .what = "parameters of the recordings against each other",
            .chi_square = apart.chi_square,
            .degrees = static_cast<double>(apart.degrees),
            .shift = {}},
           result);
}

void test_holdout(const CompressedRecording& holdout, const std::string& name, const JointResult& fit,
                  const NoiseModel& noise, const FitPass& of_fit, const LackOfFitLimits& limits, LackOfFit& result) {
  const std::vector<int>& columns = of_fit.columns;
  const JointResult model = model_on_holdout(holdout, fit, noise);
  const FitPass pass = run_fit_pass(holdout, model, model.setup);
  // Information of the fit on everything but what each recording has for itself, which is eliminated from it.
  std::vector<int> own, others;
  for (int k = 0; k < static_cast<int>(columns.size()); ++k) {
    const int column = columns[static_cast<std::size_t>(k)];
    const bool of_one =
        column < 6 || (column >= parameter_count &&
                       fit.effects[static_cast<std::size_t>(column - parameter_count)].column.entry->of_one_run);
    (of_one ? own : others).push_back(k);
  }
  const MatrixXd information = of_fit.filter.information(columns, columns);
  const MatrixXd cross = information(own, others);
  Quadratic prior = {MatrixXd::Zero(information.rows(), information.cols()), VectorXd::Zero(information.rows())};
  prior.A(others, others) =
      information(others, others) - cross.transpose() * solve_symmetric(information(own, own), cross);
  test_pieces(SegmentScores(pass.recording, pass.filter, columns, fit.reference_temperature_c, limits, prior.A),
              holdout, name + ", ", limits, result);
  const Quadratic data = {pass.filter.information(columns, columns), pass.filter.gradient(columns)};
  const VectorXd ranges = fit.ranges(columns);
  const Fall apart = disagreement({data, prior}, ranges);
  add_test({.family = name + ", parameters",
            .what = "parameters of the " + name + " against those of the fit",
            .chi_square = apart.chi_square,
            .degrees = static_cast<double>(apart.degrees),
            .shift = {}},
           result);
  // What is left then. A parameter that the fit leaves wide may be elsewhere in the holdout at no cost.
  const auto free = std::count_if(own.begin(), own.end(), [&](int k) { return data.A(k, k) > 0.0; });
  add_test({.family = name + ", level",
            .what = "error on the " + name,
            .chi_square = pass.filter.chi_square - fall_of({data.A + prior.A, data.c}, ranges).chi_square,
            .degrees = static_cast<double>(pass.filter.observations) - static_cast<double>(free),
            .inflation = std::pow(GateLimits{}.highest_error, 2),
            .shift = {}},
           result);
}

}  // namespace turncal
