#include "calib/diagnosis/nameless_families.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Where a function is asked for its value: a piece of rest, or a turn.
struct Place {
  Vector3d table_rad;
  double temperature_c;
  int turn;
  Vector3d rate_radps = Vector3d::Zero();
};

struct Function {
  std::string kind, what;
  int count = 0;
  std::function<void(const Place&, Eigen::Ref<VectorXd>)>
      at;               // null: one function for every turn and the rest after it
  bool summed = false;  // Weights
};

constexpr int harmonics = 4;
constexpr int temperature_waves = 4;
constexpr LackOfFitLimits limits;

std::vector<Function> functions_of(const std::vector<Piece>& pieces) {
  std::vector<Function> all;
  static constexpr const char* angles[] = {"heading", "pitch", "roll"};
  for (int axis = 0; axis < 3; ++axis)
    all.push_back({"angle", std::string("with the ") + angles[axis] + " angle", 2 * harmonics,
                   [axis](const Place& p, Eigen::Ref<VectorXd> v) {
                     for (int h = 1; h <= harmonics; ++h) {
                       v[2 * h - 2] = std::cos(h * p.table_rad[axis]) / h;
                       v[2 * h - 1] = std::sin(h * p.table_rad[axis]) / h;
                     }
                   }});
  const int turns = pieces.empty() ? 0 : pieces.back().turn;
  all.push_back({"scatter", "from turn to turn", turns + 1, nullptr});
  if (turns > 0) all.push_back({"walk", "wandering from turn to turn", turns + 1, nullptr, true});
  double coldest = 1e300, warmest = -1e300;
  for (const Piece& piece : pieces) {
    coldest = std::min(coldest, piece.temperature_c);
    warmest = std::max(warmest, piece.temperature_c);
  }
  if (warmest - coldest > limits.least_range_c)
    all.push_back({temperature_curve, "with temperature", temperature_waves,
                   [coldest, warmest](const Place& p, Eigen::Ref<VectorXd> v) {
                     const double phase = pi * (p.temperature_c - coldest) / (warmest - coldest);
                     for (int k = 1; k <= temperature_waves; ++k) v[k - 1] = std::cos(k * phase) / k;
                   }});
  Vector3d fastest = Vector3d::Zero();
  for (const Piece& piece : pieces)
    for (const Turn& turn : piece.turns) fastest = fastest.cwiseMax(turn.rate_radps().cwiseAbs());
  for (int axis = 0; axis < 3; ++axis)
    if (fastest[axis] > limits.least_rate_radps)
      all.push_back({"rate", std::string("with the rate about ") + "xyz"[axis], 2 * curve_waves,
                     [axis, most = fastest[axis]](const Place& p, Eigen::Ref<VectorXd> v) {
                       write_curve(p.rate_radps[axis] / most, v.data());
                     }});
  return all;
}

using Sensor = DisturbedSensor;

Weights::Part weights_on(const Piece& piece, Sensor sensor, int axis, const Function& f) {
  Weights::Part part;
  Eigen::Index count = f.count;
  if (!f.at) {
    part.first = piece.turns.empty() ? piece.turn : std::min(piece.turns.front().turn, piece.turn);
    count = piece.turn - part.first + 1;
  }
  part.of.setZero(piece_dims, count);
  VectorXd value(count);
  const auto evaluate = [&](const Place& place) {
    value.setZero();
    if (f.at)
      f.at(place, value);
    else
      value[place.turn - part.first] = 1.0;
  };
  const bool gyro = sensor == Sensor::gyro_bias || sensor == Sensor::gyro_scale;
  const bool scale = sensor == Sensor::gyro_scale || sensor == Sensor::accel_scale;
  // At rest a gyro's scale factor acts on the earth's rate only.
  if (sensor != Sensor::gyro_scale) {
    evaluate({piece.table_rad, piece.temperature_c, piece.turn});
    if (sensor == Sensor::accel_scale) value *= piece.C_nb(1, axis);
    part.of.row((gyro ? 0 : 3) + axis) = value.transpose();
  }
  for (const Turn& turn : piece.turns) {
    evaluate({turn.table_rad, turn.temperature_c, turn.turn, turn.rate_radps()});
    const Matrix3d& psi = scale ? turn.turned : turn.pushed;
    const Matrix3d& v = gyro ? (scale ? turn.fallen_turned : turn.fallen_pushed) : (scale ? turn.lifted : turn.pushed);
    if (gyro) part.of.middleRows<3>(6) += psi.col(axis) * value.transpose();
    part.of.middleRows<3>(9) += v.col(axis) * value.transpose();
  }
  return part;
}

}  // namespace

std::string words_of(DisturbedSensor sensor, int axis) {
  static constexpr const char* words[] = {"bias of gyro ", "scale factor of gyro ", "bias of accelerometer ",
                                          "scale factor of accelerometer "};
  return std::string(words[static_cast<int>(sensor)]) + "xyz"[axis];
}

