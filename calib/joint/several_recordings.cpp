#include "calib/joint/several_recordings.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

constexpr int biases = 6;

// Returns the place of a recording's column among all: those of the first, then six biases of every further one.
int place(int column, std::size_t recording) {
  if (column >= biases || recording == 0) return column;
  return parameter_count + biases * int(recording - 1) + column;
}

struct Whole {
  std::vector<int> subset;  // of all columns
  Eigen::VectorXd begin;    // point of expansion of the sums
  Eigen::VectorXd ranges;
  std::vector<Quadratic> parts;
  Quadratic sum;
};

Quadratic sum_of(const std::vector<Quadratic>& parts) {
  Quadratic sum = parts.front();
  for (std::size_t k = 1; k < parts.size(); ++k) {
    sum.A += parts[k].A;
    sum.c += parts[k].c;
  }
  return sum;
}

Whole add_up(const std::vector<JointResult>& estimates) {
  const Eigen::Index columns = parameter_count + biases * (estimates.size() - 1);
  Whole w;
  w.begin.setZero(columns);
  w.ranges.setOnes(columns);
  const Quadratic nothing = {Eigen::MatrixXd::Zero(columns, columns), Eigen::VectorXd::Zero(columns)};
  w.begin.head<parameter_count>() = to_vector(estimates.front().parameters);
  for (std::size_t k = 0; k < estimates.size(); ++k)
    for (int column = 0; column < biases; ++column) {
      w.begin[place(column, k)] = to_vector(estimates[k].parameters)[column];
      w.ranges[place(column, k)] = estimates[k].ranges[column];
    }
  w.ranges.segment(biases, parameter_count - biases) =
      estimates.front().ranges.segment(biases, parameter_count - biases);
  for (std::size_t k = 0; k < estimates.size(); ++k) {
    const JointResult& e = estimates[k];
    const ParameterVector at = to_vector(e.parameters);
    const Eigen::MatrixXd I = information_of(e);
    std::vector<int> places;
    for (const int column : e.free) places.push_back(place(column, k));
    const Eigen::VectorXd off = Eigen::VectorXd(w.begin(places)) - Eigen::VectorXd(at(e.free));
    const Eigen::VectorXd g = Eigen::VectorXd(e.last.gradient(e.free)) + I * off;
    Quadratic& part = w.parts.emplace_back(nothing);
    part.A(places, places) = I;
    part.c(places) = g;
  }
  w.sum = sum_of(w.parts);
  for (int column = 0; column < columns; ++column)
    if (w.sum.A(column, column) > 0.0) w.subset.push_back(column);
  return w;
}

const std::vector<EffectEntry>& turn_on_entries() {
  using Out = Eigen::Ref<Eigen::Matrix3Xd>;
  constexpr std::string_view term = "bias of this recording less that of the first";
  static const std::vector<std::string_view> xyz = {"x", "y", "z"};
  static const std::vector<double> none;
  static const std::vector<EffectEntry> entries = {
      {"turn_on_gyro_bias", Sensor::gyro, Quantity::bias, Driver::time, term, "c", "deg/h", xyz, radps_per_degph, "",
       [](const BlockState&, const Site&, double, Out g, Out) { g.setIdentity(); }, none, "tau_s", true},
      {"turn_on_accel_bias", Sensor::accelerometer, Quantity::bias, Driver::time, term, "c", "g", xyz,
       standard_gravity_mps2, "", [](const BlockState&, const Site&, double, Out, Out a) { a.setIdentity(); }, none,
       "tau_s", true},
  };
  return entries;
}

void append(const CompressedRecording& part, CompressedRecording& data) {
  const std::int64_t later = data.segments.back().end_sample - part.segments.front().start_sample;
  const auto segments = std::int32_t(data.segments.size());
  for (Segment segment : part.segments) {
    segment.start_sample += later;
    segment.end_sample += later;
    data.segments.push_back(segment);
  }
  for (Block block : part.blocks) {
    block.start_sample += later;
    block.segment += segments;
    data.blocks.push_back(block);
  }
  for (DataEvent event : part.events) {
    event.sample += later;
    data.events.push_back(event);
  }
  const double before = double(data.samples), added = double(part.samples);
  data.mean_temperature_c = (before * data.mean_temperature_c + added * part.mean_temperature_c) / (before + added);
  data.samples += part.samples;
  data.info.has_temperature = data.info.has_temperature && part.info.has_temperature;
}

}  // namespace

Eigen::MatrixXd information_of(const JointResult& e) {
  if (!e.undetermined.empty()) return e.last.information(e.free, e.free);
  return balanced_inverse(e.covariance);
}

