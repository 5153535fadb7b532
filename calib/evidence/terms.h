// Everything that may be missing from the model, as one table of terms.
//
// A term is one thing: a sensor's quantity, what drives it, and its shape. Its columns are B = basis L, its coefficients z ~ N(0, v 1) with a
// prior over the size sqrt(v). A basis is a set of functions on the cells (piece_system.h); terms that share one differ in L alone.
//   effect    a component of the catalogue (effects.h), each with every time constant; or a row of components of one sensor
//   pattern   a quantity of a sensor times a function that has no formula: harmonics 1 to 4 of a table angle (size 1/h), three waves of a
//             component of force or rate, decays after a turn, another value while it turns each time; or any function that is constant over
//             an epoch, z = L'' z'' with L'' L''' a kernel: another value each (whatever drives it), a walk, smooth in time or temperature, one
//             step, another value after each turn, a walk from turn to turn
//   noise     a wander of the three biases of a kind: it widens sigmas and is no missing effect
// Sizes: a grid of about a factor of three; of effects 2 to 1000 of their own sigma, capped at what no sensor has; of patterns and noise
// half-Cauchy about what data sheets give for that quantity and grade.
#pragma once

#include <memory>
#include <vector>

#include "calib/evidence/piece_system.h"
#include "calib/evidence/statement.h"
#include "calib/model/parameters.h"

namespace turncal {

// A size that many columns show is known well: of more than these the grid of sizes is finer.
inline constexpr Eigen::Index few_columns = 12;

enum class TermKind { effect, pattern, noise };

struct Term {
  TermKind kind = TermKind::pattern;
  Statement what;  // its node; of noise: empty but for the sensor
  std::size_t basis = 0;
  Eigen::MatrixXd L;
  double scale = 0.0;                   // L = scale 1; 0: it is another
  Eigen::VectorXd variance, log_prior;  // of each size
  int stride = 1;                       // every so many of them make a coarse grid
  bool about_mean = true;               // what biases and matrices take up of it over the recording is theirs
  std::vector<int> columns;             // of an effect: in TermTable::effects
  int unit = -1;                        // the basis that is one usual unit of its quantity in each epoch; -1: none
};

struct TermTable {
  std::vector<EffectColumn> effects;
  std::vector<Weights> bases;
  std::vector<Eigen::MatrixXd>
      taken_up;  // of each basis: what of a column biases and matrices take up, parameters x columns
  std::vector<Term> terms;
  std::vector<std::size_t> basis_of_effect;  // of each of `effects`, and its column there
  std::vector<int> column_of_effect;
};

// The system at one noise model, and what it says of the bases of the terms; a prior of equal odds is between several of them.
struct UnderNoise {
  const PieceSystem* system = nullptr;
  std::shared_ptr<const TermTable> table;  // may be shared by several
  std::vector<PieceSystem::Block> blocks;  // of each basis
  Statement what = {};                     // what this noise itself says is missing; no sensor: nothing
  double log_prior = 0.0;
};

std::string sensor_name(Sensor sensor, int axis);  // "gyro x"; axis -1: "gyro"

// Does the recording tell this effect (of TermTable::effects) from the parameters?
bool is_seen(const UnderNoise& under, std::size_t effect);

// Of a cell, what one unit of each effect adds: to the readings of gyros and accelerometers, and in a turn to psi and v by its end. And how much
// more, by each of the readings itself.
using Readings = Eigen::Matrix<double, 18, Eigen::Dynamic>;
// `fit`: of the parameters `columns` of [24, effects].
UnderNoise make_terms(const PieceSystem& system, const Pieces& pieces, const std::vector<EffectColumn>& effects,
                      const std::vector<Readings>& readings, const NoiseModel& noise, const Parameters& fit,
                      const std::vector<int>& columns);

}  // namespace turncal
