#include "calib/rest_diagnosis/rest_name_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/model/limits.h"
#include "calib/rest_diagnosis/curve_of_two.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int time_waves = 6, steps = 24, waves = 2;
constexpr int of_time = 0, of_steps = time_waves, of_force = of_steps + steps, of_rate = of_force + 6 * waves,
              functions = of_rate + 6 * waves;

constexpr LackOfFitLimits limits;

// What goes with a rate or a force by a curve, x up to +-1: two waves, odd and even, with sizes 1/k.
void write_curve(double x, double* out) {
  for (int k = 1; k <= waves; ++k) {
    out[2 * k - 2] = std::sin(0.5 * pi * k * x) / k;
    out[2 * k - 1] = (1.0 - std::cos(0.5 * pi * k * x)) / k;
  }
}

struct FamilyFit {
  double gain = 0.0;  // of 2 ln L at the best variance; 0: none
  VectorXd mean;      // of the coefficients at that variance
};

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
  return fit;
}

struct RestFamily {
  std::string what;
  Index first = 0, count = 0;  // columns
};

VectorXd functions_at(const BlockState& s, double duration_s, const Vector3d& fastest_radps) {
  VectorXd value(functions);
  for (int k = 1; k <= time_waves; ++k) value[of_time + k - 1] = std::cos(pi * k * s.time_s / duration_s) / k;
  for (int k = 0; k < steps; ++k) value[of_steps + k] = s.time_s * (steps + 1) >= duration_s * (k + 1) ? 1.0 : 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    write_curve(s.f_b[axis] / standard_gravity_mps2, &value[of_force + 2 * waves * axis]);
    write_curve(s.w_b[axis] / fastest_radps[axis], &value[of_rate + 2 * waves * axis]);
  }
  return value;
}

// Columns: sensor by sensor, axis by axis, function by function.
std::vector<RestFamily> families() {
  static constexpr const char* sensors[] = {"bias of gyro ", "scale factor of gyro ", "bias of accelerometer ",
                                            "scale factor of accelerometer "};
  std::vector<RestFamily> all;
  for (int sensor = 0; sensor < 4; ++sensor)
    for (int axis = 0; axis < 3; ++axis) {
      const Index first = (3 * sensor + axis) * functions;
      const std::string what = std::string(sensors[sensor]) + "xyz"[axis];
      all.push_back({what + " with time", first + of_time, time_waves});
      all.push_back({what + " that wanders", first + of_steps, steps});
      for (int k = 0; k < steps; ++k) all.push_back({what + " that steps", first + of_steps + k, 1});
      for (int by = 0; by < 3; ++by) {
        all.push_back({what + " with the force along " + "xyz"[by], first + of_force + 2 * waves * by, 2 * waves});
        all.push_back({what + " with the rate about " + "xyz"[by], first + of_rate + 2 * waves * by, 2 * waves});
      }
    }
  return all;
}

Vector3d fastest_rates(const RestDiagnosisModel& m) {
  const SensorModel model = sensor_model(m.model.fit.parameters, m.data.recording->info);
  Vector3d fastest = Vector3d::Constant(1e-3);
  for (const Block& block : m.data.recording->blocks)
    fastest = fastest.cwiseMax((model.gyro_scale * block.gyro / block.duration_s - model.gyro_bias_radps).cwiseAbs());
  return fastest;
}

// The model's effects, then all functions of all families.
EffectModel with_families(const RestDiagnosisModel& m) {
  EffectModel model = m.effect_model(m.model);
  const int own = model.columns;
  model.columns += 12 * functions;
  VectorXd values = VectorXd::Zero(model.columns);
  values.head(own) = m.model.fit.effect_values;
  model.values = values;
  model.regressors = [inner = model.regressors, own, duration_s = m.duration_s, fastest = fastest_rates(m)](
                         const BlockState& s, EffectRegressors& out) {
    inner(s, out);
    const VectorXd value = functions_at(s, duration_s, fastest);
    out.gyro.rightCols(12 * functions).setZero();
    out.accel.rightCols(12 * functions).setZero();
    for (int sensor = 0; sensor < 4; ++sensor)
      for (int axis = 0; axis < 3; ++axis) {
        auto& columns = sensor < 2 ? out.gyro : out.accel;
        const double size = sensor == 1 ? s.w_b[axis] : sensor == 3 ? s.f_b[axis] : 1.0;
        columns.row(axis).segment(own + (3 * sensor + axis) * functions, functions) = size * value.transpose();
      }
  };
  return model;
}

