#include "calib/evidence/terms.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>

#include "calib/model/attitude.h"
#include "calib/statistics/numerics.h"

#include <Eigen/QR>

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Prior odds that terms of a kind are present.
constexpr double prior_effects = 0.7, prior_patterns = 0.7, prior_wander = 0.5;
// Grid of sizes of patterns and wanders, in usual sizes: steps of a factor of three, each divided into fine_parts.
constexpr double smallest_pattern = 0.17, pattern_step = 3.16;
constexpr int pattern_steps = 6, fine_parts = 4;
const std::vector<double> effect_sizes = {2.0, 5.0, 12.0, 30.0, 80.0, 250.0, 1000.0};
// Usual sizes from data sheets of navigation-grade units, 0.003 deg/sqrt(h) and 10 ug/sqrt(Hz); other grades scale with their noise.
constexpr double usual_gyro_bias_degph = 0.03, usual_accel_bias_ug = 3.0, usual_ppm = 3.0;
constexpr double navigation_arw = 0.003, navigation_vrw = 10.0;
constexpr Eigen::Index wander_rank = 16;
constexpr double largest_size = 1000.0;  // cap of an effect, in usual sizes
constexpr double least_part = 1e-7;      // of a column's information: a remainder below it is rounding

struct Grades {
  double gyro = 1.0, accel = 1.0;
};
Grades grades_of(const NoiseModel& noise) {
  return {std::max(1.0, noise.angle_random_walk.mean() / radprs_per_degprh / navigation_arw),
          std::max(1.0, noise.velocity_random_walk.mean() / mpsprs_per_ugprHz / navigation_vrw)};
}

// One quantity of one sensor.
struct Channel {
  Sensor sensor;
  Quantity quantity;
  int axis;
  int from;  // direction: the axis that leaks into it
  double unit;
};
// Returns the reading that the channel adds to: gyros x y z, then accelerometers x y z.
int reading_of(const Channel& c) { return (c.sensor == Sensor::gyro ? 0 : 3) + c.axis; }
// Returns the derivative of its size by that reading.
double slope_of(const Channel& c) { return c.quantity == Quantity::scale_factor ? c.unit : 0.0; }
double size_of(const Channel& c, const ErrorCell& cell) {
  const Vector3d& input = c.sensor == Sensor::gyro ? cell.at.w_b : cell.at.f_b;
  return c.unit * (c.quantity == Quantity::bias ? 1.0 : input[c.from]);
}

std::vector<Channel> all_channels(const Grades& grades) {
  std::vector<Channel> all;
  for (int i = 0; i < 3; ++i) {
    all.push_back({Sensor::gyro, Quantity::bias, i, i, usual_gyro_bias_degph * radps_per_degph * grades.gyro});
    all.push_back({Sensor::gyro, Quantity::scale_factor, i, i, 1e-6 * usual_ppm * grades.gyro});
    all.push_back({Sensor::accelerometer, Quantity::bias, i, i,
                   usual_accel_bias_ug * 1e-6 * standard_gravity_mps2 * grades.accel});
    all.push_back({Sensor::accelerometer, Quantity::scale_factor, i, i, 1e-6 * usual_ppm * grades.accel});
    for (int j = 0; j < 3; ++j) {
      if (i == j) continue;
      all.push_back({Sensor::gyro, Quantity::direction, i, j, 1e-6 * usual_ppm * grades.gyro});
      all.push_back({Sensor::accelerometer, Quantity::direction, i, j, 1e-6 * usual_ppm * grades.accel});
    }
  }
  return all;
}

struct Kernel {
  Driver driver;
  MatrixXd L;
  double share = 1.0;
  double scale = 0.0;  // L = scale 1
};

// Functions on the cells, in blocks of `count`; each cell belongs to one block.
struct Functions {
  Eigen::Index count = 1, blocks = 1;
  std::function<Eigen::Index(const ErrorCell&)> block_of;             // null: a single block
  std::function<void(const ErrorCell&, Eigen::Ref<VectorXd>)> write;  // its values in the cell's block; null: 1
  std::vector<Kernel> kernels;
  MatrixXd values = {};  // by cell
};

constexpr int harmonics = 4, waves = 3;
constexpr std::array<double, 3> decays_s = {15.0, 60.0, 250.0};
constexpr std::array<double, 2> smooth_parts = {0.3, 0.1};  // correlation lengths, in parts of the range
constexpr double least_range_c = 0.3;
constexpr int fewest_epochs = 4;

