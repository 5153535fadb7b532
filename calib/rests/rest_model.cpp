#include "calib/rests/rest_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/model/limits.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double& floor_of(RestFloors& floors, RestKind kind) {
  return kind == RestKind::norm        ? floors.norm_mps2
         : kind == RestKind::direction ? floors.direction_rad
                                       : floors.gyro_radps;
}
double floor_of(const RestFloors& floors, RestKind kind) { return floor_of(const_cast<RestFloors&>(floors), kind); }

// The whitened Jacobian with columns of unit length: its left singular vectors give the hat matrix, its right ones the
// directions that are not seen.
struct Whitened {
  VectorXd residual;
  VectorXd column_length;
  ThinSvd svd;
  Index rank = 0;
  MatrixXd basis() const { return svd.U.leftCols(rank); }
};
Whitened whiten(const RestSystem& system, const VectorXd& weights) {
  Whitened w;
  w.residual = weights.cwiseProduct(system.residual);
  MatrixXd J = weights.asDiagonal() * system.jacobian;
  w.column_length = J.colwise().norm();
  for (Index k = 0; k < J.cols(); ++k)
    if (w.column_length[k] > 0.0)
      J.col(k) /= w.column_length[k];
    else
      w.column_length[k] = 1.0;
  w.svd = thin_svd(J, true);
  const VectorXd& s = w.svd.values;
  while (w.rank < s.size() && s[w.rank] > rest_limits.unseen_ratio * s[0]) ++w.rank;
  return w;
}

// Redundancy of each kind: rows less what the parameters take from it.
std::array<double, rest_kind_count> redundancy(const RestSystem& system, const MatrixXd& basis) {
  std::array<double, rest_kind_count> result{};
  for (Index k = 0; k < basis.rows(); ++k)
    result[static_cast<std::size_t>(system.kind[static_cast<std::size_t>(k)])] += 1.0 - basis.row(k).squaredNorm();
  return result;
}

// The floor at which sum r^2 / (white + floor^2) equals the redundancy; monotone, so bisection.
double estimate_floor(const RestSystem& system, RestKind kind, double freedom) {
  if (freedom < 0.5) return 0.0;
  double largest = 0.0;
  const auto excess = [&](double floor) {
    double sum = 0.0;
    for (Index k = 0; k < system.residual.size(); ++k) {
      if (system.kind[static_cast<std::size_t>(k)] != kind) continue;
      const double r2 = system.residual[k] * system.residual[k];
      const double variance = system.white_variance[k] + floor * floor;
      if (r2 > 0.0) sum += r2 / variance;
      largest = std::max(largest, r2);
    }
    return sum - freedom;
  };
  if (!(excess(0.0) > 0.0)) return 0.0;
  double low = 0.0;
  double high = std::sqrt(largest * static_cast<double>(system.residual.size()) / freedom);
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (excess(middle) > 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

RestFloors estimate_floors(const RestSystem& system, const std::array<double, rest_kind_count>& freedom) {
  RestFloors floors;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro})
    floor_of(floors, kind) = estimate_floor(system, kind, freedom[static_cast<std::size_t>(kind)]);
  return floors;
}

// Before anything is fitted: wide enough that no kind rules the first steps.
RestFloors start_floors(const RestSystem& system) {
  std::array<double, rest_kind_count> rows{};
  for (const RestKind kind : system.kind) rows[static_cast<std::size_t>(kind)] += 1.0;
  return estimate_floors(system, rows);
}

void apply_step(const VectorXd& step, Parameters& parameters, VectorXd& effect_values) {
  ParameterVector vector = to_vector(parameters);
  const auto& indices = rest_parameter_indices();
  for (int c = 0; c < rest_parameter_count; ++c) vector[indices[static_cast<std::size_t>(c)]] += step[c];
  parameters = from_vector(vector);
  effect_values += step.tail(step.size() - rest_parameter_count);
}

double chi_square(const RestSystem& system, const VectorXd& weights) {
  return weights.cwiseProduct(system.residual).squaredNorm();
}