// The whitened observations around the final model: residual, columns of parameters, of effects, of families.
class Rivals {
 public:
  explicit Rivals(const RestDiagnosisModel& m) : m_(m), families_(families()) {
    const RestSystem system = make_rest_system(m.data, m.model.fit.parameters, with_families(m), true);
    const VectorXd weights = rest_weights(system, m.model.fit.floors);
    J_ = weights.asDiagonal() * system.jacobian;
    residual_ = weights.cwiseProduct(system.residual);
    kind_ = system.kind;
    own_ = static_cast<Index>(m.model.columns.size());
  }

  struct Fits {
    double name = 0.0;                                       // 2 ln L that the effect columns gain
    std::vector<double> gain;                                // that each family gains in their place
    std::vector<VectorXd> shift;                             // of the 24 parameters with it
    std::vector<std::array<double, rest_kind_count>> share;  // in which kinds of observation it acts
  };
  // At the model without the effect columns `of`.
  Fits fits(const std::vector<Index>& of) const;
  // Kinds of observation in which columns show beyond the others of the model.
  std::array<double, rest_kind_count> shares(const std::vector<Index>& of) const;
  Eigen::Matrix2d information(Index a,
                              Index b) const;  // of two effect columns, everything else in the model eliminated
  const std::vector<RestFamily>& all() const { return families_; }

 private:
  MatrixXd others(const std::vector<Index>& of) const;
  std::array<double, rest_kind_count> share_by_kind(const MatrixXd& columns) const;
  const RestDiagnosisModel& m_;
  std::vector<RestFamily> families_;
  MatrixXd J_;
  VectorXd residual_;
  std::vector<RestKind> kind_;
  Index own_ = 0;
};

MatrixXd Rivals::others(const std::vector<Index>& of) const {
  MatrixXd base(J_.rows(), rest_parameter_count + own_ - static_cast<Index>(of.size()));
  Index at = 0;
  for (Index k = 0; k < rest_parameter_count + own_; ++k)
    if (std::find(of.begin(), of.end(), k - rest_parameter_count) == of.end())
      base.col(at++) = J_.col(k) / std::max(J_.col(k).norm(), 1e-300);
  return base;
}

std::array<double, rest_kind_count> Rivals::share_by_kind(const MatrixXd& columns) const {
  std::array<double, rest_kind_count> share{};
  for (Index row = 0; row < columns.rows(); ++row)
    share[static_cast<std::size_t>(kind_[static_cast<std::size_t>(row)])] += columns.row(row).squaredNorm();
  for (double& part : share) part /= std::max(columns.squaredNorm(), 1e-300);
  return share;
}

std::array<double, rest_kind_count> Rivals::shares(const std::vector<Index>& of) const {
  const MatrixXd Q = column_space(others(of));
  MatrixXd left(J_.rows(), static_cast<Index>(of.size()));
  for (std::size_t k = 0; k < of.size(); ++k) {
    const VectorXd column = J_.col(rest_parameter_count + of[k]);
    left.col(static_cast<Index>(k)) = (column - Q * (Q.transpose() * column)).normalized();
  }
  return share_by_kind(left);
}

Eigen::Matrix2d Rivals::information(Index a, Index b) const {
  const MatrixXd Q = column_space(others({a, b}));
  MatrixXd left(J_.rows(), 2);
  left << J_.col(rest_parameter_count + a), J_.col(rest_parameter_count + b);
  left -= Q * (Q.transpose() * left);
  return left.transpose() * left;
}