struct Epochs {
  VectorXd time_s, temperature_c;
  Eigen::VectorXi number, recording, turn;  // turn: number of turns before it, over all recordings
  Eigen::Index fitted = 0;                  // epochs behind these are held out
  // Clears the covariance between recordings: functions of time are independent in each.
  MatrixXd in_each(MatrixXd K) const {
    for (Eigen::Index i = 0; i < K.rows(); ++i)
      for (Eigen::Index j = 0; j < K.cols(); ++j)
        if (recording[i] != recording[j]) K(i, j) = 0.0;
    return K;
  }
};
Epochs epochs_of(const Pieces& pieces) {
  const VectorXd zero = VectorXd::Zero(pieces.epochs);
  const Eigen::VectorXi none = Eigen::VectorXi::Zero(pieces.epochs);
  Epochs e = {zero, zero, Eigen::VectorXi::LinSpaced(pieces.epochs, 0, pieces.epochs - 1), none, none};
  VectorXd weight = zero;
  for (const ErrorCell& cell : pieces.cells) {
    e.time_s[cell.epoch] += cell.at.duration_s * cell.at.time_s;
    e.temperature_c[cell.epoch] += cell.at.duration_s * cell.at.temperature_c;
    weight[cell.epoch] += cell.at.duration_s;
    e.recording[cell.epoch] = cell.at.recording;
  }
  for (const Piece& piece : pieces.pieces) e.turn[pieces.cells[piece.rest_cell].epoch] = piece.turn;
  if (pieces.fitted_cells > 0) e.fitted = pieces.cells[pieces.fitted_cells - 1].epoch + 1;
  e.time_s = e.time_s.cwiseQuotient(weight.cwiseMax(1e-9));
  e.temperature_c = e.temperature_c.cwiseQuotient(weight.cwiseMax(1e-9));
  return e;
}

// Returns an indicator function per value of `number`: 1 in the epochs with that value.
Functions of_each(const Eigen::VectorXi& number, std::vector<Kernel> kernels = {}) {
  return {1, number.size() > 0 ? number.maxCoeff() + 1 : 0, [number](const ErrorCell& c) { return number[c.epoch]; },
          nullptr, std::move(kernels)};
}

Kernel all_of(Driver driver, Eigen::Index count, double size = 1.0) {
  return {driver, size * MatrixXd::Identity(count, count), 1.0, size};
}
// Returns a series of pairs of functions as a whole, and, with equal odds together, each pair by itself.
std::vector<Kernel> series(Driver driver, Eigen::Index count) {
  std::vector<Kernel> all = {all_of(driver, count, 1.0 / std::sqrt(0.5 * double(count)))};
  for (Eigen::Index k = 0; k < count; k += 2) {
    MatrixXd pair = MatrixXd::Zero(count, 2);
    pair.middleRows<2>(k).setIdentity();
    all.push_back({driver, pair, 2.0 / double(count)});
  }
  return all;
}

