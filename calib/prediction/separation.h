// Would a planned motion tell confounded effects apart? For one unit, after a recording that did not.
//
// One filter pass over the recording, and one over the ideal recording of the plan, give the information of [parameters, effects beside, every
// component of the members]. Two recordings of one unit add:
//   A = A_1 + A_2,   with six biases for each of them, and a column for each of an effect of one run (several_recordings.h)
// What is recorded on in the same run has the same biases; how an attitude goes on, and an effect of the run, is left out: that is less than there is.
// With what is not in question eliminated (score_algebra.h), member i of true value v_i would be told from member j by
//   2 ln L = v_i^2 Q_ii (1 - R_i.j^2)          R_i.j: multiple correlation of i with the components of j
// in the mean, with a scatter of twice its root. A name leaves the class when what it explains is less by 10 (name_aliases), and 30 are above
// that in 97 of 100 recordings. v_i: what the recording says i comes to in the place of the one chosen, less a sigma: it is the largest by chance.
//
// Units: values in those of docs/diagnosis.md. The plan's temperature is the recording's last.
#pragma once

#include <string>
#include <vector>

#include "calib/evidence/diagnosis.h"
#include "calib/prediction/planned_motion.h"

namespace turncal {

inline constexpr double separating_gain = 30.0;
// That a name leaves the class where this 2 ln L is expected.
double chance_to_tell(double gain);

struct AliasPair {
  std::string truth, other;  // names of effects
  double gain = 0.0;         // of 2 ln L, expected; separating_gain is enough
  double correlation = 1.0;
};

class Separation {
 public:
  // `diagnosis` is of `recording`, `name` one of its effects. Both must outlive this. same_run: the motions are recorded in the run of `recording`.
  Separation(const CompressedRecording& recording, const Diagnosis& diagnosis, const std::string& name,
             bool same_run = false);

  const std::vector<std::string>& members() const { return names_; }  // the chosen one first
  // Of the chosen one with each of the others, either being the truth, beside what the recording says already; motion at `sample_period_s`; nullptr: nothing more is recorded.
  std::vector<AliasPair> pairs(const PlannedMotion* motion, double sample_period_s) const;

 private:
  Eigen::MatrixXd information_of(const PlannedMotion& motion, double sample_period_s) const;

  const bool same_run_;
  const CompressedRecording& recording_;
  const Diagnosis& diagnosis_;
  std::vector<EffectColumn> beside_, columns_;  // as they follow the parameters
  Eigen::VectorXd beside_values_;
  std::vector<std::string> names_;
  std::vector<int> strongest_;             // of each member, into columns_
  std::vector<std::vector<int>> members_;  // into columns_
  std::vector<double> values_;
  Eigen::MatrixXd information_;
  double last_temperature_c_ = 0.0;
};

}  // namespace turncal
