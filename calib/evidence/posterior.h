// Which terms a recording asks for, and what the parameters are then: an average over models.
//
// A model h is a set of terms, each with a size. About the fit everything is linear and Gaussian, so taking in one more term changes
//   Q <- Q - Q B (Q_B + 1/v)^-1 B'Q,   s <- s - Q B (Q_B + 1/v)^-1 s_B
// and the log evidence by s_B' (Q_B + 1/v)^-1 s_B / 2 - log det(1 + v Q_B) / 2 (Harville 1977; Kass and Raftery 1995): the evidence of a set is a
// sum of steps, and a term that explains what another explained takes it away. The search goes level by level: every term at every size is
// scored beside each of the best models, all of these count in the average, and the best are gone on with (Hoeting et al., Bayesian
// model averaging, Stat. Sci. 14 (1999) 382).
//
// No shape is exact, and where a term is strong what it leaves would pass for further things. So what it does in each piece may be off by a
// part of itself, independently: beside x = B L z (its mean) stand the columns C = [c_1 0 ..; 0 c_2 ..], c_k the unit of its quantity times
// the rms of what x is there and over all pieces, with coefficients ~ N(0, inexactness^2 1), of which a grid has equal odds. An effect that is
// off by 0.3 of itself and more is not its formula, and what is off by all of itself has no driver: so probable is what is said of both.
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
  int inexact = 0;  // of `inexactness`: the most probable
  // How likely it is exact enough to be its formula, and to go with its driver at all.
  double formula = 1.0, driver = 1.0;
  friend bool operator==(const ModelTerm& a, const ModelTerm& b) {
    return std::tie(a.term, a.size, a.inexact) == std::tie(b.term, b.size, b.inexact);
  }
  friend bool operator<(const ModelTerm& a, const ModelTerm& b) {
    return std::tie(a.term, a.size, a.inexact) < std::tie(b.term, b.size, b.inexact);
  }
};

struct WeighedModel {
  std::vector<ModelTerm> terms;  // sorted
  std::size_t noise = 0;         // of which UnderNoise
  double probability = 0.0;
};

struct Posterior {
  std::vector<WeighedModel> models;  // the most probable first
  double log_evidence = 0.0;         // of all of them together, but for a constant
};
// All models worth counting at one noise, by their terms. `elsewhere`: the log weight of the most probable model at another noise.
using LogWeights = std::map<std::vector<ModelTerm>, double>;
LogWeights weigh_models(const UnderNoise& under, double elsewhere = -1e300);
Posterior posterior_of(const std::vector<LogWeights>& at_each_noise);
// So many of the most probable ones are averaged over.
std::size_t averaged_models(const Posterior& posterior);
Statements statements_of(const std::vector<UnderNoise>& all, const Posterior& posterior);

// What a model leaves of the system: Q|h = Q - Y Y', s|h = s - Y w.
struct Explained {
  Eigen::MatrixXd Y;
  Eigen::VectorXd w;
};
Explained explained_by(const UnderNoise& under, const WeighedModel& model);

// Names carry what is missing where it is more likely than not that nothing else is.
inline constexpr double carried_by_names = 0.5;

// Effects that stand for all that is missing, and what the recording cannot tell from them.
struct NamedEffects {
  std::vector<EffectColumn> columns;  // their time constants are means over the variants, by their probability
  double probability = 0.0;  // that nothing else is missing but for what is said by other names of the same branch
  // Of the name of each effect: other formulas that models without it hold, with the probability of those.
  std::map<std::string, std::map<std::string, double>> instead;
};
// `fitted`: keys that stay where another one is hardly more probable.
NamedEffects named_effects(const std::vector<UnderNoise>& all, const Posterior& posterior,
                           const std::vector<std::string>& fitted = {});

// Of the parameters where the named effects are zero, from the fit, and after them the values of the `named` effects. Of the mixture over the models
// the median and half of the central 68 % are taken, and the correlations. In a model without a named effect the parameter is what it is over the
// whole recording: with a name that is in doubt it hangs on the name, and its sigma says so. Values are those of models with all names.
struct AveragedEstimate {
  Eigen::VectorXd shift, sigma;
  Eigen::MatrixXd covariance;
  Eigen::VectorXd taken_up;  // what a parameter, as it is over the whole recording, has of the named effects
  Eigen::VectorXd far_off;   // of each parameter: the probability that it is off by more than far_sigmas
};
inline constexpr double far_sigmas = 4.5;
// "a33 is off by more than 4.5 sigma with a probability of 0.06"; empty: no parameter is, with 95 % and more. `columns`: of the averages.
std::string hangs_on_a_name(const AveragedEstimate& estimate, const std::vector<int>& columns);
AveragedEstimate average_over_models(const std::vector<UnderNoise>& under, const Posterior& posterior,
                                     const std::vector<EffectColumn>& named);

}  // namespace turncal