std::vector<Functions> all_functions(const Pieces& pieces, const Epochs& epochs) {
  std::vector<Functions> all;
  Vector3d fastest = Vector3d::Constant(1e-2);
  for (const ErrorCell& cell : pieces.cells) fastest = fastest.cwiseMax(cell.at.w_b.cwiseAbs());
  const auto curve = [](double x, Eigen::Ref<VectorXd> v) {
    for (int k = 1; k <= waves; ++k) {
      v[2 * k - 2] = std::sin(0.5 * pi * k * x) / k;
      v[2 * k - 1] = (1.0 - std::cos(0.5 * pi * k * x)) / k;
    }
  };
  for (int axis = 0; axis < 3; ++axis) {
    all.push_back({2 * harmonics, 1, nullptr,
                   [axis](const ErrorCell& c, Eigen::Ref<VectorXd> v) {
                     for (int h = 1; h <= harmonics; ++h) {
                       v[2 * h - 2] = std::cos(h * c.at.table_rad[axis]) / h;
                       v[2 * h - 1] = std::sin(h * c.at.table_rad[axis]) / h;
                     }
                   },
                   series(Driver::angle, 2 * harmonics)});
    all.push_back({2 * waves, 1, nullptr,
                   [axis, curve](const ErrorCell& c, Eigen::Ref<VectorXd> v) {
                     curve(c.at.f_b[axis] / standard_gravity_mps2, v);
                   },
                   series(Driver::force, 2 * waves)});
    all.push_back({2 * waves, 1, nullptr,
                   [axis, curve, most = fastest[axis]](const ErrorCell& c, Eigen::Ref<VectorXd> v) {
                     if (c.turns)
                       curve(c.at.w_b[axis] / most, v);
                     else
                       v.setZero();
                   },
                   series(Driver::rate, 2 * waves)});
  }
  const auto decay = [](const ErrorCell& c, double tau) {  // its mean over the cell
    const double since = c.at.since_rotation_s, half = 0.5 * c.at.duration_s;
    if (c.turns || since > 1e6) return 0.0;
    return tau / (2.0 * half) * (std::exp(-(since - half) / tau) - std::exp(-(since + half) / tau));
  };
  const Eigen::Index decays = std::ssize(decays_s);
  all.push_back({decays,
                 1,
                 nullptr,
                 [decay](const ErrorCell& c, Eigen::Ref<VectorXd> v) {
                   for (Eigen::Index k = 0; k < v.size(); ++k) v[k] = decay(c, decays_s[std::size_t(k)]);
                 },
                 {all_of(Driver::turns, decays, 1.0 / std::sqrt(0.5 * double(decays)))}});
  // The decay after a turn may depend on the rotation, the pose or anything else, so each turn has its own size.
  all.push_back(of_each(epochs.turn));
  all.back().kernels = {all_of(Driver::turns, all.back().blocks)};
  all.back().write = [decay](const ErrorCell& c, Eigen::Ref<VectorXd> v) { v[0] = decay(c, decays_s[1]); };
  if (!pieces.responses.empty()) return all;
  // So may the value during a turn; in hand-turned data that is the floor of the turns.
  all.push_back(of_each(epochs.turn, {all_of(Driver::rate, all.back().blocks)}));
  all.back().write = [](const ErrorCell& c, Eigen::Ref<VectorXd> v) { v[0] = c.turns ? 1.0 : 0.0; };
  return all;
}

template <class Visit>  // visits every cell of a piece
void each_cell(const Pieces& pieces, std::size_t k, Visit visit) {
  for (std::size_t c = pieces.pieces[k].first_cell; c <= pieces.pieces[k].rest_cell; ++c) visit(c, pieces.cells[c]);
}

// What the biases and the rows of the matrices absorb of errors in the readings over a recording, by least squares: of accelerometers at
// rest, of gyros in turns as well. A parameter has its value over the whole recording: for a bias that steps, the mean.
class TakenUp {
 public:
  TakenUp(const Pieces& pieces, const Parameters& fit, const std::vector<int>& columns) : fit_(fit), columns_(columns) {
    Eigen::Matrix4d gyro = Eigen::Matrix4d::Zero(), accel = Eigen::Matrix4d::Zero();
    for (std::size_t c = 0; c < pieces.fitted_cells; ++c) {
      const ErrorCell& cell = pieces.cells[c];
      const Eigen::Vector4d g = regressors(cell, true), a = regressors(cell, false);
      gyro += cell.at.duration_s * g * g.transpose();
      accel += cell.at.duration_s * a * a.transpose();
    }
    gyro_ = gyro.completeOrthogonalDecomposition().pseudoInverse();
    accel_ = accel.completeOrthogonalDecomposition().pseudoInverse();
  }
  // Sums over the cells: 4 x 6 per column, by sensor.
  using Sums = std::vector<Eigen::Matrix<double, 4, 6>>;
  static void add(const ErrorCell& cell, int reading, const VectorXd& size, Eigen::Index first, Sums& sums) {
    const Eigen::Vector4d x = cell.at.duration_s * regressors(cell, reading < 3);
    for (Eigen::Index k = 0; k < size.size(); ++k) sums[std::size_t(first + k)].col(reading) += size[k] * x;
  }
  MatrixXd as_parameters(const Sums& sums) const {
    MatrixXd all(Eigen::Index(columns_.size()), Eigen::Index(sums.size()));
    for (std::size_t k = 0; k < sums.size(); ++k) {
      const Eigen::Matrix<double, 4, 3> gyro = gyro_ * sums[k].leftCols<3>(), accel = accel_ * sums[k].rightCols<3>();
      Parameters change;
      change.N0_degph = gyro.row(0).transpose() / radps_per_degph;
      change.A0_g = accel.row(0).transpose() / standard_gravity_mps2;
      change.n = -gyro.bottomRows<3>().transpose() * fit_.n;
      change.a = -accel.bottomRows<3>().transpose() * fit_.a;
      // The body frame stays on the accelerometers: a21 = a31 = a32 = 0.
      const Matrix3d turn = skew(Vector3d(-change.a(2, 1), change.a(2, 0), -change.a(1, 0)));
      change.n += turn * fit_.n;
      change.a += turn * fit_.a;
      const ParameterVector vector = to_vector(change);
      for (std::size_t i = 0; i < columns_.size(); ++i)
        all(Eigen::Index(i), Eigen::Index(k)) = columns_[i] < parameter_count ? vector[columns_[i]] : 0.0;
    }
    return all;
  }

