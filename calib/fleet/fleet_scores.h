// The scores of a fleet by component, what is removed from them, and hypotheses of what is common. Used by fleet_diagnosis.cpp only.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/fleet/fleet_diagnosis.h"

namespace turncal {

// Variance components of one component of an effect over a fleet: common to all, to a station, to a lot, and of a unit.
//
// Recording i of unit u gives y_i with variance v_i (s / Q and 1 / Q of unit_statistics.h). The model:
//   y_i = sum_j x_ij beta_j + sum_f g_f(level of i in factor f) + b_u + r_i + e_i,
//   e_i ~ N(0, v_i), b_u ~ N(0, sigma_b^2), g_f ~ N(0, sigma_f^2), r_i ~ N(0, sigma_r^2)
// with r_i the change of a unit between recordings, as of a bias when it is switched on. beta, fixed, is tested. Variances by
// restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545; Searle, Casella and McCulloch, Variance Components,
// Wiley 1992, ch. 6), in which V is block-diagonal by unit, and the factors enter by the Woodbury identity.
//
// sigma_r^2 is found by moments from units with several recordings (Mandel and Paule, Anal. Chem. 42 (1970) 1194): sum (y - mean of the unit)^2 / (v
// + sigma_r^2) equals their degrees of freedom. A change at a level that the same units went through enters it too, and then has less weight.
//
// Not modelled: units with different variances; values of a unit that drift from recording to recording.

struct ComponentData {
  Eigen::VectorXd y, v;   // v infinite: no information
  std::vector<int> unit;  // of each recording; those of one unit are adjacent
};

// Cross-products of columns with the inverse of V = diag(v) + sigma_b^2 (1 where two recordings are of one unit).
struct UnitWeights {
  UnitWeights(const ComponentData& data, double unit_variance);
  // X' V^-1 Y. Rows of X and Y: recordings.
  Eigen::MatrixXd product(const Eigen::MatrixXd& X, const Eigen::MatrixXd& Y) const;
  // The diagonal of X' V^-1 X.
  Eigen::VectorXd diagonal(const Eigen::MatrixXd& X) const;
  double log_determinant() const { return log_determinant_; }  // of V, less that of diag(v)

 private:
  struct Unit {  // with several recordings
    Eigen::Index first = 0, count = 0;
    double shrink = 0.0;  // V_u^-1 = W - shrink W 1 1' W
  };
  std::vector<Unit> units_;
  Eigen::VectorXd w_;
  double log_determinant_ = 0.0;
};

// Returns sigma_r^2; 0 if no unit has two recordings.
double recording_variance(const ComponentData& data);

// Returns sigma_b^2 by restricted likelihood beside the columns of X. The variances of `data` must include sigma_r^2.
double unit_variance(const ComponentData& data, const Eigen::MatrixXd& X);

// Returns sigma_b^2, then sigma_f^2 of each factor, beside a common mean. `factors`: for each factor, the level of every recording.
std::vector<double> variance_components(const ComponentData& data, const std::vector<std::vector<int>>& factors);

// ---- the scores ----

class FleetScores {
 public:
  // Sorts the recordings so that those of one unit are adjacent. `members` must outlive this.
  FleetScores(const std::vector<FleetMember>& members, std::size_t factors);

  std::size_t size() const { return members_.size(); }
  const FleetMember& member(std::size_t i) const { return *members_[i]; }
  std::size_t given(std::size_t i) const { return given_[i]; }  // its index in the given members
  const std::vector<std::string>& components() const { return components_; }
  bool is_parameter(std::size_t component) const { return component >= effects_; }
  std::size_t effects() const { return effects_; }
  const std::vector<std::string>& levels(std::size_t factor) const { return levels_[factor]; }
  const std::vector<int>& level_of(std::size_t factor) const { return level_of_[factor]; }

  // Returns y and v of every recording; v is infinite without information, or if set aside.
  ComponentData data(std::size_t component) const;
  // The same for weighted sums of effects: one column of weights each, over the components() that are effects.
  std::vector<ComponentData> sums(const Eigen::MatrixXd& weights) const;
  // Returns the sum of all Q, in the order of components().
  Eigen::MatrixXd information() const;

  // Removes `value` units of the component from the scores of this recording; a negative value restores them.
  void subtract(std::size_t member, std::size_t component, double value);
  // Returns the fall of chi-square over all recordings' scores by what is removed; parameters have none.
  double explained() const { return explained_; }
  void set_aside(std::size_t member, std::size_t component, bool aside) { aside_[member][component] = aside; }

 private:
  int column(std::size_t member, std::size_t component) const { return columns_[layout_[member]][component]; }
  ComponentData nothing() const;

  std::vector<const FleetMember*> members_;
  std::vector<std::size_t> given_;
  std::vector<Eigen::VectorXd> s_;      // of each member, less what was removed
  std::vector<ParameterVector> value_;  // likewise
  double explained_ = 0.0;
  std::vector<std::string> components_;
  std::size_t effects_ = 0;
  std::vector<std::vector<int>> columns_;  // of each layout: the column of each component, or -1
  std::vector<std::size_t> layout_;        // of each member
  std::vector<std::vector<std::string>> levels_;
  std::vector<std::vector<int>> level_of_;
  std::vector<int> unit_of_;
  std::vector<std::vector<char>> aside_;
};

// A hypothesis of what is common: a column x with a value for each recording.
struct Hypothesis {
  int factor = -1;  // -1: all
  int level = 0;
  FleetShape shape = FleetShape::constant;
  double begin_day = 0.0;
};
Eigen::VectorXd column_of(const FleetScores& scores, const Hypothesis& hypothesis);
// Returns a column per level; for factor -1, one of ones.
Eigen::MatrixXd level_columns(const FleetScores& scores, int factor);

struct HypothesisList {
  std::vector<Hypothesis> list;
  Eigen::MatrixXd X;  // one column each
};
struct Hypotheses {
  HypothesisList constant, shapes;
};
Hypotheses all_hypotheses(const FleetScores& scores, const std::vector<std::string>& factors);

// One component, ready to test any x: data and the scatter of units.
struct Component {
  // `beside`: columns beside which the scatter of units is estimated.
  Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others);
  ComponentData data;
  bool from_others = false;  // a parameter: from the mean of recordings without x
  double degrees = 0.0;
  UnitWeights weights;

  // Tests each column by itself.
  std::vector<FleetEstimate> test(const Eigen::MatrixXd& X) const;
};
Component component_of(const FleetScores& scores, std::size_t component, int factor);

}  // namespace turncal