JointResult estimate_beside(const CompressedRecording& recording, const Parameters& known) {
  JointOptions options;
  options.start = known;
  options.free_parameters = {0, 1, 2, 3, 4, 5};
  JointResult e = joint_estimate(recording, options);
  if (!e.converged) return e;
  e.free = free_parameters();
  const SubsetSolution solution = solve_subset(e.last.information, e.last.gradient, e.free, e.ranges);
  e.covariance = solution.covariance;
  e.unseen_instability.setZero(e.covariance.rows(), e.covariance.cols());
  e.undetermined.assign(solution.undetermined.cols(), {});
  for (std::size_t i = 0; i < e.free.size(); ++i) e.determined[e.free[i]] = solution.lost[i] == 0;
  return e;
}

TurnOns turn_ons_of(const Eigen::VectorXd& values, const Eigen::MatrixXd& covariance) {
  TurnOns result;
  const Eigen::Index count = values.size() / biases;
  const double n = double(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    result.biases.emplace_back(values.segment<biases>(biases * k));
    result.sigma.emplace_back(covariance.diagonal().segment<biases>(biases * k).cwiseMax(0.0).cwiseSqrt());
    result.mean += result.biases.back() / n;
  }
  if (count < 2) return result;
  Biases excess = Biases::Zero();
  for (std::size_t k = 0; k < result.biases.size(); ++k)
    excess += (result.biases[k] - result.mean).cwiseAbs2() / (n - 1.0) - result.sigma[k].cwiseAbs2() / n;
  result.repeatability = excess.cwiseMax(0.0).cwiseSqrt();
  return result;
}

Fall fall_of(const Quadratic& q, const Eigen::VectorXd& ranges) {
  std::vector<int> known;
  for (int k = 0; k < int(q.c.size()); ++k)
    if (q.A(k, k) > 0.0) known.push_back(k);
  const SubsetSolution solution = solve_subset(q.A, q.c, known, ranges);
  return {-solution.step.dot(Eigen::VectorXd(q.c(known))), int(known.size()) - int(solution.undetermined.cols())};
}

Fall disagreement(const std::vector<Quadratic>& parts, const Eigen::VectorXd& ranges) {
  Fall apart;
  for (const Quadratic& part : parts) {
    const Fall alone = fall_of(part, ranges);
    apart.chi_square += alone.chi_square;
    apart.degrees += alone.degrees;
  }
  const Fall together = fall_of(sum_of(parts), ranges);
  return {apart.chi_square - together.chi_square, apart.degrees - together.degrees};
}

SeveralRecordings combine_recordings(const std::vector<JointResult>& estimates) {
  const Whole w = add_up(estimates);
  const SubsetSolution solution = solve_subset(w.sum.A, w.sum.c, w.subset, w.ranges);
  Eigen::VectorXd all = w.begin;
  all(w.subset) += solution.step;
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(all.size(), all.size());
  covariance(w.subset, w.subset) = solution.covariance;

  SeveralRecordings result;
  const double n = double(estimates.size());
  const Fall apart = disagreement(w.parts, w.ranges);
  result.disagreement = apart.chi_square;
  result.degrees = apart.degrees;
  result.p_value = chi_square_tail(result.disagreement, result.degrees);
  result.agree = result.p_value > agreement_limits.chance;
  if (!result.agree) covariance *= result.disagreement / std::max(result.degrees, 1);

  // The mean biases and the common parameters, as one linear map of all columns.
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(parameter_count, all.size());
  for (int column = 0; column < parameter_count; ++column)
    for (std::size_t k = 0; k < (column < biases ? estimates.size() : 1); ++k)
      T(column, place(column, k)) = column < biases ? 1.0 / n : 1.0;
  const ParameterVector mean = T * all;
  Eigen::MatrixXd of_unit = T * covariance * T.transpose();
  std::vector<int> of_each;
  for (std::size_t k = 0; k < estimates.size(); ++k)
    for (int column = 0; column < biases; ++column) of_each.push_back(place(column, k));
  result.turn_ons = turn_ons_of(all(of_each), covariance(of_each, of_each));
  of_unit.diagonal().head<biases>() += result.turn_ons.repeatability.cwiseAbs2() / n;

  JointResult& unit = result.unit = estimates.front();
  unit.parameters = from_vector(mean);
  unit.covariance = of_unit(unit.free, unit.free);
  unit.undetermined.clear();
  for (const int column : unit.free) {
    bool determined = true;
    for (std::size_t i = 0; i < w.subset.size(); ++i)
      for (std::size_t k = 0; k < estimates.size(); ++k)
        if (w.subset[i] == place(column, k) && solution.lost[i] != 0) determined = false;
    unit.determined[column] = determined;
    unit.sigma[column] = determined ? std::sqrt(of_unit(column, column)) : 0.0;
  }
  return result;
}