 private:
  static Eigen::Vector4d regressors(const ErrorCell& cell, bool gyro) {
    if (gyro) {
      Eigen::Vector4d x(1.0, 0.0, 0.0, 0.0);
      if (cell.turns) x.tail<3>() = cell.at.w_b;
      return x;
    }
    Eigen::Vector4d x = Eigen::Vector4d::Zero();
    if (!cell.turns) x << 1.0, cell.at.f_b;
    return x;
  }
  const Parameters& fit_;
  const std::vector<int>& columns_;
  Eigen::Matrix4d gyro_, accel_;
};

// Returns L with L L' = K, scaled to a unit mean square, without the directions below `floor` of the largest and with at most `most` of them.
MatrixXd factor(const MatrixXd& K, double floor, Eigen::Index most = 1000) {
  const SymmetricEigen e = symmetric_eigen(K);
  const double largest = e.values.maxCoeff();
  Eigen::Index from = std::max<Eigen::Index>(0, e.values.size() - most);
  while (from < e.values.size() - 1 && e.values[from] < floor * largest) ++from;
  const Eigen::Index rank = e.values.size() - from;
  const double norm = std::sqrt(K.trace() / double(K.rows()));
  return e.vectors.rightCols(rank) * (e.values.tail(rank).cwiseMax(0.0).cwiseSqrt() / norm).asDiagonal();
}

MatrixXd differences(const VectorXd& x) {
  MatrixXd d(x.size(), x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) d.col(i) = (x.array() - x[i]).abs();
  return d;
}
MatrixXd smooth(const VectorXd& x, double length) { return (-0.5 * (differences(x) / length).array().square()).exp(); }
MatrixXd walk(const VectorXd& x) {
  MatrixXd K(x.size(), x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i)
    for (Eigen::Index j = 0; j < x.size(); ++j) K(i, j) = std::min(x[i], x[j]);
  return K;
}
VectorXd numbers_of(const Epochs& e, const Eigen::VectorXi& of) {  // from 1 on in each recording
  VectorXd number = VectorXd::Ones(of.size());
  for (Eigen::Index i = 1; i < number.size(); ++i)
    if (e.recording[i] == e.recording[i - 1]) number[i] = number[i - 1] + of[i] - of[i - 1];
  return number;
}

// Functions constant over an epoch: independent values, a walk, a step before one epoch; or constant from turn to turn: independent values, a walk.
Functions steps_of(const Epochs& e) {
  const Eigen::Index n = e.time_s.size();
  const auto walk_of = [&](const Eigen::VectorXi& of) { return factor(e.in_each(walk(numbers_of(e, of))), 1e-3); };
  Functions f = of_each(e.number, {all_of(Driver::unknown, n), {Driver::time, walk_of(e.number)}});
  for (Eigen::Index j = 1; j < e.fitted; ++j) {
    MatrixXd step = MatrixXd::Zero(n, 1);
    for (Eigen::Index i = j; i < e.fitted && e.recording[i] == e.recording[j]; ++i) step(i, 0) = 1.0;
    f.kernels.push_back({Driver::time, step, 1.0 / double(e.fitted)});
  }
  if (e.turn == e.number) return f;
  const MatrixXd after_each = (differences(e.turn.cast<double>()).array() == 0.0).cast<double>();
  f.kernels.push_back({Driver::turns, factor(after_each, 1e-3)});
  f.kernels.push_back({Driver::turns, walk_of(e.turn)});
  return f;
}

// Smooth functions of x in `from` to `to` with covariance exp(-(x - x')^2 / 2 length^2): on a grid of half a length, interpolated by that covariance
// (Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), 8.1). Functions of time are independent in each recording.
Functions smooth_of(Driver driver, double from, double to, double part, int recordings) {
  const double length = part * (to - from);
  const VectorXd grid = VectorXd::LinSpaced(Eigen::Index(std::ceil(2.0 / part)) + 1, from, to);
  const SymmetricEigen e = symmetric_eigen(smooth(grid, length));
  const Eigen::Index count = (e.values.array() > 1e-4 * e.values.maxCoeff()).count();
  const MatrixXd weights = e.vectors.rightCols(count) * e.values.tail(count).cwiseSqrt().cwiseInverse().asDiagonal();
  const bool of_time = driver == Driver::time;
  Functions f = {count, of_time ? recordings : 1, nullptr, nullptr, {}};
  if (of_time) f.block_of = [](const ErrorCell& c) { return c.at.recording; };
  f.write = [=](const ErrorCell& c, Eigen::Ref<VectorXd> v) {
    const double x = of_time ? c.at.time_s : c.at.temperature_c;
    v = weights.transpose() * (-0.5 * ((grid.array() - x) / length).square()).exp().matrix();
  };
  f.kernels = {all_of(driver, f.count * f.blocks)};
  return f;
}