Rivals::Fits Rivals::fits(const std::vector<Index>& of) const {
  const MatrixXd base = others(of);
  const MatrixXd Q = column_space(base);
  const auto project = [&](const auto& x) { return (x - Q * (Q.transpose() * x)).eval(); };
  VectorXd raw = residual_;
  MatrixXd named(J_.rows(), static_cast<Index>(of.size()));
  for (std::size_t k = 0; k < of.size(); ++k) {
    named.col(static_cast<Index>(k)) = J_.col(rest_parameter_count + of[k]);
    raw -= named.col(static_cast<Index>(k)) * m_.model.fit.effect_values[of[k]];
  }
  const VectorXd r = project(raw);
  Fits fits;
  if (!of.empty()) {
    const MatrixXd own = project(named);
    fits.name = r.squaredNorm() - (r - own * least_squares(own, r).x).squaredNorm();
  }
  const MatrixXd columns = J_.rightCols(12 * functions);
  const MatrixXd left = project(columns);
  for (const RestFamily& family : families_) {
    const auto C = left.middleCols(family.first, family.count);
    const auto whole = columns.middleCols(family.first, family.count);
    const FamilyFit fit = fit_family(C.transpose() * C, -(C.transpose() * r), whole.colwise().squaredNorm());
    fits.gain.push_back(fit.gain);
    fits.share.push_back(share_by_kind(whole));
    fits.shift.push_back(VectorXd::Zero(parameter_count));
    if (!(fit.gain > std::max(0.0, fits.name - SelectionLimits().bic_margin))) continue;
    const VectorXd moved = -least_squares(base, raw + whole * fit.mean).x;
    for (int c = 0; c < rest_parameter_count; ++c)
      fits.shift.back()[free_parameters()[c]] = moved[c] / std::max(J_.col(c).norm(), 1e-300);
  }
  return fits;
}

}  // namespace

std::string why_names_fall(const RestDiagnosisModel& m, std::vector<VectorXd>& beside) {
  const Rivals rivals(m);
  const CurveOfTwo curve = curve_of_two(m.model.columns, m.model.fit.effect_values,
                                        [&rivals](int a, int b) { return rivals.information(a, b); });
  if (curve.found()) return curve.why + ": a " + curve.what;
  const Rivals::Fits left = rivals.fits({});
  char text[240];
  std::set<std::string_view> names;
  for (const EffectColumn& column : m.model.columns) names.insert(column.entry->name);
  for (const std::string_view name : names) {
    std::vector<Index> of;
    for (std::size_t k = 0; k < m.model.columns.size(); ++k)
      if (m.model.columns[k].entry->name == name) of.push_back(static_cast<Index>(k));
    const auto shares = rivals.shares(of);
    for (std::size_t k = 0; k < rest_kind_count; ++k)
      if (shares[k] > m.options.lives_in && m.model.fit.white_ratio[k] > m.options.unexplained_ratio) {
        std::snprintf(text, sizeof text, "with %s what is left of %s is still %.1f times the white noise",
                      std::string(name).c_str(), to_string(static_cast<RestKind>(k)), m.model.fit.white_ratio[k]);
        return text;
      }
    // What a family gains beside the name as well, or in other kinds of observation, does not speak against the name.
    const Rivals::Fits instead = rivals.fits(of);
    for (std::size_t f = 0; f < instead.gain.size(); ++f) {
      double common = 0.0;
      for (std::size_t k = 0; k < rest_kind_count; ++k) common += std::min(shares[k], instead.share[f][k]);
      if (common < m.options.lives_in) continue;
      const double gain = instead.gain[f] - left.gain[f];
      if (gain > instead.name - SelectionLimits().bic_margin) beside.push_back(instead.shift[f]);
      if (gain <= instead.name - SelectionLimits().family_margin) continue;
      std::snprintf(text, sizeof text, "a %s (2 ln L %.1f) explains it as well as %s (%.1f)",
                    rivals.all()[f].what.c_str(), gain, std::string(name).c_str(), instead.name);
      return text;
    }
  }
  // The likelihood ratio of a family has the mean 1 where it is not there, so it exceeds 1/p with a probability of p at most (Markov).
  const auto worst = std::max_element(left.gain.begin(), left.gain.end());
  if (!(*worst > 2.0 * std::log(static_cast<double>(left.gain.size()) / m.options.false_alarm))) return {};
  std::snprintf(text, sizeof text, "a residual is left that looks like a %s (2 ln L %.1f)",
                rivals.all()[static_cast<std::size_t>(worst - left.gain.begin())].what.c_str(), *worst);
  return text;
}

}  // namespace turncal
