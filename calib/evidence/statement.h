// What is said to be missing from the model: a tree of sensor, quantity, driver and formula, with the probability of each node.
//
// The probability of a node is that of all models that hold a term below it (posterior.h). What is said goes as deep as
// `said_from` carries it. Where two descriptions are the same thing one of them is used: an accelerometer's reading that goes with the
// force is a bias, a gyro's that goes with the rate is a scale factor.
#pragma once

#include <string>
#include <vector>

namespace turncal {

inline constexpr double said_from = 0.95;

struct Statement {
  std::string sensor;    // "gyro x", "accelerometer z", "earth rate"
  std::string quantity;  // "bias", "scale factor", "direction"; empty: not said
  std::string driver;    // "time", "temperature", "turns", "angle", "force", "rate", "field"; empty: not said
  std::string formula;   // an effect of the catalogue; empty: not said
  double probability = 0.0;
};

struct Statements {
  bool tested = false;
  double anything = 0.0;                // that something is missing
  std::vector<Statement> nodes;         // every node above `listed_from`: what is below one follows it
  std::vector<Statement> said() const;  // the deepest ones of at least said_from
};
inline constexpr double listed_from = 0.05;

bool is_below(const Statement& node, const Statement& other);  // `other` below `node`, in the tree

// "0.97"; "more than 0.99", "less than 0.01".
std::string words_of_probability(double probability);
// "the bias of accelerometer y depends on the specific force (0.98), perhaps by accel_second_order (0.91)": what is said, and by which formulas.
std::string words_of(const Statements& statements);
std::string reason_of(const Statements& statements);  // those, and how probable it is that anything is missing

}  // namespace turncal
