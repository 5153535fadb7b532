// The posterior over sets of missing terms, and the parameters averaged over it.
//
// A model h is a set of terms, each with a size. About the fit everything is linear and Gaussian, so adding one term changes
//   Q <- Q - Q B (Q_B + 1/v)^-1 B'Q,   s <- s - Q B (Q_B + 1/v)^-1 s_B
// and the log evidence by s_B' (Q_B + 1/v)^-1 s_B / 2 - log det(1 + v Q_B) / 2 (Harville 1977; Kass and Raftery 1995). The evidence of a set is a sum
// of such steps, and a term gains nothing where another has explained the same. The search goes level by level: every term at every size is scored
// beside each of the best models; all of these count in the average, and the best are extended (Hoeting et al., Bayesian model averaging, Stat. Sci.
// 14 (1999) 382).
//
// No shape is exact, and what a strong term leaves unexplained would pass for further terms. So its effect on each piece may be wrong by a part of
// itself, independently: beside its mean x = B L z stand the columns C = [c_1 0 ..; 0 c_2 ..], c_k the unit of its quantity times the rms of x in
// that piece and over all pieces, with coefficients ~ N(0, inexactness^2 1) on a grid of equal odds. An effect that is wrong by 0.3 of itself or
// more does not follow its formula; one wrong by all of itself does not follow its driver. ModelTerm holds the probabilities of both.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "calib/evidence/terms.h"

namespace turncal {

inline constexpr std::array<double, 6> inexactness = {0.0, 0.03, 0.1, 0.3, 1.0, 3.0};

struct ModelTerm {
  int term = 0, size = 0;
  int inexact = 0;  // most probable index into `inexactness`
  // Probabilities that it follows its formula, and that it follows its driver at all.
  double formula = 1.0, driver = 1.0;
  double explained = 0.0;  // log evidence that it gained when it was added
  friend bool operator==(const ModelTerm& a, const ModelTerm& b) {
    return std::tie(a.term, a.size, a.inexact) == std::tie(b.term, b.size, b.inexact);
  }
  friend bool operator<(const ModelTerm& a, const ModelTerm& b) {
    return std::tie(a.term, a.size, a.inexact) < std::tie(b.term, b.size, b.inexact);
  }
};

struct WeighedModel {
  std::vector<ModelTerm> terms;  // sorted
  std::size_t noise = 0;         // index of its UnderNoise
  double probability = 0.0;
};

struct Posterior {
  std::vector<WeighedModel> models;  // most probable first
  double log_evidence = 0.0;         // of all models together, up to a constant
};
// Returns the log weight of every model worth counting at one noise. `elsewhere`: that of the most probable model at another noise.
using LogWeights = std::map<std::vector<ModelTerm>, double>;
LogWeights weigh_models(const UnderNoise& under, double elsewhere = -1e300);
Posterior posterior_of(const std::vector<LogWeights>& at_each_noise);
// Returns how many of the most probable models are averaged over.
std::size_t averaged_models(const Posterior& posterior);
Statements statements_of(const std::vector<UnderNoise>& all, const Posterior& posterior);

// What a model leaves of the system: Q|h = Q - Y Y', s|h = s - Y w.
struct Explained {
  Eigen::MatrixXd Y;
  Eigen::VectorXd w;
};
Explained explained_by(const UnderNoise& under, const WeighedModel& model);

// Names account for what is missing if the probability that nothing else is missing is above this.
inline constexpr double carried_by_names = 0.5;

// The effects that stand for all that is missing, and those that the recording cannot separate from them.
struct NamedEffects {
  std::vector<EffectColumn> columns;  // time constants: means over the variants, weighted by probability
  double probability = 0.0;           // that all that is missing has these names, or others of their branches
  // By effect name: other formulas held by models without that effect, with the probability of these models.
  std::map<std::string, std::map<std::string, double>> instead;
};
// `fitted`: keys that stay unless another one is clearly more probable.
NamedEffects named_effects(const std::vector<UnderNoise>& all, const Posterior& posterior,
                           const std::vector<std::string>& fitted = {});

// The shift of the parameters from the fit, at zero named effects, then the values of the `named` effects. Shift and sigma are the median and
// half the central 68 % of the mixture over the models. In a model without a named effect a parameter has its value over the whole recording,
// so a doubtful name widens its sigma. Effect values and correlations are those of the models that hold all names.
struct AveragedEstimate {
  Eigen::VectorXd shift, sigma;
  Eigen::MatrixXd covariance;
  Eigen::VectorXd taken_up;  // value over the whole recording less the value at zero named effects
  Eigen::VectorXd far_off;   // by parameter: probability of an error above far_sigmas
};
inline constexpr double far_sigmas = 4.5;
// Returns "a33 is off by more than 4.5 sigma with a probability of 0.06"; empty: no parameter is, with 95 % or more. `columns`: of the averages.
std::string hangs_on_a_name(const AveragedEstimate& estimate, const std::vector<int>& columns);
AveragedEstimate average_over_models(const std::vector<UnderNoise>& under, const Posterior& posterior,
                                     const std::vector<EffectColumn>& named);

}  // namespace turncal
