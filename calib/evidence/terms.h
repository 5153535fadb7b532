// Everything that may be missing from the model, as one table of terms.
//
// A term is a quantity of a sensor, what drives it, and its shape. Its columns are B = basis L, its coefficients z ~ N(0, v 1), with a
// prior over the size sqrt(v). A basis is a set of functions on the cells (piece_system.h); terms that share one differ in L alone.
//   effect    a component of the catalogue (effects.h), at each of its time constants; or all components of one sensor together
//   pattern   a quantity of a sensor times a function without a formula: harmonics 1 to 4 of a table angle (size 1/h), three waves of a
//             component of force or rate, decays after a turn, a value of its own in each turn; or any function constant over an epoch,
//             z = L'' z'' with L'' L''' a kernel: an independent value in each (driver unknown), a random walk, smooth in time or in
//             temperature, one step, an independent value after each turn, a walk from turn to turn
//   noise     a wander of the three biases of a triad: it widens sigmas and does not count as a missing effect
// The grid of sizes has steps of about a factor of three: for effects 2 to 1000 of their own sigma, capped at what no sensor exceeds; for
// patterns and noise with a half-Cauchy prior about the data-sheet value of that quantity and grade.
#pragma once

#include <memory>
#include <vector>

#include "calib/evidence/piece_system.h"
#include "calib/evidence/statement.h"
#include "calib/model/parameters.h"

namespace turncal {

// The data determine a size well when many columns share it: a term with more columns than this has a finer grid of sizes.
inline constexpr Eigen::Index few_columns = 12;

enum class TermKind { effect, pattern, noise };

struct Term {
  TermKind kind = TermKind::pattern;
  Statement what;  // its node in the tree of statements; noise: the sensor alone
  std::size_t basis = 0;
  Eigen::MatrixXd L;
  double scale = 0.0;                   // L = scale 1; 0: another L
  Eigen::VectorXd variance, log_prior;  // one per size
  int stride = 1;                       // the coarse grid takes every so many sizes
  bool about_mean = true;               // its part that biases and matrices absorb over the recording counts as theirs
  std::vector<int> columns;             // effect: its columns in TermTable::effects
  int unit = -1;                        // basis with one usual unit of the quantity in each epoch; -1: none
};

struct TermTable {
  std::vector<EffectColumn> effects;
  std::vector<Weights> bases;
  std::vector<Eigen::MatrixXd> taken_up;  // by basis, parameters x columns: what biases and matrices absorb
  std::vector<Term> terms;
  std::vector<std::size_t> basis_of_effect;  // basis of each of `effects`; and its column there
  std::vector<int> column_of_effect;
};

// The system at one noise model and its blocks for the bases of the terms.
struct UnderNoise {
  const PieceSystem* system = nullptr;
  std::shared_ptr<const TermTable> table;  // may be shared between noise models
  std::vector<PieceSystem::Block> blocks;  // one per basis
  Statement what = {};                     // the defect that this noise model stands for; no sensor: none
  double log_prior = 0.0;
};

std::string sensor_name(Sensor sensor, int axis);  // "gyro x"; axis -1: "gyro"

// Can the recording separate this effect (index into TermTable::effects) from the parameters?
bool is_seen(const UnderNoise& under, std::size_t effect);

// Rows of a cell, by effect: what one unit adds to the six readings; in a turn, what it adds to psi and v by the end of
// the turn; and the derivatives of the first six by the readings themselves.
using Readings = Eigen::Matrix<double, 18, Eigen::Dynamic>;
// Builds the terms. `fit`: the parameters, of which `columns` of [24, effects] were estimated.
UnderNoise make_terms(const PieceSystem& system, const Pieces& pieces, const std::vector<EffectColumn>& effects,
                      const std::vector<Readings>& readings, const NoiseModel& noise, const Parameters& fit,
                      const std::vector<int>& columns);

}  // namespace turncal
