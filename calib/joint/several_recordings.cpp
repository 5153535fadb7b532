#include "calib/joint/several_recordings.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/model/limits.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

constexpr int biases = 6;

// Where the column of a recording stands among all: those of the first, then six biases of every further one.
int place(int column, std::size_t recording) {
  if (column >= biases || recording == 0) return column;
  return parameter_count + biases * static_cast<int>(recording - 1) + column;
}

struct Whole {
  std::vector<int> subset;  // of all columns
  Eigen::VectorXd begin;    // where the sums are about
  Eigen::VectorXd ranges;
  std::vector<Quadratic> parts;
  Quadratic sum;
};

Quadratic sum_of(const std::vector<Quadratic>& parts) {
  Quadratic sum = parts.front();
  for (std::size_t k = 1; k < parts.size(); ++k) {
    sum.A += parts[k].A;
    sum.c += parts[k].c;
  }
  return sum;
}

Eigen::VectorXd own(const Eigen::VectorXd& all, const JointResult& estimate, std::size_t recording) {
  Eigen::VectorXd values(static_cast<Eigen::Index>(estimate.free.size()));
  for (std::size_t i = 0; i < estimate.free.size(); ++i)
    values[static_cast<Eigen::Index>(i)] = all[place(estimate.free[i], recording)];
  return values;
}

Whole add_up(const std::vector<JointResult>& estimates) {
  const Eigen::Index columns = parameter_count + biases * (static_cast<Eigen::Index>(estimates.size()) - 1);
  Whole w;
  w.begin.setZero(columns);
  w.ranges.setOnes(columns);
  const Quadratic nothing = {Eigen::MatrixXd::Zero(columns, columns), Eigen::VectorXd::Zero(columns)};
  w.begin.head<parameter_count>() = to_vector(estimates.front().parameters);
  for (std::size_t k = 0; k < estimates.size(); ++k)
    for (int column = 0; column < biases; ++column) {
      w.begin[place(column, k)] = to_vector(estimates[k].parameters)[column];
      w.ranges[place(column, k)] = estimates[k].ranges[column];
    }
  w.ranges.segment(biases, parameter_count - biases) =
      estimates.front().ranges.segment(biases, parameter_count - biases);
  for (std::size_t k = 0; k < estimates.size(); ++k) {
    const JointResult& e = estimates[k];
    const ParameterVector at = to_vector(e.parameters);
    const Eigen::MatrixXd I = information_of(e);
    const Eigen::VectorXd g =
        Eigen::VectorXd(e.last.gradient(e.free)) + I * (own(w.begin, e, k) - Eigen::VectorXd(at(e.free)));
    std::vector<int> places;
    for (const int column : e.free) places.push_back(place(column, k));
    Quadratic& part = w.parts.emplace_back(nothing);
    part.A(places, places) = I;
    part.c(places) = g;
  }
  w.sum = sum_of(w.parts);
  for (int column = 0; column < columns; ++column)
    if (w.sum.A(column, column) > 0.0) w.subset.push_back(column);
  return w;
}

}  // namespace

Eigen::MatrixXd information_of(const JointResult& e) {
  if (!e.undetermined.empty()) return e.last.information(e.free, e.free);
  const Eigen::VectorXd scale = e.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlation = scale.asDiagonal() * e.covariance * scale.asDiagonal();
  const Eigen::MatrixXd inverse = solve_symmetric(correlation, Eigen::MatrixXd(scale.asDiagonal()));
  return scale.asDiagonal() * inverse;
}

JointResult estimate_beside(const CompressedRecording& recording, const Parameters& known) {
  JointOptions options;
  options.start = known;
  options.free_parameters = {0, 1, 2, 3, 4, 5};
  JointResult e = joint_estimate(recording, options);
  if (!e.converged) return e;
  e.free.clear();
  for (int k = 0; k < parameter_count; ++k)
    if (parameter_is_free[static_cast<std::size_t>(k)]) e.free.push_back(k);
  const SubsetSolution solution = solve_subset(e.last.information, e.last.gradient, e.free, e.ranges);
  e.covariance = solution.covariance;
  e.unseen_instability.setZero(e.covariance.rows(), e.covariance.cols());
  e.undetermined.assign(static_cast<std::size_t>(solution.undetermined.cols()), {});
  for (std::size_t i = 0; i < e.free.size(); ++i)
    e.determined[static_cast<std::size_t>(e.free[i])] = solution.lost[i] == 0;
  return e;
}

