#include "calib/rests/single_pose.h"

#include <algorithm>
#include <cmath>

#include "calib/model/effects.h"
#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index most_batches = 200;
constexpr double alias_correlation = SelectionLimits{}.alias_correlation;

struct Series {  // batch means
  VectorXd time_s;
  VectorXd temperature_c;  // less its mean; empty: no thermometer, or too small a range
  MatrixXd reading;        // six columns, SI
};

Series batches(const CompressedRecording& recording) {
  const SensorModel model = sensor_model(start_parameters(recording.info), recording.info);
  std::vector<const Block*> still;
  for (const Block& block : recording.blocks)
    if (block.whole_second) still.push_back(&block);
  const auto count = std::min<Index>(most_batches, still.size());
  Series series;
  series.time_s.setZero(count);
  series.reading.setZero(count, 6);
  VectorXd temperature = VectorXd::Zero(count);
  VectorXd members = VectorXd::Zero(count);
  for (std::size_t k = 0; k < still.size(); ++k) {
    const Block& block = *still[k];
    const Index at = k * count / still.size();
    series.time_s[at] += recording.middle_s(block);
    series.reading.row(at).head<3>() += (model.gyro_scale * block.gyro / block.duration_s).transpose();
    series.reading.row(at).tail<3>() += (model.accel_scale * block.accel / block.duration_s).transpose();
    temperature[at] += double(block.temperature_c);
    members[at] += 1.0;
  }
  series.time_s.array() /= members.array();
  temperature.array() /= members.array();
  series.reading.array().colwise() /= members.array();
  if (recording.info.has_temperature && temperature.allFinite() &&
      temperature.maxCoeff() - temperature.minCoeff() > rest_limits.least_temperature_span_c)
    series.temperature_c = temperature.array() - temperature.mean();
  return series;
}

struct Fit {
  VectorXd value, sigma;  // of the columns, without the constant
  double bic = 0.0;
};

Fit fit(const VectorXd& y, const std::vector<VectorXd>& columns) {
  const Index n = y.size();
  const Index p = columns.size() + 1;
  MatrixXd A(n, p);
  A.col(0).setOnes();
  for (Index k = 1; k < p; ++k) A.col(k) = columns[k - 1];
  const VectorXd x = least_squares(A, y).x;
  const double variance = (y - A * x).squaredNorm() / double(n - p);
  const MatrixXd information = A.transpose() * A;
  Fit result;
  result.value = x.tail(p - 1);
  result.sigma = (inverse(information).diagonal().tail(p - 1) * variance).cwiseSqrt();
  result.bic = double(n) * std::log(std::max(variance, 1e-300)) + double(p) * std::log(double(n));
  return result;
}

double correlation(const VectorXd& a, const VectorXd& b) {
  const VectorXd x = a.array() - a.mean();
  const VectorXd y = b.array() - b.mean();
  return std::abs(x.dot(y)) / std::max(x.norm() * y.norm(), 1e-300);
}

struct TimeShape {
  std::string effect;  // empty: no change with time
  double tau_s = 0.0;
  VectorXd column;
};

std::vector<TimeShape> time_shapes(const std::string& triad, const VectorXd& time_s) {
  std::vector<TimeShape> shapes(1);
  shapes.push_back({triad + "_bias_drift", 0.0, time_s / 3600.0});
  const EffectEntry* warm_up = find_effect(triad + "_warm_up");
  if (warm_up != nullptr)
    for (const double tau : warm_up->taus_s)
      if (tau < 0.5 * time_s[time_s.size() - 1])  // a slower one is a drift
        shapes.push_back({triad + "_warm_up", tau, (-time_s.array() / tau).exp().matrix()});
  return shapes;
}

void add_axis(const Series& series, int channel, std::vector<PoseCoefficient>& out) {
  const std::string triad = channel < 3 ? "gyro" : "accel";
  const std::string axis(1, "xyz"[channel % 3]);
  const VectorXd y = series.reading.col(channel);
  const bool thermal = series.temperature_c.size() > 0;
  const auto with = [&](const TimeShape& shape, bool temperature) {
    std::vector<VectorXd> columns;
    if (!shape.effect.empty()) columns.push_back(shape.column);
    if (temperature) columns.push_back(series.temperature_c);
    return columns;
  };
  const std::vector<TimeShape> shapes = time_shapes(triad, series.time_s);
  const auto best_of = [&](bool temperature) {
    std::size_t best = 0;
    double lowest = INFINITY;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      if (temperature && k > 0 && correlation(shapes[k].column, series.temperature_c) > alias_correlation) continue;
      const double bic = fit(y, with(shapes[k], temperature)).bic + (shapes[k].tau_s > 0.0 ? std::log(200.0) : 0.0);
      if (bic < lowest) {
        lowest = bic;
        best = k;
      }
    }
    return best;
  };
  const auto add = [&](const std::string& effect, double tau_s, double value, double sigma, bool alias) {
    const EffectEntry* entry = find_effect(effect);
    if (entry == nullptr) return;
    // The change of the reading is what the effect adds to it; `si` is one unit of the effect (of a drift, after an hour).
    out.push_back({effect + "." + axis, std::string(entry->unit), value / entry->si, sigma / entry->si, tau_s, alias});
  };
  const std::size_t alone = best_of(false);
  const bool alias =
      thermal && alone > 0 && correlation(shapes[alone].column, series.temperature_c) > alias_correlation;
  const std::size_t chosen = thermal && !alias ? best_of(true) : alone;
  const Fit both = fit(y, with(shapes[chosen], thermal && !alias));
  if (chosen > 0) add(shapes[chosen].effect, shapes[chosen].tau_s, both.value[0], both.sigma[0], alias);
  if (!thermal) return;
  const Fit of_temperature = alias ? fit(y, with(TimeShape{}, true)) : both;
  const Index last = of_temperature.value.size() - 1;
  add(triad + "_bias_temperature", 0.0, of_temperature.value[last], of_temperature.sigma[last], alias);
}

}  // namespace

Result<SinglePose> analyse_single_pose(const CompressedRecording& recording) {
  SinglePose pose;
  for (const Block& block : recording.blocks) pose.duration_s += block.whole_second ? block.duration_s : 0.0;
  if (pose.duration_s < rest_limits.least_pose_s)
    return input_error("one pose of " + std::to_string(std::lround(pose.duration_s)) +
                       " s: expected at least 100 s for noise and coefficients, or rests in several poses");
  pose.noise = allan_deviation(recording, start_parameters(recording.info));
  const Series series = batches(recording);
  for (int channel = 0; channel < 6; ++channel) add_axis(series, channel, pose.coefficients);
  return pose;
}

}  // namespace turncal