MatrixXd side_by_side(const MatrixXd& L, Eigen::Index wide) {
  MatrixXd all = MatrixXd::Zero(L.rows() * wide, L.cols() * wide);
  for (Eigen::Index c = 0; c < wide; ++c) all(Eigen::seqN(c, L.rows(), wide), Eigen::seqN(c, L.cols(), wide)) = L;
  return all;
}

Quantity canonical(Sensor sensor, Quantity quantity, Driver driver) {
  if (sensor == Sensor::accelerometer && driver == Driver::force) return Quantity::bias;
  if (sensor == Sensor::gyro && driver == Driver::rate) return Quantity::scale_factor;
  return quantity;
}

// Sets a half-Cauchy prior with a scale of one usual size.
void pattern_prior(double share, double kind, double smaller, Term& term) {
  term.stride = term.L.cols() > few_columns ? fine_parts : 1;
  const Eigen::Index n = pattern_steps * term.stride + 1;
  term.variance.resize(n);
  term.log_prior.resize(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double size = smallest_pattern * std::pow(pattern_step, double(k) / term.stride);
    term.variance[k] = std::pow(size * smaller, 2);
    term.log_prior[k] = size / (1.0 + size * size);
  }
  term.log_prior = (term.log_prior / term.log_prior.sum() * share * kind).array().log();
}

}  // namespace

std::string sensor_name(Sensor sensor, int axis) {
  return axis < 0 ? std::string(to_string(sensor)) : std::string(to_string(sensor)) + " " + "xyz"[axis];
}

bool is_seen(const UnderNoise& under, std::size_t effect) {
  const PieceSystem::Block& block = under.blocks[under.table->basis_of_effect[effect]];
  const int at = under.table->column_of_effect[effect];
  return block.Q(at, at) > least_part * block.before[at] && block.Q(at, at) > 0.0;
}

namespace {

class Table {
 public:
  Table(const PieceSystem& system, const Pieces& pieces, const NoiseModel& noise, const Parameters& fit,
        const std::vector<int>& columns)
      : system_(system),
        pieces_(pieces),
        epochs_(epochs_of(pieces)),
        grades_(grades_of(noise)),
        taken_up_(pieces, fit, columns) {
    for (const ErrorCell& cell : pieces.cells) length_s_ = std::max(length_s_, cell.at.time_s);
    if (pieces.cells.empty()) return;
    fitted_ = pieces.cells[pieces.fitted_cells - 1].at.recording + 1;
    held_out_ = pieces.cells.back().at.recording + 1 - fitted_;
  }

  void add_patterns() {
    std::vector<Functions> functions = all_functions(pieces_, epochs_);
    if (pieces_.epochs >= fewest_epochs) add_of_time(functions);
    for (Functions& f : functions) evaluate(f);
    for (const Channel& channel : all_channels(grades_)) {
      const std::size_t first = table_.terms.size();
      int unit = -1;
      for (const Functions& f : functions) {
        if (f.kernels.front().driver == Driver::angle && by_hand()) continue;
        const std::size_t basis = add_basis({channel}, f);
        if (f.kernels.front().driver == Driver::unknown && !by_hand()) unit = int(basis);
        if (by_hand() && table_.bases[basis].rows.empty()) continue;
        for (const Kernel& kernel : f.kernels) {
          // In hand-turned data an independent value in every rest is the floor, not a term.
          if (by_hand() && kernel.driver == Driver::unknown) continue;
          Term term;
          term.kind = TermKind::pattern;
          term.what = {sensor_name(channel.sensor, channel.axis),
                       std::string(to_string(canonical(channel.sensor, channel.quantity, kernel.driver))),
                       std::string(to_string(kernel.driver)), "", 0.0};
          term.basis = basis;
          term.L = kernel.L;
          term.scale = kernel.scale;
          shares_.push_back(kernel.share);
          table_.terms.push_back(std::move(term));
        }
      }
      for (std::size_t k = first; k < table_.terms.size(); ++k) table_.terms[k].unit = unit;
      if (channel.quantity != Quantity::direction)
        unit_of_[{sensor_name(channel.sensor, channel.axis), std::string(to_string(channel.quantity))}] = unit;
    }
    double all = 0.0;
    for (const double share : shares_) all += share;
    for (std::size_t k = 0; k < shares_.size(); ++k)
      pattern_prior(shares_[k] / all, prior_patterns, 1.0, table_.terms[k]);
    if (by_hand()) return;
    add_wander(Sensor::gyro);
    add_wander(Sensor::accelerometer);
  }