TurnOns turn_ons_of(const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance) {
  TurnOns result;
  const Eigen::Index count = values.size() / biases;
  const double n = static_cast<double>(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    result.biases.emplace_back(values.segment<biases>(biases * k));
    result.sigma.emplace_back(covariance.diagonal().segment<biases>(biases * k).cwiseMax(0.0).cwiseSqrt());
    result.mean += result.biases.back() / n;
  }
  if (count < 2) return result;
  Biases excess = Biases::Zero();
  for (std::size_t k = 0; k < result.biases.size(); ++k)
    excess += (result.biases[k] - result.mean).cwiseAbs2() / (n - 1.0) - result.sigma[k].cwiseAbs2() / n;
  result.repeatability = excess.cwiseMax(0.0).cwiseSqrt();
  return result;
}

Fall fall_of(const Quadratic& q, const Eigen::VectorXd& ranges) {
  std::vector<int> known;
  for (int k = 0; k < static_cast<int>(q.c.size()); ++k)
    if (q.A(k, k) > 0.0) known.push_back(k);
  const SubsetSolution solution = solve_subset(q.A, q.c, known, ranges);
  return {-solution.step.dot(Eigen::VectorXd(q.c(known))),
          static_cast<int>(known.size()) - static_cast<int>(solution.undetermined.cols())};
}

Fall disagreement(const std::vector<Quadratic>& parts, const Eigen::VectorXd& ranges) {
  Fall apart;
  for (const Quadratic& part : parts) {
    const Fall alone = fall_of(part, ranges);
    apart.chi_square += alone.chi_square;
    apart.degrees += alone.degrees;
  }
  const Fall together = fall_of(sum_of(parts), ranges);
  return {apart.chi_square - together.chi_square, apart.degrees - together.degrees};
}

SeveralRecordings combine_recordings(const std::vector<JointResult>& estimates) {
  const Whole w = add_up(estimates);
  const SubsetSolution solution = solve_subset(w.sum.A, w.sum.c, w.subset, w.ranges);
  Eigen::VectorXd all = w.begin;
  all(w.subset) += solution.step;
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(all.size(), all.size());
  covariance(w.subset, w.subset) = solution.covariance;

  SeveralRecordings result;
  const double n = static_cast<double>(estimates.size());
  const Fall apart = disagreement(w.parts, w.ranges);
  result.disagreement = apart.chi_square;
  result.degrees = apart.degrees;
  result.p_value = chi_square_tail(result.disagreement, result.degrees);
  result.agree = result.p_value > agreement_limits.chance;
  if (!result.agree) covariance *= result.disagreement / std::max(result.degrees, 1);

  // The mean of the biases and the common parameters, as one linear map of all columns.
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(parameter_count, all.size());
  for (int column = 0; column < parameter_count; ++column)
    for (std::size_t k = 0; k < (column < biases ? estimates.size() : 1); ++k)
      T(column, place(column, k)) = column < biases ? 1.0 / n : 1.0;
  const ParameterVector mean = T * all;
  Eigen::MatrixXd of_unit = T * covariance * T.transpose();
  std::vector<int> of_each;
  for (std::size_t k = 0; k < estimates.size(); ++k)
    for (int column = 0; column < biases; ++column) of_each.push_back(place(column, k));
  result.turn_ons = turn_ons_of(all(of_each), covariance(of_each, of_each));
  of_unit.diagonal().head<biases>() += result.turn_ons.repeatability.cwiseAbs2() / n;

  JointResult& unit = result.unit = estimates.front();
  unit.parameters = from_vector(mean);
  unit.covariance = of_unit(unit.free, unit.free);
  unit.undetermined.clear();
  for (const int column : unit.free) {
    bool determined = true;
    for (std::size_t i = 0; i < w.subset.size(); ++i)
      for (std::size_t k = 0; k < estimates.size(); ++k)
        if (w.subset[i] == place(column, k) && solution.lost[i] != 0) determined = false;
    unit.determined[static_cast<std::size_t>(column)] = determined;
    unit.sigma[column] = determined ? std::sqrt(of_unit(column, column)) : 0.0;
  }
  return result;
}

}  // namespace turncal
