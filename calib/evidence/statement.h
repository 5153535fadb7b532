// The statements on what is missing from the model: a tree of sensor, quantity, driver and formula, with the probability of each node.
//
// The probability of a node is that of all models that hold a term below it (posterior.h). A statement goes as deep as its probability
// stays above `said_from`. Equivalent descriptions are written one way: an accelerometer error that depends on force is a bias, a gyro
// error that depends on rate is a scale factor.
#pragma once

#include <string>
#include <vector>

namespace turncal {

inline constexpr double said_from = 0.95;

struct Statement {
  std::string sensor;    // "gyro x", "accelerometer z", "earth rate"
  std::string quantity;  // "bias", "scale factor", "direction"; empty: left open
  std::string driver;    // "time", "temperature", "turns", "angle", "force", "rate", "field"; empty: left open
  std::string formula;   // an effect of the catalogue; empty: left open
  double probability = 0.0;
};

struct Statements {
  bool tested = false;
  double anything = 0.0;                // probability that something is missing
  std::vector<Statement> nodes;         // every node above `listed_from`; children follow their parent
  std::vector<Statement> said() const;  // the deepest ones of at least said_from
};
inline constexpr double listed_from = 0.05;

bool is_below(const Statement& node, const Statement& other);  // `other` lies below `node` in the tree

// "0.97"; "more than 0.99", "less than 0.01".
std::string words_of_probability(double probability);
// Returns "the bias of accelerometer y depends on the specific force (0.98), perhaps by accel_second_order (0.91)".
std::string words_of(const Statements& statements);
std::string reason_of(const Statements& statements);  // words_of(), after the probability that anything is missing

}  // namespace turncal