// A parameter is not determined when it lies in a direction that is not seen, or is known so badly that it calibrates
// nothing: 5 % of scale, 0.1 g, 1 deg/s. (The noise of a gyro that does not turn looks like a little turning.)
void describe_unseen(const Whitened& w, const RecordingInfo& info, RestFit& fit) {
  const MatrixXd& V = w.svd.V;
  VectorXd share = VectorXd::Zero(V.rows());
  for (Index k = w.rank; k < V.cols(); ++k) share += V.col(k).cwiseAbs2();
  const Parameters nominal = start_parameters(info);
  const auto& indices = rest_parameter_indices();
  for (Index c = 0; c < V.rows(); ++c) {
    const bool parameter = c < rest_parameter_count;
    const Index where = parameter ? indices[static_cast<std::size_t>(c)] : parameter_count + c - rest_parameter_count;
    const double absurd = !parameter   ? std::numeric_limits<double>::infinity()
                          : where < 3  ? 3600.0
                          : where < 6  ? 0.1
                          : where < 15 ? 0.05 * nominal.n(0, 0)
                                       : 0.05 * nominal.a(0, 0);
    if (share[c] < 1e-3 && fit.sigma[where] < absurd) continue;
    fit.sigma[where] = std::numeric_limits<double>::quiet_NaN();
    fit.undetermined.push_back(parameter ? std::string(parameter_keys[static_cast<std::size_t>(where)])
                                         : "effect column " + std::to_string(c - rest_parameter_count));
  }
}

void finish(const RestSystem& system, const RecordingInfo& info, RestFit& fit) {
  const VectorXd weights = rest_weights(system, fit.floors);
  const Whitened w = whiten(system, weights);
  fit.redundancy = redundancy(system, w.basis());
  fit.errors = rest_errors(system, system.residual);
  const VectorXd predicted = left_out_residual(system, weights);
  fit.left_out = rest_errors(system, predicted);
  int last_owner = -1;
  for (Index k = 0; k < predicted.size(); ++k) {
    const int owner = 2 * system.owner[static_cast<std::size_t>(k)] +
                      (system.kind[static_cast<std::size_t>(k)] == RestKind::direction ? 1 : 0);
    if (std::isnan(predicted[k]) && owner != last_owner) {
      ++fit.not_predicted;
      last_owner = owner;
    }
  }
  std::array<double, rest_kind_count> sum{};
  for (Index k = 0; k < system.residual.size(); ++k)
    if (system.white_variance[k] > 0.0)
      sum[static_cast<std::size_t>(system.kind[static_cast<std::size_t>(k)])] +=
          system.residual[k] * system.residual[k] / system.white_variance[k];
  for (std::size_t k = 0; k < rest_kind_count; ++k)
    fit.white_ratio[k] = fit.redundancy[k] > 0.5 ? std::sqrt(sum[k] / fit.redundancy[k]) : 0.0;

  // (J'J)^-1 on what is seen
  const MatrixXd V = w.svd.V.leftCols(w.rank);
  const VectorXd inverse = w.svd.values.head(w.rank).cwiseInverse();
  const VectorXd sigma = (V * inverse.asDiagonal()).rowwise().norm().cwiseQuotient(w.column_length);
  fit.sigma.setZero(parameter_count + fit.effect_values.size());
  const auto& indices = rest_parameter_indices();
  for (int c = 0; c < rest_parameter_count; ++c) fit.sigma[indices[static_cast<std::size_t>(c)]] = sigma[c];
  fit.sigma.tail(fit.effect_values.size()) = sigma.tail(fit.effect_values.size());
  describe_unseen(w, info, fit);
}

}  // namespace

VectorXd rest_weights(const RestSystem& system, const RestFloors& floors) {
  VectorXd weights(system.residual.size());
  for (Index k = 0; k < weights.size(); ++k) {
    const double floor = floor_of(floors, system.kind[static_cast<std::size_t>(k)]);
    weights[k] = 1.0 / std::sqrt(std::max(system.white_variance[k] + floor * floor, 1e-24));
  }
  return weights;
}

