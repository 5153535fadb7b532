// Would a planned motion separate confounded effects? For one unit, after a recording that did not.
//
// One filter pass over the recording, and one over the ideal recording of the plan, give the information of [parameters, effects beside, every
// component of the members]. Two recordings of one unit add:
//   A = A_1 + A_2,   with six biases for each of them, and a column for each of an effect of one run (several_recordings.h)
// A motion recorded in the same run has the same biases. The continuity of attitude and of an effect of the run is ignored, which understates the
// information. With everything else eliminated (score_algebra.h), member i of true value v_i is separated from member j by
//   2 ln L = v_i^2 Q_ii (1 - R_i.j^2)          R_i.j: multiple correlation of i with the components of j
// in the mean, with a scatter of twice its root. A name leaves the class when it explains less by 10 (bic_margin of limits.h); an expected 30
// exceeds that in 97 of 100 recordings. v_i: the estimate of i in place of the chosen one, less a sigma, since it is the largest by chance.
//
// Units: values in those of docs/diagnosis.md. The plan's temperature is the recording's last.
#pragma once

#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/prediction/planned_motion.h"

namespace turncal {

inline constexpr double separating_gain = 30.0;
// Returns the probability that a name leaves the class at this expected 2 ln L.
double chance_to_tell(double gain);

struct AliasPair {
  std::string truth, other;  // names of effects
  double gain = 0.0;         // expected 2 ln L; separating_gain is enough
  double correlation = 1.0;
};

class Separation {
 public:
  // `diagnosis` is of `recording`, `name` one of its effects. Both must outlive this. same_run: the motions are recorded in the run of `recording`.
  Separation(const CompressedRecording& recording, const Diagnosis& diagnosis, const std::string& name,
             bool same_run = false);

  const std::vector<std::string>& members() const { return names_; }  // the chosen one first
  // Pairs the chosen one with each other, either being true, beside what the recording tells; null motion: nothing more is recorded.
  std::vector<AliasPair> pairs(const PlannedMotion* motion, double sample_period_s) const;

 private:
  Eigen::MatrixXd information_of(const PlannedMotion& motion, double sample_period_s) const;

  const bool same_run_;
  const CompressedRecording& recording_;
  const Diagnosis& diagnosis_;
  std::vector<EffectColumn> beside_, columns_;  // in order, behind the parameters
  Eigen::VectorXd beside_values_;
  std::vector<std::string> names_;
  std::vector<int> strongest_;             // one per member, into columns_
  std::vector<std::vector<int>> members_;  // into columns_
  std::vector<double> values_;
  Eigen::MatrixXd information_;
  double last_temperature_c_ = 0.0;
};

}  // namespace turncal
