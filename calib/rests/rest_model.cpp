#include "calib/rests/rest_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A (m/s per increment, upper triangular) and f0 (m/s^2); none if the rests do not define an ellipsoid.
struct AccelStart {
  Matrix3d scale;
  Vector3d bias;
};
std::optional<AccelStart> ellipsoid(const RestData& data, double gravity) {
  const Eigen::Index n = data.rests.size();
  if (n < 9) return {};
  double size = 0.0;
  for (const Rest& rest : data.rests) size = std::max(size, rest.whole.accel.cwiseAbs().maxCoeff());
  if (!(size > 0.0)) return {};
  Eigen::MatrixXd M(n, 9);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Vector3d y = data.rests[k].whole.accel / size;
    M.row(k) << y.x() * y.x(), y.y() * y.y(), y.z() * y.z(), 2.0 * y.x() * y.y(), 2.0 * y.x() * y.z(),
        2.0 * y.y() * y.z(), 2.0 * y.x(), 2.0 * y.y(), 2.0 * y.z();
  }
  const LeastSquares quadric = least_squares(M, Eigen::VectorXd::Ones(n), 1e-4);
  if (quadric.rank < 9) return {};
  const Eigen::VectorXd& c = quadric.x;
  Matrix3d Q;
  Q << c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2];
  const Vector3d q(c[6], c[7], c[8]);
  // y'Qy + 2q'y = 1: centre -Q^-1 q, and (y - centre)'Q(y - centre) = 1 + centre'Q centre
  const Vector3d centre = -Q.ldlt().solve(q);
  const double level = 1.0 + centre.dot(Q * centre);
  const Eigen::LLT<Matrix3d> root(Q / level);
  if (!(level > 0.0) || root.info() != Eigen::Success) return {};
  AccelStart start;
  start.scale = Matrix3d(root.matrixU()) * (gravity / size);
  start.bias = start.scale * centre * size;
  // Far from a sphere in the increments: the fit has failed.
  const Vector3d diagonal = start.scale.diagonal();
  if (diagonal.maxCoeff() > 2.0 * diagonal.minCoeff()) return {};
  return start;
}

double direction_misfit(const RestData& data, const Parameters& parameters) {
  const EffectModel none;
  const RestSystem system = make_rest_system(data, parameters, none, false);
  double sum = 0.0;
  for (Eigen::Index k = 0; k < system.residual.size(); ++k)
    if (system.kind[k] == RestKind::direction) sum += std::pow(system.residual[k], 2);
  return sum;
}

// Accelerometers from the ellipsoid, gyro bias from the means at rest, for any common factor on the nominal gyro scale.
class CoarseStart {
 public:
  explicit CoarseStart(const RestData& data) : start_(start_parameters(data.recording->info)) {
    const RecordingInfo& info = data.recording->info;
    unit_ = si_per_unit(info);
    if (const std::optional<AccelStart> accel = ellipsoid(data, info.gravity_mps2)) {
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) start_.a(i, j) = accel->scale(i, j) / unit_[15 + 3 * i + j];
        start_.A0_g[i] = accel->bias[i] / unit_[3 + i];
      }
    }
    double total_s = 0.0;
    for (const Rest& rest : data.rests) {
      mean_ += rest.gyro_between * rest.between_s;
      total_s += rest.between_s;
    }
    mean_ /= total_s;
  }
  // rate = map * nominal scale * reading
  Parameters with_map(const Eigen::Matrix3d& map) const {
    Parameters p = start_;
    p.n = map * start_.n;
    for (int i = 0; i < 3; ++i) {
      double mean = 0.0;
      for (int j = 0; j < 3; ++j) mean += p.n(i, j) * unit_[6 + 3 * i + j] * mean_[j];
      p.N0_degph[i] = mean / unit_[i];
    }
    return p;
  }

 private:
  Parameters start_;
  ParameterVector unit_;
  Vector3d mean_ = Vector3d::Zero();
};

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The whitened Jacobian with columns of unit length: its left singular vectors give the hat matrix, its right ones the
// unobservable directions.
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

// Returns the redundancy of each kind: its rows less the parameters' share of them.
std::array<double, rest_kind_count> redundancy(const RestSystem& system, const MatrixXd& basis) {
  std::array<double, rest_kind_count> result{};
  for (Index k = 0; k < basis.rows(); ++k) result[index(system.kind[k])] += 1.0 - basis.row(k).squaredNorm();
  return result;
}