void write_curve(double x, double* out) {
  for (int k = 1; k <= curve_waves; ++k) {
    out[2 * k - 2] = std::sin(0.5 * pi * k * x) / k;
    out[2 * k - 1] = (1.0 - std::cos(0.5 * pi * k * x)) / k;
  }
}

std::vector<Family> nameless_families(const std::vector<Piece>& pieces) {
  std::vector<Family> families;
  for (const Function& function : functions_of(pieces)) {
    const auto f = std::make_shared<const Function>(function);
    for (const Sensor sensor : {Sensor::gyro_bias, Sensor::gyro_scale, Sensor::accel_bias, Sensor::accel_scale})
      for (int axis = 0; axis < 3; ++axis)
        families.push_back(
            {f->kind,
             words_of(sensor, axis) + " " + f->what,
             {f->count, [=](const Piece& piece) { return weights_on(piece, sensor, axis, *f); }, f->summed},
             sensor,
             axis});
  }
  return families;
}

namespace {

// A family's coefficients along the directions that the data tell apart.
struct Along {
  SymmetricEigen eigen;
  VectorXd information, score;  // 0 where the model imitates a direction
  VectorXd part(double v) const { return v / (1.0 + v * information.array()); }
  double gain(double v) const { return score.cwiseAbs2().dot(part(v)) - (1.0 + v * information.array()).log().sum(); }
};
Along along(const MatrixXd& Q, const VectorXd& s, const VectorXd& before) {
  Along a = {symmetric_eigen(Q), {}, {}};
  const auto seen = a.eigen.values.array() > limits.family_floor * before.maxCoeff();
  a.information = seen.select(a.eigen.values, 0.0);
  a.score = seen.select(a.eigen.vectors.transpose() * s, 0.0);
  return a;
}

}  // namespace

FamilyFit fit_family(const MatrixXd& Q, const VectorXd& s, const VectorXd& before) {
  FamilyFit fit;
  const Along a = along(Q, s, before);
  const double mean = a.information.mean();
  if (!(mean > 0.0)) return fit;
  double best = 0.0;
  for (double log_v = -4.0; log_v <= 6.0; log_v += 0.25) {
    const double v = std::exp(log_v * std::log(10.0) / 2.0) / mean;
    const double gain = a.gain(v);
    if (gain <= fit.gain) continue;
    fit.gain = gain;
    best = v;
  }
  if (best > 0.0) fit.mean = a.eigen.vectors * a.score.cwiseProduct(a.part(best));
  fit.weights = a.part(1.0 / mean);
  fit.statistic = a.score.cwiseAbs2().dot(fit.weights);
  fit.weights = fit.weights.cwiseProduct(a.information);
  return fit;
}

std::vector<FamilyFit> fit_families(const SegmentScores& scores, const std::vector<Family>& families) {
  constexpr Eigen::Index at_once = 400;  // columns: every family of a two-hour run by kinds, fewer in a day
  std::vector<FamilyFit> fits;
  std::vector<Weights> weights;
  Eigen::Index columns = 0;
  for (const Family& family : families) {
    weights.push_back(family.weights);
    columns += family.weights.columns;
    if (columns < at_once && &family != &families.back()) continue;
    for (const SegmentScores::Test& test : scores.tests(weights)) {
      fits.push_back(fit_family(test.Q, test.s, test.before));
      if (fits.back().mean.size() > 0) fits.back().shift = test.shift * fits.back().mean;
    }
    weights.clear();
    columns = 0;
  }
  return fits;
}

std::vector<VectorXd> unseen_scatter(const SegmentScores& scores, const std::vector<Family>& families) {
  std::vector<VectorXd> shifts;
  for (const Family& family : families) {
    if (family.kind != "scatter" || family.sensor != Sensor::gyro_scale) continue;
    const SegmentScores::Test test = scores.tests({family.weights}).front();
    const Along a = along(test.Q, test.s, test.before);
    VectorXd square = VectorXd::Zero(test.s.size());
    double sum = 0.0;
    for (double log_size = -3.0; log_size <= 3.0; log_size += 0.25) {
      const double v = std::pow(limits.usual_scatter * std::exp(log_size), 2);
      // Of log(size): its density is size / (1 + (size / usual)^2)^2, of which the mean square is that of the usual one.
      const double weight = std::exp(log_size + 0.5 * a.gain(v)) / std::pow(1.0 + std::exp(2.0 * log_size), 2);
      square += weight * (a.part(v) + a.score.cwiseProduct(a.part(v)).cwiseAbs2());
      sum += weight;
    }
    const MatrixXd moved = test.shift * a.eigen.vectors * (square / sum).cwiseSqrt().asDiagonal();
    for (Eigen::Index k = 0; k < moved.cols(); ++k) shifts.emplace_back(moved.col(k));
  }
  return shifts;
}

}  // namespace turncal
