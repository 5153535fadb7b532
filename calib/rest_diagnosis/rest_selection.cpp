#include "calib/rest_diagnosis/rest_selection.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/statistics/distributions.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

RestScores::RestScores(const RestSystem& system, const RestFit& fit, int model_columns,
                       const std::vector<int>& nuisance)
    : system_(system) {
  const VectorXd weights = rest_weights(system, fit.floors);
  freedom_ = fit.redundancy;
  std::array<double, rest_kind_count> rows{};
  for (Index k = 0; k < weights.size(); ++k) {
    const auto kind = static_cast<std::size_t>(system.kind[static_cast<std::size_t>(k)]);
    white_share_[kind] += std::min(1.0, system.white_variance[k] * weights[k] * weights[k]);
    rows[kind] += 1.0;
  }
  for (std::size_t k = 0; k < rest_kind_count; ++k)
    if (rows[k] > 0.0) white_share_[k] = std::max(white_share_[k] / rows[k], 1e-6);

  const MatrixXd J = weights.asDiagonal() * system.jacobian;
  MatrixXd base = J.leftCols(model_columns);
  for (Index k = 0; k < base.cols(); ++k) base.col(k) /= std::max(base.col(k).norm(), 1e-300);
  MatrixXd Q = column_space(base);
  if (!nuisance.empty()) {
    MatrixXd extra(J.rows(), static_cast<Index>(nuisance.size()));
    for (std::size_t k = 0; k < nuisance.size(); ++k) {
      const VectorXd column = J.col(model_columns + nuisance[k]);
      const VectorXd left = column - Q * (Q.transpose() * column);
      extra.col(static_cast<Index>(k)) = left / std::max(column.norm(), 1e-300);
    }
    const ThinSvd svd = thin_svd(extra);
    Index rank = 0;
    while (rank < extra.cols() && svd.values[rank] > rest_limits.nuisance_floor * svd.values[0]) ++rank;
    const MatrixXd U = svd.U.leftCols(rank);
    for (Index k = 0; k < U.rows(); ++k)
      freedom_[static_cast<std::size_t>(system.kind[static_cast<std::size_t>(k)])] -= U.row(k).squaredNorm();
    Q.conservativeResize(Eigen::NoChange, Q.cols() + rank);
    Q.rightCols(rank) = U;
  }
  const auto project = [&](const auto& x) { return (x - Q * (Q.transpose() * x)).eval(); };
  residual_ = project(weights.cwiseProduct(system.residual).eval());
  const MatrixXd raw = J.rightCols(J.cols() - model_columns);
  columns_ = project(raw);
  scores_.resize(static_cast<std::size_t>(columns_.cols()));
  for (Index k = 0; k < columns_.cols(); ++k) {
    ColumnScore& score = scores_[static_cast<std::size_t>(k)];
    const double before = raw.col(k).norm();
    const double length = columns_.col(k).norm();
    if (!(before > 0.0) || length < rest_limits.unseen_part * before) {
      columns_.col(k).setZero();
      continue;
    }
    columns_.col(k) /= length;
    score.visible = true;
    score.sigma = 1.0 / length;
    const double along = columns_.col(k).dot(residual_);
    score.value = -along / length;
    const VectorXd after = residual_ - columns_.col(k) * along;
    score.statistic = gain(after, {static_cast<int>(k)}, 1, score.p_value);
  }
}

double RestScores::gain(const VectorXd& after, const std::vector<int>& members, int rank, double& p_value) const {
  std::array<double, rest_kind_count> s0{}, s1{}, touched{};
  double length = 0.0;
  for (Index k = 0; k < after.size(); ++k) {
    const auto kind = static_cast<std::size_t>(system_.kind[static_cast<std::size_t>(k)]);
    s0[kind] += residual_[k] * residual_[k];
    s1[kind] += after[k] * after[k];
    for (const int member : members) {
      touched[kind] += columns_(k, member) * columns_(k, member);
      length += columns_(k, member) * columns_(k, member);
    }
  }
  double total = 0.0;
  double freedom = 0.0;
  for (std::size_t k = 0; k < rest_kind_count; ++k) {
    const double d = freedom_[k];
    if (d < 1.0) {
      total += s0[k] - s1[k];
      continue;
    }
    const double before = std::max(s0[k] / d, white_share_[k]);
    const double variance = std::max(s1[k] / d, white_share_[k]);
    total += d * std::log(before / variance) + s0[k] / before - s1[k] / variance;
    if (touched[k] > rest_limits.touched_share * length) freedom += d;
  }
  total = std::max(total, 0.0);
  const double left = freedom - rank;
  p_value = left < 1.0 ? 1.0 : f_tail(std::expm1(total / freedom) * left / rank, rank, left);
  return total;
}

RestScores::Group RestScores::group(const std::vector<int>& members) const {
  Group result;
  std::vector<int> seen;
  for (const int k : members)
    if (of(k).visible) seen.push_back(k);
  if (seen.empty()) return result;
  MatrixXd part(residual_.size(), static_cast<Index>(seen.size()));
  for (std::size_t k = 0; k < seen.size(); ++k) part.col(static_cast<Index>(k)) = columns_.col(seen[k]);
  const ThinSvd svd = thin_svd(part);
  while (result.rank < svd.values.size() && svd.values[result.rank] > 1e-3) ++result.rank;
  const MatrixXd U = svd.U.leftCols(result.rank);
  const VectorXd along = U.transpose() * residual_;
  result.chi_square = along.squaredNorm();
  result.statistic = gain(residual_ - U * along, seen, result.rank, result.p_value);
  return result;
}

double RestScores::correlation(int a, int b) const { return std::abs(columns_.col(a).dot(columns_.col(b))); }

}  // namespace turncal