VectorXd left_out_residual(const RestSystem& system, const VectorXd& weights) {
  const Whitened w = whiten(system, weights);
  const MatrixXd basis = w.basis();
  VectorXd predicted = VectorXd::Constant(system.residual.size(), std::numeric_limits<double>::quiet_NaN());
  const auto leave_out = [&](const std::vector<Index>& rows, auto wanted) {
    const Index n = static_cast<Index>(rows.size());
    MatrixXd part(n, basis.cols());
    VectorXd r(n);
    for (Index k = 0; k < n; ++k) {
      part.row(k) = basis.row(rows[static_cast<std::size_t>(k)]);
      r[k] = w.residual[rows[static_cast<std::size_t>(k)]];
    }
    const MatrixXd complement = MatrixXd::Identity(n, n) - part * part.transpose();
    const LeastSquares solved = least_squares(complement, r, 1e-9);
    if (solved.rank < n) return;  // without these rows a parameter is lost
    const VectorXd& e = solved.x;
    for (Index k = 0; k < n; ++k)
      if (wanted(rows[static_cast<std::size_t>(k)]))
        predicted[rows[static_cast<std::size_t>(k)]] = e[k] / weights[rows[static_cast<std::size_t>(k)]];
  };
  const auto is_direction = [&](Index k) { return system.kind[static_cast<std::size_t>(k)] == RestKind::direction; };
  int owners = 0;
  for (const int owner : system.owner) owners = std::max(owners, owner + 1);
  std::vector<std::vector<Index>> of_rest(static_cast<std::size_t>(owners));
  std::vector<std::vector<Index>> of_leg(static_cast<std::size_t>(owners));
  for (Index k = 0; k < system.residual.size(); ++k)
    (is_direction(k) ? of_leg : of_rest)[static_cast<std::size_t>(system.owner[static_cast<std::size_t>(k)])].push_back(
        k);
  for (std::size_t k = 0; k < of_rest.size(); ++k) {
    if (!of_leg[k].empty()) leave_out(of_leg[k], is_direction);
    if (of_rest[k].empty()) continue;
    std::vector<Index> rows = of_rest[k];  // with the legs that end and begin there
    if (k > 0) rows.insert(rows.end(), of_leg[k - 1].begin(), of_leg[k - 1].end());
    rows.insert(rows.end(), of_leg[k].begin(), of_leg[k].end());
    leave_out(rows, [&](Index row) { return !is_direction(row); });
  }
  return predicted;
}

RestFit refine_rests(const RestData& data, const Parameters& start, const EffectModel& effects,
                     const RestFitOptions& options) {
  RestFit fit;
  fit.parameters = start;
  fit.effect_values =
      effects.values.size() == effects.columns ? effects.values : VectorXd::Zero(effects.columns).eval();
  EffectModel model = effects;
  model.values = fit.effect_values;
  RestSystem system = make_rest_system(data, fit.parameters, model, true);
  fit.floors = options.start_floors ? *options.start_floors : start_floors(system);
  double damping = 0.0;
  for (fit.iterations = 1; fit.iterations <= options.max_iterations; ++fit.iterations) {
    const VectorXd weights = rest_weights(system, fit.floors);
    const Whitened w = whiten(system, weights);
    const VectorXd s = w.svd.values.head(w.rank);
    const VectorXd along = w.svd.U.leftCols(w.rank).transpose() * w.residual;
    const double before = chi_square(system, weights);
    // Levenberg-Marquardt in the directions that are seen; the others stay where they are.
    bool improved = false;
    double largest_move = 0.0;
    for (int attempt = 0; attempt < 12 && !improved; ++attempt) {
      const VectorXd gain = s.array() / (s.array().square() + damping);
      const VectorXd scaled = -(w.svd.V.leftCols(w.rank) * gain.cwiseProduct(along));
      const VectorXd step = scaled.cwiseQuotient(w.column_length);
      Parameters parameters = fit.parameters;
      VectorXd values = fit.effect_values;
      apply_step(step, parameters, values);
      model.values = values;
      RestSystem next = make_rest_system(data, parameters, model, true);
      largest_move = gain.cwiseProduct(s).cwiseProduct(along).norm();  // length of the step in sigmas
      if (next.residual.allFinite() && chi_square(next, weights) <= before * (1.0 + 1e-9)) {
        fit.parameters = parameters;
        fit.effect_values = values;
        system = std::move(next);
        improved = true;
        damping = damping < 1e-6 ? 0.0 : damping / 10.0;
      } else {
        damping = damping > 0.0 ? damping * 10.0 : 1e-3;
      }
    }
    if (!improved) {
      fit.message = "the residuals do not fall any further before convergence";
      break;
    }
    const RestFloors floors = estimate_floors(system, redundancy(system, w.basis()));
    double change = 0.0;
    for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro}) {
      const double was = floor_of(fit.floors, kind);
      const double is = floor_of(floors, kind);
      change = std::max(change, std::abs(is - was) / std::max({is, was, 1e-12}));
    }
    fit.floors = floors;
    if (largest_move < 1e-2 && change < 1e-3) {
      fit.converged = true;
      fit.message = "converged";
      break;
    }
    fit.message = "no convergence in " + std::to_string(options.max_iterations) + " iterations";
  }
  finish(system, data.recording->info, fit);
  return fit;
}

Result<RestFit> fit_rests(const RestData& data, const EffectModel& effects, const RestFitOptions& options) {
  Parameters start = TRY(coarse_rest_parameters(data));
  return refine_rests(data, start, effects, options);
}

}  // namespace turncal