// Returns the floor at which sum r^2 / (white + floor^2) equals the redundancy; monotone, hence bisection.
double estimate_floor(const RestSystem& system, RestKind kind, double freedom) {
  if (freedom < 0.5) return 0.0;
  double largest = 0.0;
  const auto excess = [&](double floor) {
    double sum = 0.0;
    for (Index k = 0; k < system.residual.size(); ++k) {
      if (system.kind[k] != kind) continue;
      const double r2 = system.residual[k] * system.residual[k];
      const double variance = system.white_variance[k] + floor * floor;
      if (r2 > 0.0) sum += r2 / variance;
      largest = std::max(largest, r2);
    }
    return sum - freedom;
  };
  if (!(excess(0.0) > 0.0)) return 0.0;
  double low = 0.0;
  double high = std::sqrt(largest * double(system.residual.size()) / freedom);
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    (excess(middle) > 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// Returns floors before any fit, wide enough that no kind dominates the first steps.
RestFloors start_floors(const RestSystem& system) {
  std::array<double, rest_kind_count> rows{};
  for (const RestKind kind : system.kind) rows[index(kind)] += 1.0;
  return estimate_floors(system, rows);
}

void apply_step(const VectorXd& step, Parameters& parameters, VectorXd& effect_values) {
  ParameterVector vector = to_vector(parameters);
  const auto& indices = free_parameters();
  for (int c = 0; c < rest_parameter_count; ++c) vector[indices[c]] += step[c];
  parameters = from_vector(vector);
  effect_values += step.tail(step.size() - rest_parameter_count);
}

double chi_square(const RestSystem& system, const VectorXd& weights) {
  return weights.cwiseProduct(system.residual).squaredNorm();
}

// A parameter is not determined if it takes part in an unobservable direction, or its sigma exceeds any use: 5 % of
// scale, 0.1 g, 1 deg/s. (The noise of a gyro that does not turn looks like a small rotation.)
void describe_unseen(const Whitened& w, const RecordingInfo& info, RestFit& fit) {
  const MatrixXd& V = w.svd.V;
  VectorXd share = VectorXd::Zero(V.rows());
  for (Index k = w.rank; k < V.cols(); ++k) share += V.col(k).cwiseAbs2();
  const Parameters nominal = start_parameters(info);
  const auto& indices = free_parameters();
  for (Index c = 0; c < V.rows(); ++c) {
    const bool parameter = c < rest_parameter_count;
    const Index where = parameter ? indices[c] : parameter_count + c - rest_parameter_count;
    const double absurd = !parameter   ? std::numeric_limits<double>::infinity()
                          : where < 3  ? 3600.0
                          : where < 6  ? 0.1
                          : where < 15 ? 0.05 * nominal.n(0, 0)
                                       : 0.05 * nominal.a(0, 0);
    if (share[c] < 1e-3 && fit.sigma[where] < absurd) continue;
    fit.sigma[where] = std::numeric_limits<double>::quiet_NaN();
    fit.undetermined.push_back(parameter ? std::string(parameter_keys[where])
                                         : "effect column " + std::to_string(c - rest_parameter_count));
  }
}

void finish(const RestSystem& system, const RecordingInfo& info, RestFit& fit) {
  const VectorXd weights = rest_weights(system, fit.floors);
  const Whitened w = whiten(system, weights);
  fit.redundancy = redundancy(system, w.basis());
  fit.errors = rest_errors(system, system.residual);
  fit.left_out = rest_errors(system, left_out_residual(system, weights));
  std::array<double, rest_kind_count> sum{};
  for (Index k = 0; k < system.residual.size(); ++k)
    if (system.white_variance[k] > 0.0)
      sum[index(system.kind[k])] += system.residual[k] * system.residual[k] / system.white_variance[k];
  for (std::size_t k = 0; k < rest_kind_count; ++k)
    fit.white_ratio[k] = fit.redundancy[k] > 0.5 ? std::sqrt(sum[k] / fit.redundancy[k]) : 0.0;

  // (J'J)^-1 on the observable directions
  const MatrixXd V = w.svd.V.leftCols(w.rank);
  const VectorXd inverse = w.svd.values.head(w.rank).cwiseInverse();
  const VectorXd sigma = (V * inverse.asDiagonal()).rowwise().norm().cwiseQuotient(w.column_length);
  fit.sigma.setZero(parameter_count + fit.effect_values.size());
  const auto& indices = free_parameters();
  for (int c = 0; c < rest_parameter_count; ++c) fit.sigma[indices[c]] = sigma[c];
  fit.sigma.tail(fit.effect_values.size()) = sigma.tail(fit.effect_values.size());
  describe_unseen(w, info, fit);
}

}  // namespace

Result<Parameters> coarse_rest_parameters(const RestData& data) {
  std::size_t usable = 0;
  for (const RestLeg& leg : data.legs) usable += leg.fault.empty() ? 1 : 0;
  if (data.rests.size() < 4 || usable < 3)
    return input_error(
        "without table angles a calibration needs 4 rests and 3 rotations without lost samples at least; found " +
        std::to_string(data.rests.size()) + " and " + std::to_string(usable));
  const Matrix3d as_given = Matrix3d::Identity();
  constexpr double satisfied_rad = 0.1;  // Gauss-Newton converges from there
  const bool far = rest_misfit_rad(data, as_given) > satisfied_rad;
  return CoarseStart(data).with_map(as_given * (far ? best_rest_factor(data, as_given) : 1.0));
}

double best_rest_factor(const RestData& data, const Eigen::Matrix3d& gyro_map) {
  const CoarseStart start(data);
  double best = 1.0;
  double best_misfit = direction_misfit(data, start.with_map(gyro_map));
  for (double step : {0.05, 0.01}) {
    const double centre = best;
    const int reach = step > 0.02 ? 14 : 5;
    for (int k = -reach; k <= reach; ++k) {
      const double factor = centre * std::exp(k * step);
      const double misfit = direction_misfit(data, start.with_map(factor * gyro_map));
      if (misfit < best_misfit) {
        best_misfit = misfit;
        best = factor;
      }
    }
  }
  return best;
}

double rest_misfit_rad(const RestData& data, const Eigen::Matrix3d& gyro_map) {
  const double usable = double(std::ranges::count_if(data.legs, [](const RestLeg& leg) { return leg.fault.empty(); }));
  return std::sqrt(direction_misfit(data, CoarseStart(data).with_map(gyro_map)) / std::max(1.0, usable));
}

RestFloors estimate_floors(const RestSystem& system, const std::array<double, rest_kind_count>& freedom) {
  RestFloors floors;
  for (const RestKind kind : {RestKind::norm, RestKind::direction, RestKind::gyro})
    floors[index(kind)] = estimate_floor(system, kind, freedom[index(kind)]);
  return floors;
}

VectorXd rest_weights(const RestSystem& system, const RestFloors& floors) {
  VectorXd weights(system.residual.size());
  for (Index k = 0; k < weights.size(); ++k) {
    const double floor = floors[index(system.kind[k])];
    weights[k] = 1.0 / std::sqrt(std::max(system.white_variance[k] + floor * floor, 1e-24));
  }
  return weights;
}

VectorXd left_out_residual(const RestSystem& system, const VectorXd& weights) {
  const Whitened w = whiten(system, weights);
  const MatrixXd basis = w.basis();
  VectorXd predicted = VectorXd::Constant(system.residual.size(), std::numeric_limits<double>::quiet_NaN());
  const auto leave_out = [&](const std::vector<Index>& rows, auto wanted) {
    const MatrixXd part = basis(rows, Eigen::all);
    const Index n = part.rows();
    const auto solved = least_squares(MatrixXd::Identity(n, n) - part * part.transpose(), w.residual(rows), 1e-9);
    if (solved.rank < n) return;  // these rows alone determine a parameter
    for (Index k = 0; k < n; ++k)
      if (wanted(rows[k])) predicted[rows[k]] = solved.x[k] / weights[rows[k]];
  };
  const auto is_direction = [&](Index k) { return system.kind[k] == RestKind::direction; };
  int owners = 0;
  for (const int owner : system.owner) owners = std::max(owners, owner + 1);
  std::vector<std::vector<Index>> of_rest(owners), of_leg(owners);
  for (Index k = 0; k < system.residual.size(); ++k) (is_direction(k) ? of_leg : of_rest)[system.owner[k]].push_back(k);
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
                     const std::optional<RestFloors>& floors) {
  RestFit fit;
  fit.parameters = start;
  fit.effect_values =
      effects.values.size() == effects.columns ? effects.values : VectorXd::Zero(effects.columns).eval();
  EffectModel model = effects;
  model.values = fit.effect_values;
  RestSystem system = make_rest_system(data, fit.parameters, model, true);
  fit.floors = floors ? *floors : start_floors(system);
  constexpr int most_iterations = 40;
  double damping = 0.0;
  for (fit.iterations = 1; fit.iterations <= most_iterations; ++fit.iterations) {
    const VectorXd weights = rest_weights(system, fit.floors);
    const Whitened w = whiten(system, weights);
    const VectorXd s = w.svd.values.head(w.rank);
    const VectorXd along = w.svd.U.leftCols(w.rank).transpose() * w.residual;
    const double before = chi_square(system, weights);
    // Levenberg-Marquardt in the observable directions; the others stay.
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
    const RestFloors next = estimate_floors(system, redundancy(system, w.basis()));
    const double change = ((next - fit.floors).abs() / next.max(fit.floors).max(1e-12)).maxCoeff();
    fit.floors = next;
    if (largest_move < 1e-2 && change < 1e-3) {
      fit.converged = true;
      fit.message = "converged";
      break;
    }
    fit.message = "no convergence in " + std::to_string(most_iterations) + " iterations";
  }
  finish(system, data.recording->info, fit);
  return fit;
}

Result<RestFit> fit_rests(const RestData& data, const EffectModel& effects) {
  return refine_rests(data, TRY(coarse_rest_parameters(data)), effects);
}

}  // namespace turncal