  void add_effects(const std::vector<EffectColumn>& effects, const std::vector<Readings>& readings) {
    table_.effects = effects;
    table_.basis_of_effect.resize(effects.size());
    table_.column_of_effect.resize(effects.size());
    for (std::size_t begin = 0, end; begin < effects.size(); begin = end) {
      end = begin + 1;
      while (end < effects.size() && effects[end].entry == effects[begin].entry &&
             effects[end].tau_s == effects[begin].tau_s && effects[end].recording == effects[begin].recording)
        ++end;
      const auto wide = Eigen::Index(end - begin);
      const bool own = effects[begin].entry->of_one_run;  // a held-out recording has its own value
      const std::size_t basis = add_basis(
          own ? wide * (1 + held_out_) : wide, wide,
          [&](std::size_t k) {
            const std::size_t cell = pieces_.pieces[k].rest_cell;
            return own && cell >= pieces_.fitted_cells ? wide * (pieces_.cells[cell].at.recording - fitted_ + 1) : 0;
          },
          [&](std::size_t c, const ErrorCell&, const auto& add, MatrixXd& jumps) {
            const auto of = readings[c].middleCols(Eigen::Index(begin), wide);
            for (int reading = 0; reading < 6; ++reading)
              if (const VectorXd size = of.row(reading); !size.isZero(0.0)) add(reading, size, of.row(12 + reading));
            jumps += of.middleRows<6>(6).transpose();
          });
      for (std::size_t k = begin; k < end; ++k) {
        table_.basis_of_effect[k] = basis;
        table_.column_of_effect[k] = int(k - begin);
      }
    }
  }

  UnderNoise take() {
    const auto table = std::make_shared<TermTable>(std::move(table_));
    UnderNoise under = {&system_, table, system_.blocks(table->bases)};
    add_effect_terms(under, *table);
    return under;
  }

 private:
  bool by_hand() const { return !pieces_.responses.empty(); }
  // Adds a basis of `columns`, of which piece k has `mine`, from first(k) on. each(cell number, cell, add, jumps) calls
  // add(reading, size, slope), one value per column, and in a turn adds the jump of psi and v to `jumps` (mine x 6).
  template <class First, class Each>
  std::size_t add_basis(Eigen::Index columns, Eigen::Index mine, First first, Each each) {
    Weights weights;
    weights.columns = columns;
    weights.mine = mine;
    if (!by_hand()) weights.pull.setZero(columns);
    MatrixXd rows, piece(mine, piece_dims), jumps(mine, 6);
    if (by_hand()) rows.setZero(pieces_.responses.front().rows(), columns);
    TakenUp::Sums sums(std::size_t(columns), Eigen::Matrix<double, 4, 6>::Zero());
    for (std::size_t k = 0; k < pieces_.pieces.size(); ++k) {
      const Eigen::Index begin = first(k);
      piece.setZero();
      jumps.setZero();
      each_cell(pieces_, k, [&](std::size_t c, const ErrorCell& cell) {
        each(
            c, cell,
            [&](int reading, const VectorXd& size, const VectorXd& slope) {
              if (by_hand())
                rows.middleCols(begin, mine).noalias() += pieces_.responses[c].col(reading) * size.transpose();
              else if (!cell.turns)
                piece.col(reading) += size;
              const bool noisy = cell.turns || reading >= 3;  // a gyro's column at rest holds the Earth's rate
              if (!by_hand() && noisy) weights.pull.segment(begin, mine) += system_.pull(c)[reading] * slope;
              if (c < pieces_.fitted_cells) TakenUp::add(cell, reading, size, begin, sums);
            },
            jumps);
      });
      piece.rightCols<6>() = jumps;
      if (!by_hand()) weights.add(begin, piece);
    }
    table_.bases.push_back(by_hand() ? Weights::of_rows(rows) : std::move(weights));
    table_.taken_up.push_back(taken_up_.as_parameters(sums));
    return table_.bases.size() - 1;
  }
  void evaluate(Functions& f) const {
    f.values.setOnes(f.count, std::ssize(pieces_.cells));
    for (int c = 0; f.write && c < f.values.cols(); ++c) f.write(pieces_.cells[std::size_t(c)], f.values.col(c));
  }
  void add_of_time(std::vector<Functions>& functions) const {
    functions.push_back(steps_of(epochs_));
    const auto [first, last] = std::ranges::minmax(epochs_.time_s);
    const auto [coldest, warmest] = std::ranges::minmax(epochs_.temperature_c);
    for (const double part : smooth_parts) {
      functions.push_back(smooth_of(Driver::time, first, last, part, fitted_ + held_out_));
      if (warmest - coldest > least_range_c)
        functions.push_back(smooth_of(Driver::temperature, coldest, warmest, part, 1));
    }
  }

