// What may be common to recordings of a fleet, as columns x of a value each, and how a component is tested against them. Used by
// fleet_selection.cpp and fleet_diagnosis.cpp only.
#pragma once

#include <vector>

#include "calib/fleet/component_model.h"
#include "calib/fleet/fleet_scores.h"

namespace turncal {

// What is common: x of every recording, and what it is called.
struct Hypothesis {
  int factor = -1;  // -1: all
  int level = 0;
  FleetShape shape = FleetShape::constant;
  double begin_day = 0.0;
};

Eigen::VectorXd column_of(const FleetScores& scores, const Hypothesis& hypothesis);
// A column a level; of factor -1 one of ones.
Eigen::MatrixXd level_columns(const FleetScores& scores, int factor);

// Every hypothesis, and its x as a column.
struct HypothesisList {
  std::vector<Hypothesis> list;
  Eigen::MatrixXd X;
};
struct Hypotheses {
  HypothesisList constant, shapes;
};
Hypotheses all_hypotheses(const FleetScores& scores, const FleetOptions& options);

struct Estimate {
  double value = 0.0, sigma = 0.0, z = 0.0;
};

// One component, ready for any x: data and the scatter of units.
struct Component {
  // Its scatter of units is what these columns leave.
  Component(ComponentData the_data, const Eigen::MatrixXd& beside, bool others);
  ComponentData data;
  double variance = 0.0;
  bool from_others = false;  // a parameter: from the mean of those without x
  double degrees = 0.0;
  UnitWeights weights;

  // Of each column by itself.
  std::vector<Estimate> test(const Eigen::MatrixXd& X) const;
};
Component component_of(const FleetScores& scores, std::size_t component, int factor);

}  // namespace turncal
