// Scores of candidate columns beside a fitted rest model: what each would do to the likelihood if it were added.
//
// Rows are weighted (rest_model.h), candidate columns projected off the columns in the model. With one column c the
// residual becomes r - c (c'r)/(c'c); every kind k of observation has a variance of its own, so the gain is
//   T = sum_k [d_k log(v_k / v_k') + S_k / v_k - S_k' / v_k'],   v_k = max(S_k / d_k, share of white noise), v_k' alike,
// with S_k, S_k' the weighted sums of squares before and after and d_k the redundancy: the white noise that was
// measured is never undercut. p from F(q, d - q), F = (exp(T/d) - 1)(d - q)/q, d the redundancy of the kinds that the
// columns touch: exact for one kind (analysis of variance), and safe for few observations where chi^2 is not.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/rests/rest_model.h"

namespace turncal {

struct ColumnScore {
  bool visible = false;
  double statistic = 0.0;  // T
  double p_value = 1.0;
  double value = 0.0;  // that it would come to alone, candidate's unit
  double sigma = 0.0;
};

class RestScores {
 public:
  // `system` has the columns of the model first (model_columns of them), then the candidates. What the candidates named
  // in `nuisance` can imitate is taken off as well before the others are scored.
  RestScores(const RestSystem& system, const RestFit& fit, int model_columns, const std::vector<int>& nuisance = {});

  int candidates() const { return static_cast<int>(columns_.cols()); }
  const ColumnScore& of(int candidate) const { return scores_[static_cast<std::size_t>(candidate)]; }
  // The group together: T, p and rank on directions that are seen.
  struct Group {
    double statistic = 0.0;
    double chi_square = 0.0;  // s' Q^-1 s at the present weights
    double p_value = 1.0;
    int rank = 0;
  };
  Group group(const std::vector<int>& members) const;
  // Cosine of two projected columns: 1 when the data cannot tell them apart.
  double correlation(int a, int b) const;

 private:
  double gain(const Eigen::VectorXd& after, const std::vector<int>& members, int rank, double& p_value) const;

  const RestSystem& system_;
  std::array<double, rest_kind_count> freedom_{};
  std::array<double, rest_kind_count> white_share_{};
  Eigen::VectorXd residual_;  // weighted, projected
  Eigen::MatrixXd columns_;   // weighted, projected, of unit length; zero when not visible
  std::vector<ColumnScore> scores_;
};

}  // namespace turncal