  // Adds a basis of several channels side by side: column = function * channels + channel.
  std::size_t add_basis(const std::vector<Channel>& channels, const Functions& f) {
    const auto wide = Eigen::Index(channels.size());
    VectorXd size = VectorXd::Zero(f.count * wide), slope = size;
    const auto first = [&](std::size_t k) {
      return f.block_of ? f.block_of(pieces_.cells[pieces_.pieces[k].rest_cell]) * f.count * wide : 0;
    };
    return add_basis(f.blocks * f.count * wide, f.count * wide, first,
                     [&](std::size_t number, const ErrorCell& cell, const auto& add, MatrixXd& jumps) {
                       for (std::size_t c = 0; c < channels.size(); ++c) {
                         const auto own = Eigen::seqN(Eigen::Index(c), f.count, wide);
                         const auto values = f.values.col(Eigen::Index(number));
                         size.setZero();
                         slope.setZero();
                         size(own) = size_of(channels[c], cell) * values;
                         slope(own) = slope_of(channels[c]) * values;
                         const int reading = reading_of(channels[c]);
                         add(reading, size, slope);
                         if (cell.turns) jumps += size * cell.jump.col(reading).transpose();
                       }
                     });
  }

  // Adds wanders of the three biases of a triad: the same size on each axis, an independent course for each.
  void add_wander(Sensor sensor) {
    std::vector<Channel> channels;
    for (const Channel& c : all_channels(grades_))
      if (c.sensor == sensor && c.quantity == Quantity::bias) channels.push_back(c);
    Functions each = of_each(epochs_.number);
    evaluate(each);
    const std::size_t basis = add_basis(channels, each);
    const auto wide = Eigen::Index(channels.size());
    // Flicker noise as the sum of processes with a range of correlation times and equal variances. Its mean is the
    // bias; for a walk the bias is the mean over the recording.
    const MatrixXd d = differences(epochs_.time_s);
    MatrixXd flicker = MatrixXd::Zero(d.rows(), d.cols());
    for (const double tau : {200.0, 600.0, 2000.0}) flicker.array() += (-d / tau).array().exp();
    const std::vector<MatrixXd> kernels = {epochs_.in_each(walk(epochs_.time_s)), epochs_.in_each(flicker)};
    for (const MatrixXd& K : kernels) {
      Term term;
      term.about_mean = &K == &kernels.front();
      term.kind = TermKind::noise;
      term.what.sensor = std::string(to_string(sensor)) + "s";
      term.basis = basis;
      term.L = side_by_side(factor(K, 3e-3, wander_rank * (1 + held_out_)), wide);
      pattern_prior(1.0 / double(kernels.size()), prior_wander, 0.1, term);
      table_.terms.push_back(std::move(term));
    }
  }