JoinedRecordings join_recordings(const std::vector<const CompressedRecording*>& parts) {
  JoinedRecordings joined{parts, *parts.front(), {}, {}};
  for (std::size_t k = 1; k < parts.size(); ++k) {
    joined.begins.push_back(joined.data.blocks.size());
    append(*parts[k], joined.data);
    for (const EffectEntry& entry : turn_on_entries())
      for (int axis = 0; axis < 3; ++axis) joined.turn_ons.push_back({&entry, axis, 0.0, int(k)});
  }
  return joined;
}

bool is_turn_on(const EffectColumn& column) {
  const std::vector<EffectEntry>& all = turn_on_entries();
  return std::ranges::any_of(all, [&](const EffectEntry& e) { return &e == column.entry; });
}

bool is_gyro_turn_on(const EffectColumn& column) { return column.entry == &turn_on_entries().front(); }

std::optional<SeveralRecordings> contradiction(const JoinedRecordings& recordings, const JointResult& together) {
  if (recordings.parts.size() < 2 || together.whiteness.white) return std::nullopt;
  std::vector<JointResult> alone;
  for (const CompressedRecording* part : recordings.parts) {
    alone.push_back(joint_estimate(*part));
    if (!alone.back().converged || !alone.back().whiteness.white) return std::nullopt;
  }
  SeveralRecordings result = combine_recordings(alone);
  if (result.agree) return std::nullopt;
  return result;
}

OfEachRecording leave_what_is_common(JointResult& e, std::size_t recordings, Eigen::MatrixXd* also) {
  OfEachRecording each;
  const Eigen::Index n = recordings;
  const Eigen::Index old = e.free.size();
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(old, old);  // from the free columns to the common ones
  Eigen::MatrixXd biases = Eigen::MatrixXd::Zero(6 * n, old);
  Eigen::VectorXd values(6 * n);
  for (Eigen::Index k = 0; k < n; ++k) values.segment<6>(6 * k) = to_vector(e.parameters).head<6>();
  std::vector<int> free;
  std::vector<EstimatedEffect> common;
  for (Eigen::Index i = 0; i < old; ++i) {
    const int column = e.free[i];
    if (column < parameter_count) {
      unit(free.size(), i) = 1.0;
      free.push_back(column);
      for (Eigen::Index k = 0; k < n && column < 6; ++k) biases(6 * k + column, i) = 1.0;
      continue;
    }
    const EstimatedEffect& effect = e.effects[column - parameter_count];
    if (is_turn_on(effect.column)) {
      const int bias = effect.column.component + (is_gyro_turn_on(effect.column) ? 0 : 3);
      const auto row = std::ranges::find(free, bias) - free.begin();
      if (row < std::ptrdiff_t(free.size())) unit(row, i) = 1.0 / double(n);
      biases(6 * effect.column.recording + bias, i) = 1.0;
      values[6 * effect.column.recording + bias] += effect.value;
    } else if (effect.column.recording > 0) {
      each.effects.push_back(effect);
    } else {
      unit(free.size(), i) = 1.0;
      free.push_back(parameter_count + int(common.size()));
      common.push_back(effect);
    }
  }
  unit.conservativeResize(free.size(), old);
  each.turn_ons = turn_ons_of(values, biases * e.covariance * biases.transpose());
  const TurnOns& turn_ons = each.turn_ons;
  const auto of_unit = [&](const Eigen::MatrixXd& covariance) {
    Eigen::MatrixXd result = unit * covariance * unit.transpose();
    for (std::size_t i = 0; i < free.size(); ++i)
      if (free[i] < 6) result(i, i) += std::pow(turn_ons.repeatability[free[i]], 2) / double(n);
    return result;
  };
  for (Eigen::MatrixXd* covariance : {&e.covariance, also})
    if (covariance != nullptr && covariance->rows() == old) *covariance = of_unit(*covariance);
  ParameterVector parameters = to_vector(e.parameters);
  parameters.head<6>() = turn_ons.mean;
  e.parameters = from_vector(parameters);
  e.free = std::move(free);
  e.effects = std::move(common);
  for (std::size_t i = 0; i < e.free.size(); ++i)
    if (e.free[i] < 6 && e.sigma[e.free[i]] > 0.0) e.sigma[e.free[i]] = std::sqrt(e.covariance(i, i));
  return each;
}

}  // namespace turncal
