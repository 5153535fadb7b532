#include "calib/statistics/allan.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Series = std::vector<std::int64_t>;  // prefix sums of one dwell, first entry 0

// Whole counts are exact; recordings in rad or m/s are put on a grid of 1e-12.
constexpr double grid_physical = 1e-12;

std::vector<double> tau_list(std::size_t longest) {
  std::vector<double> taus;
  for (double m = 1.0; m <= static_cast<double>(longest); m *= 1.25) {
    const double whole = std::round(m);
    if (taus.empty() || whole > taus.back()) taus.push_back(whole);
  }
  return taus;
}

// Non-negative least squares for a handful of terms: drop the most negative term and solve again.
Eigen::VectorXd non_negative_fit(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  std::vector<Eigen::Index> active(A.cols());
  std::iota(active.begin(), active.end(), 0);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(A.cols());
  while (!active.empty()) {
    const Eigen::VectorXd y = least_squares(A(Eigen::all, active), b).x;
    Eigen::Index worst = 0;
    if (y.minCoeff(&worst) >= 0.0) {
      x(active) = y;
      return x;
    }
    active.erase(active.begin() + worst);
  }
  return x;
}

AllanFit fit(const std::vector<AllanPoint>& points) {
  if (points.size() < 4) return {};
  Eigen::MatrixXd A(points.size(), 4);
  Eigen::VectorXd b(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const AllanPoint& p = points[i];
    const double variance = p.deviation * p.deviation;
    // relative residuals, weighted with the square root of the clusters
    A.row(i) << 3.0 / (p.tau_s * p.tau_s), 1.0 / p.tau_s, 0.664 * 0.664, p.tau_s / 3.0;
    const double weight = std::sqrt(p.clusters);
    A.row(i) *= weight / variance;
    b[i] = weight;
  }
  const Eigen::VectorXd scale = A.colwise().norm().cwiseMax(1e-300).cwiseInverse().transpose();
  const Eigen::VectorXd x = scale.cwiseProduct(non_negative_fit(A * scale.asDiagonal(), b));
  return {std::sqrt(x[0]), std::sqrt(x[1]), std::sqrt(x[2]), std::sqrt(x[3]), points.back().tau_s};
}

}  // namespace

AllanResult allan_deviation(const CompressedRecording& recording, const Parameters& parameters, double min_dwell_s) {
  const SensorModel model = sensor_model(parameters, recording.info);
  const auto grid = [&](std::size_t axis) {
    const IncrementKind kind = axis < 3 ? recording.info.gyro_increment : recording.info.accel_increment;
    return kind == IncrementKind::pulses ? 1.0 : grid_physical;
  };
  std::array<std::vector<Series>, 6> dwells;
  double tau0 = 1.0;
  AllanResult result;
  std::array<Series, 6> open;
  const auto close = [&] {
    if (static_cast<double>(open[0].size()) * tau0 > min_dwell_s) {
      result.total_s += static_cast<double>(open[0].size() - 1) * tau0;
      for (std::size_t axis = 0; axis < 6; ++axis) dwells[axis].push_back(open[axis]);
    }
    for (Series& series : open) series.clear();
  };
  int segment = -1;
  for (const Block& block : recording.blocks) {
    const bool joins = block.whole_second && (block.segment == segment || segment < 0 || !recording.rotates(block));
    if (!block.whole_second || !joins) {
      close();
      segment = -1;
      continue;
    }
    if (open[0].empty()) {
      tau0 = block.duration_s;
      for (Series& series : open) series.push_back(0);
    }
    segment = block.segment;
    for (std::size_t axis = 0; axis < 6; ++axis) {
      const double increments = axis < 3 ? block.gyro[axis] : block.accel[axis - 3];
      open[axis].push_back(open[axis].back() + std::llround(increments / grid(axis)));
    }
  }
  close();

  for (std::size_t axis = 0; axis < 6; ++axis) {
    const std::size_t k = axis % 3;
    const double si = (axis < 3 ? model.gyro_scale(k, k) : model.accel_scale(k, k)) * grid(axis);
    std::size_t longest = 0;
    for (const Series& series : dwells[axis]) longest = std::max(longest, (series.size() - 1) / 3);
    for (const double m_real : tau_list(longest)) {
      const std::size_t m = static_cast<std::size_t>(m_real);
      double sum = 0.0;
      double count = 0.0;
      double clusters = 0.0;
      for (const Series& series : dwells[axis]) {
        if (series.size() < 3 * m + 1) continue;
        for (std::size_t i = 0; i + 2 * m < series.size(); ++i) {
          const double d = static_cast<double>(series[i + 2 * m] - 2 * series[i + m] + series[i]);
          sum += d * d;
          count += 1.0;
        }
        clusters += static_cast<double>(series.size() - 1) / static_cast<double>(m) - 1.0;
      }
      const double tau = m_real * tau0;
      if (count > 0.0 && sum > 0.0)
        result.axes[axis].points.push_back({tau, si * std::sqrt(sum / (2.0 * tau * tau * count)), clusters});
    }
    result.axes[axis].fit = fit(result.axes[axis].points);
  }
  return result;
}

}  // namespace turncal
