// The scores of a fleet by component, what is taken off them, and what may be common to its recordings. Used by fleet_diagnosis.cpp only.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/component_model.h"
#include "calib/fleet/fleet_diagnosis.h"

namespace turncal {

class FleetScores {
 public:
  // Recordings of one unit come to stand one after the other. `members` must live as long.
  FleetScores(const std::vector<FleetMember>& members, std::size_t factors);

  std::size_t size() const { return members_.size(); }
  const FleetMember& member(std::size_t i) const { return *members_[i]; }
  std::size_t given(std::size_t i) const { return given_[i]; }  // its place in the members given
  const std::vector<std::string>& components() const { return components_; }
  bool is_parameter(std::size_t component) const { return component >= effects_; }
  std::size_t effects() const { return effects_; }
  const std::vector<std::string>& levels(std::size_t factor) const { return levels_[factor]; }
  const std::vector<int>& level_of(std::size_t factor) const { return level_of_[factor]; }

  // y and v of every recording; v is infinite where it says nothing, or was set aside.
  ComponentData data(std::size_t component) const;
  // The same of sums of effects: a column of weights each, of components() that are effects.
  std::vector<ComponentData> sums(const Eigen::MatrixXd& weights) const;
  // Sums of all Q, in the order of components().
  Eigen::MatrixXd information() const;

  // `value` units of the component in this recording are explained: off its scores, or, negative, back.
  void subtract(std::size_t member, std::size_t component, double value);
  // By how much chi-square of all recordings' scores is less for what is off them now; parameters have none.
  double explained() const { return explained_; }
  void set_aside(std::size_t member, std::size_t component, bool aside) { aside_[member][component] = aside; }

 private:
  int column(std::size_t member, std::size_t component) const { return columns_[layout_[member]][component]; }
  ComponentData nothing() const;

  std::vector<const FleetMember*> members_;
  std::vector<std::size_t> given_;
  std::vector<Eigen::VectorXd> s_;      // of each member, less what was taken off
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

// What may be common, as a column x with a value for each recording.
struct Hypothesis {
  int factor = -1;  // -1: all
  int level = 0;
  FleetShape shape = FleetShape::constant;
  double begin_day = 0.0;
};
Eigen::VectorXd column_of(const FleetScores& scores, const Hypothesis& hypothesis);
// A column a level; of factor -1 one of ones.
Eigen::MatrixXd level_columns(const FleetScores& scores, int factor);

struct HypothesisList {
  std::vector<Hypothesis> list;
  Eigen::MatrixXd X;  // a column each
};
struct Hypotheses {
  HypothesisList constant, shapes;
};
Hypotheses all_hypotheses(const FleetScores& scores, const std::vector<std::string>& factors);

// One component, ready for any x: data and the scatter of units.
struct Component {
  // Its scatter of units is what these columns leave.
  Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others);
  ComponentData data;
  bool from_others = false;  // a parameter: from the mean of those without x
  double degrees = 0.0;
  UnitWeights weights;

  // Of each column by itself.
  std::vector<FleetEstimate> test(const Eigen::MatrixXd& X) const;
};
Component component_of(const FleetScores& scores, std::size_t component, int factor);

}  // namespace turncal
