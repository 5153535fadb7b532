#include "calib/rests/rest_start.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

#include "calib/rests/rest_system.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// A (m/s per increment, upper triangular) and f0 (m/s^2); nothing when the rests do not make an ellipsoid.
struct AccelStart {
  Matrix3d scale;
  Vector3d bias;
};
std::optional<AccelStart> ellipsoid(const RestData& data, double gravity) {
  const Eigen::Index n = static_cast<Eigen::Index>(data.rests.size());
  if (n < 9) return {};
  double size = 0.0;
  for (const Rest& rest : data.rests) size = std::max(size, rest.whole.accel.cwiseAbs().maxCoeff());
  if (!(size > 0.0)) return {};
  Eigen::MatrixXd M(n, 9);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Vector3d y = data.rests[static_cast<std::size_t>(k)].whole.accel / size;
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
  // Far from a sphere in the increments: the fit went astray.
  const Vector3d diagonal = start.scale.diagonal();
  if (diagonal.maxCoeff() > 2.0 * diagonal.minCoeff()) return {};
  return start;
}

double direction_misfit(const RestData& data, const Parameters& parameters) {
  const EffectModel none;
  const RestSystem system = make_rest_system(data, parameters, none, false);
  double sum = 0.0;
  for (Eigen::Index k = 0; k < system.residual.size(); ++k)
    if (system.kind[static_cast<std::size_t>(k)] == RestKind::direction) sum += std::pow(system.residual[k], 2);
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
  Parameters with_factor(double factor) const { return with_map(factor * Eigen::Matrix3d::Identity()); }

 private:
  Parameters start_;
  ParameterVector unit_;
  Vector3d mean_ = Vector3d::Zero();
};

}  // namespace

Result<Parameters> coarse_rest_parameters(const RestData& data) {
  std::size_t usable = 0;
  for (const RestLeg& leg : data.legs) usable += leg.fault.empty() ? 1 : 0;
  if (data.rests.size() < 4 || usable < 3)
    return input_error(
        "calibration with unknown angles wants at least 4 rests and 3 rotations without lost samples; found " +
        std::to_string(data.rests.size()) + " and " + std::to_string(usable));
  const CoarseStart start(data);
  // Coarse steps over a factor of two either way, then finer around the best.
  double best = 1.0;
  double best_misfit = direction_misfit(data, start.with_factor(1.0));
  const double satisfied = static_cast<double>(usable) * 0.1 * 0.1;  // rad^2: Gauss-Newton finds the rest of the way
  if (best_misfit > satisfied) {
    for (double step : {0.05, 0.01}) {
      const double centre = best;
      const int reach = step > 0.02 ? 14 : 5;
      for (int k = -reach; k <= reach; ++k) {
        const double factor = centre * std::exp(k * step);
        const double misfit = direction_misfit(data, start.with_factor(factor));
        if (misfit < best_misfit) {
          best_misfit = misfit;
          best = factor;
        }
      }
    }
  }
  return start.with_factor(best);
}

double rest_misfit_rad(const RestData& data, double gyro_factor) {
  return rest_misfit_rad(data, gyro_factor * Eigen::Matrix3d::Identity());
}

double rest_misfit_rad(const RestData& data, const Eigen::Matrix3d& gyro_map) {
  const double usable = static_cast<double>(
      std::count_if(data.legs.begin(), data.legs.end(), [](const RestLeg& leg) { return leg.fault.empty(); }));
  return std::sqrt(direction_misfit(data, CoarseStart(data).with_map(gyro_map)) / std::max(1.0, usable));
}

}  // namespace turncal