  // Adds each component, and all components of one sensor together, scaled to their own sigma.
  void add_effect_terms(const UnderNoise& under, TermTable& table) const {
    struct Group {
      std::vector<int> columns;
      double share;
    };
    std::vector<Group> groups;
    double all = 0.0;
    std::map<std::pair<std::size_t, int>, std::vector<int>> rows;  // effects of a basis, by axis
    for (std::size_t k = 0; k < table.effects.size(); ++k) {
      const EffectColumn& effect = table.effects[k];
      if (!is_seen(under, k)) continue;
      groups.push_back({{int(k)}, effect.entry->share * part_of_tau(table.effects, effect)});
      rows[{table.basis_of_effect[k], axis_of(table.effects[k])}].push_back(int(k));
    }
    for (const auto& [of, columns] : rows)
      if (of.second >= 0 && columns.size() > 1)
        groups.push_back({columns, table.effects[std::size_t(columns.front())].entry->share});
    for (const Group& g : groups) all += g.share;
    for (const Group& g : groups) {
      const EffectColumn& first = table.effects[std::size_t(g.columns.front())];
      const std::size_t basis = table.basis_of_effect[std::size_t(g.columns.front())];
      const PieceSystem::Block& block = under.blocks[basis];
      Term term;
      term.kind = TermKind::effect;
      term.what = {sensor_name(first.entry->sensor, axis_of(first)), std::string(to_string(first.entry->quantity)),
                   std::string(to_string(first.entry->driver)), std::string(first.entry->name), 0.0};
      term.basis = basis;
      term.columns = g.columns;
      if (const auto unit = unit_of_.find({term.what.sensor, term.what.quantity}); unit != unit_of_.end())
        term.unit = unit->second;
      const Eigen::Index all_of = block.Q.rows(), wide = first.entry->of_one_run ? all_of / (1 + held_out_) : all_of;
      const Eigen::Index many = std::ssize(g.columns);
      term.L = MatrixXd::Zero(all_of, many * (all_of / wide));
      double widest = 0.0;
      for (Eigen::Index j = 0; j < many; ++j) {
        const int at = table.column_of_effect[std::size_t(g.columns[std::size_t(j)])];
        const double sigma = 1.0 / std::sqrt(block.Q(at, at));
        for (Eigen::Index of = 0; of < all_of / wide; ++of) term.L(of * wide + at, of * many + j) = sigma;
        widest = std::max(widest, sigma);
      }
      const double cap = largest_size * usual_of(*first.entry) / widest;
      const Eigen::Map<const VectorXd> sizes(effect_sizes.data(), std::ssize(effect_sizes));
      term.variance = sizes.cwiseMin(cap).cwiseAbs2();
      term.log_prior.setConstant(sizes.size(), std::log(prior_effects * g.share / all / double(sizes.size())));
      table.terms.push_back(std::move(term));
    }
  }

  // Returns the share of one time constant in its effect's prior, which is log-uniform: half of the way to its neighbours.
  static double part_of_tau(const std::vector<EffectColumn>& effects, const EffectColumn& of) {
    std::multiset<double> taus;
    for (const EffectColumn& c : effects)
      if (c.entry == of.entry && c.component == of.component && c.recording == of.recording) taus.insert(c.tau_s);
    if (taus.size() == 1) return 1.0;
    const auto [first, behind] = taus.equal_range(of.tau_s);
    const double below = *(first == taus.begin() ? first : std::prev(first)), longest = *taus.rbegin();
    const double above = behind == taus.end() ? longest : *behind;
    return 0.5 * std::log(above / below) / std::log(longest / *taus.begin()) / double(std::distance(first, behind));
  }
  static int axis_of(const EffectColumn& c) {
    const std::size_t axis = std::string_view("xyz").find(c.entry->components[std::size_t(c.component)].front());
    return axis == std::string_view::npos ? -1 : int(axis);
  }
  // Returns the usual size in the unit of the effect; for a drift in a short run, the rate that adds up to it there.
  double usual_of(const EffectEntry& entry) const {
    const double grade = (entry.sensor == Sensor::gyro ? grades_.gyro : grades_.accel) *
                         absurd_magnitude(entry, length_s_) / absurd_magnitude(entry);
    if (entry.unit.starts_with("deg/h")) return usual_gyro_bias_degph * grade;
    if (entry.unit == "mm" || entry.unit == "ms" || entry.unit == "%") return 0.03 * grade;
    return usual_ppm * grade;
  }

  const PieceSystem& system_;
  const Pieces& pieces_;
  const Epochs epochs_;
  const Grades grades_;
  const TakenUp taken_up_;
  TermTable table_;
  std::vector<double> shares_;
  std::map<std::pair<std::string, std::string>, int> unit_of_;  // of a sensor's quantity: Term::unit
  double length_s_ = 0.0;
  int fitted_ = 1, held_out_ = 0;  // recordings
};

}  // namespace

UnderNoise make_terms(const PieceSystem& system, const Pieces& pieces, const std::vector<EffectColumn>& effects,
                      const std::vector<Readings>& readings, const NoiseModel& noise, const Parameters& fit,
                      const std::vector<int>& columns) {
  Table table(system, pieces, noise, fit, columns);
  table.add_patterns();
  table.add_effects(effects, readings);
  return table.take();
}

}  // namespace turncal
