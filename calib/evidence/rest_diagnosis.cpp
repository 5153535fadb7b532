#include "calib/evidence/rest_diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/evidence/evidence.h"
#include "calib/evidence/felt_latitude.h"
#include "calib/evidence/holdout.h"
#include "calib/model/parameters.h"
#include "calib/rests/rest_units.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Floors are sought from those that the most probable model leaves, and from this part of the base floors: a missing
// effect of all three axes is not found beside a floor that contains it.
constexpr double low_floors = 0.3;
constexpr int most_floors = 4;        // iterations
constexpr double same_floors = 0.05;  // relative

// Cuts hand-turned data into pieces. An epoch is a rest with the turn before it.
Pieces cells_of(const RestData& data, const SensorModel& model) {
  const std::vector<Block>& blocks = data.recording->blocks;
  Pieces pieces;
  pieces.cell_of_block.assign(blocks.size(), -1);
  const auto cell = [&](std::size_t first, std::size_t end, bool turns) {
    if (first >= end) return;
    pieces.cells.emplace_back();
    pieces.cells.back().turns = turns;
    pieces.cells.back().epoch = int(pieces.pieces.size());
    std::fill(pieces.cell_of_block.begin() + std::ptrdiff_t(first), pieces.cell_of_block.begin() + std::ptrdiff_t(end),
              std::ssize(pieces.cells) - 1);
  };
  for (std::size_t k = 0; k < data.rests.size(); ++k) {
    Piece piece;
    piece.turn = int(k);
    piece.first_cell = pieces.cells.size();
    if (k > 0) {
      const RestLeg& leg = data.legs[k - 1];
      std::size_t first = leg.first_block;
      double turned = 0.0;
      for (std::size_t b = first; b < leg.end_block; ++b) {
        turned += (model.gyro_scale * blocks[b].gyro).norm();
        if (turned < part_rad && b + 1 < leg.end_block) continue;
        cell(first, b + 1, true);
        first = b + 1;
        turned = 0.0;
      }
    }
    const Rest& rest = data.rests[k];
    cell(rest.whole.first_block, rest.first_edge.end_block, false);
    cell(rest.first_edge.end_block, rest.last_edge.first_block, false);
    cell(rest.last_edge.first_block, rest.whole.end_block, false);
    piece.rest_cell = pieces.cells.size() - 1;
    pieces.pieces.push_back(piece);
  }
  pieces.epochs = int(pieces.pieces.size());
  return pieces;
}

// Returns the effects of the model and six columns per cell: an excess of one unit in each of its readings. `states`: filled by block.
EffectModel with_readings(const CompressedRecording& recording, EffectModel model, const Pieces& pieces,
                          std::vector<BlockState>& states) {
  std::vector<double> middles;
  for (const Block& block : recording.blocks) middles.push_back(recording.middle_s(block));
  const Index own = model.columns, all = own + 6 * static_cast<Index>(pieces.cells.size());
  model.columns = int(all);
  model.values.conservativeResize(all);
  model.values.tail(all - own).setZero();
  model.regressors = [inner = model.regressors, own, &pieces, &states, middles, last = Index{own}](
                         const BlockState& s, EffectRegressors& out) mutable {
    if (own > 0) inner(s, out);
    out.gyro.middleCols(last, std::min<Index>(6, out.gyro.cols() - last)).setZero();
    out.accel.middleCols(last, std::min<Index>(6, out.accel.cols() - last)).setZero();
    const auto block = std::size_t(std::ranges::lower_bound(middles, s.time_s) - middles.begin());
    states[block] = s;
    last = own + 6 * static_cast<Index>(pieces.cell_of_block[block]);
    out.gyro.middleCols<3>(last).setIdentity();
    out.accel.middleCols<3>(last + 3).setIdentity();
  };
  return model;
}

// Sets the system and the responses of `view` from `system`, over the sigmas of its rows; columns: 21 parameters, `own` effects, the cells' readings.
void set_floors(const RestSystem& system, const RestFloors& floors, Index own, bool accelerometers,
                PiecewiseView& view) {
  const VectorXd weights = rest_weights(system, floors);
  const MatrixXd J = weights.asDiagonal() * system.jacobian;
  view.system = std::make_unique<PieceSystem>(J.leftCols(rest_parameter_count), weights.cwiseProduct(system.residual),
                                              -2.0 * weights.array().log().sum());
  view.pieces.responses.clear();
  for (std::size_t c = 0; c < view.pieces.cells.size(); ++c) {
    view.pieces.responses.emplace_back(J.middleCols<6>(rest_parameter_count + own + 6 * static_cast<Index>(c)));
    if (!accelerometers) view.pieces.responses.back().rightCols<3>().setZero();
  }
}

// Returns the floors beside the most probable model, by the redundancy that it leaves in each kind.
RestFloors floors_beside(const RestSystem& system, const RestFloors& floors, const UnderNoise& under,
                         const WeighedModel& model) {
  const Index rows = system.residual.size();
  const Explained explained = explained_by(under, model);
  const VectorXd left = (under.system->scores() - explained.Y * explained.w).head(rows);
  const MatrixXd Q = under.system->times(MatrixXd::Identity(explained.Y.rows(), explained.Y.rows()));
  const VectorXd redundant = (Q.diagonal() - explained.Y.rowwise().squaredNorm()).head(rows);
  RestSystem beside = system;
  beside.residual = left.cwiseQuotient(rest_weights(system, floors));
  std::array<double, rest_kind_count> freedom{};
  for (Index k = 0; k < rows; ++k) freedom[index(system.kind[std::size_t(k)])] += redundant[k];
  return estimate_floors(beside, freedom);
}

bool alike(const RestFloors& a, const RestFloors& b) { return ((a - b).abs() <= same_floors * a.max(b)).all(); }

// Returns the white noise of the gyros and accelerometers.
NoiseModel rest_noise(const RestData& data, const Parameters& parameters) {
  const SensorModel model = sensor_model(parameters, data.recording->info);
  NoiseModel noise;
  noise.angle_random_walk = (model.gyro_scale * data.gyro_white).cwiseAbs();
  noise.velocity_random_walk = (model.accel_scale * data.accel_white).cwiseAbs();
  return noise;
}

// Returns the reference of temperature effects: the mean of the recording, 0 without a thermometer.
double rest_reference_temperature_c(const RestData& data) {
  const double mean = data.recording->mean_temperature_c;
  return std::isnan(mean) ? 0.0 : mean;
}

EffectModel rest_effects(const RestData& data, const std::vector<EstimatedEffect>& effects) {
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& effect : effects) columns.push_back(effect.column);
  auto model = make_effect_model(columns, {data.recording->info.latitude_deg}, rest_reference_temperature_c(data));
  for (std::size_t k = 0; k < effects.size(); ++k) model.values[static_cast<Index>(k)] = effects[k].value;
  return model;
}

// Weighs the evidence about `fit` with its `effects`; `without`: floors of the 21 parameters alone; `accelerometers`: their errors are tested too.
Evidence weigh_rests(const RestData& data, const RestFit& fit, const std::vector<EstimatedEffect>& effects,
                     const RestFloors& without, bool accelerometers) {
  const CompressedRecording& recording = *data.recording;
  std::vector<EffectColumn> catalogue = catalogue_columns(recording.info);
  // The heading is open: of the effects fixed to the Earth only its rate about the vertical is observable.
  std::erase_if(catalogue, [](const EffectColumn& c) { return c.entry->driver == Driver::field; });
  catalogue.push_back(vertical_earth_rate());
  catalogue = columns_beside(effects, std::move(catalogue), !effects.empty());
  const EffectModel of_fit = rest_effects(data, effects);
  PiecewiseView first;
  first.columns.assign(free_parameters().begin(), free_parameters().end());
  first.pieces = cells_of(data, sensor_model(fit.parameters, recording.info));
  first.states.resize(recording.blocks.size());
  const RestSystem system =
      make_rest_system(data, fit.parameters, with_readings(recording, of_fit, first.pieces, first.states), true);
  average_cells(first.states, first.pieces);
  for (ErrorCell& cell : first.pieces.cells)  // with the heading, the Earth's rate is open
    if (!cell.turns) cell.at.w_b.setZero();
  const std::vector<Readings> readings =
      readings_of(make_effect_model(catalogue, {recording.info.latitude_deg}, of_fit.reference_temperature_c),
                  first.pieces, first.states);
  const NoiseModel noise = rest_noise(data, fit.parameters);
  struct AtFloors {
    RestFloors floors;
    PiecewiseView view;
    UnderNoise under;
    LogWeights models;
    Posterior posterior;
  };
  const auto at_floors = [&](const RestFloors& floors) {
    AtFloors at{floors, {}, {}, {}, {}};
    at.view.pieces = first.pieces;
    at.view.columns = first.columns;
    set_floors(system, floors, of_fit.columns, accelerometers, at.view);
    at.under = make_terms(*at.view.system, at.view.pieces, catalogue, readings, noise, fit.parameters, at.view.columns);
    put_back(effects, {}, *at.under.table, *at.view.system);
    if (!effects.empty()) score_again(at.under);
    at.models = weigh_models(at.under);
    at.posterior = posterior_of({at.models});
    return at;
  };
  AtFloors base = at_floors(without);
  std::optional<AtFloors> best;
  const auto follow = [&](RestFloors floors) {
    for (int k = 0; k < most_floors; ++k) {
      AtFloors at = at_floors(floors);
      const RestFloors next = floors_beside(system, floors, at.under, at.posterior.models.front());
      if (!best || at.posterior.log_evidence > best->posterior.log_evidence) best = std::move(at);
      if (alike(floors, next)) break;
      floors = next;
    }
  };
  const RestFloors low = low_floors * without;
  for (const RestFloors& start : {floors_beside(system, without, base.under, base.posterior.models.front()), low})
    if (!alike(start, without)) follow(start);
  Evidence result;
  result.columns = first.columns;
  std::vector<LogWeights> models;
  const auto take = [&](AtFloors at) {
    models.push_back(std::move(at.models));
    result.views.push_back(std::move(at.view));
    result.at_each_noise.push_back(std::move(at.under));
  };
  take(std::move(base));
  if (best && !alike(best->floors, without)) take(std::move(*best));
  conclude(posterior_of(models), effects, result);
  return result;
}

// ---- the diagnosis ----

std::string hangs_on_single_rests(RestKind kind, double left_out, double fitted) {
  if (!(left_out > rest_limits.most_leverage * fitted)) return {};
  return fmt::format(
      "in cross-validation the error of {} is {} times the fitted one: the fit depends on individual rests",
      to_string(kind), std::lround(left_out / fitted));
}

bool said_driver(const Statements& all, const Statement& node) {
  return std::ranges::any_of(all.nodes, [&](const Statement& s) {
    return s.probability >= said_from && !s.driver.empty() && s.formula.empty() && is_below(s, node);
  });
}

double root_mean_square(const VectorXd& residual, const VectorXd& weights) {
  const Eigen::ArrayXd normalised = residual.cwiseProduct(weights);
  const auto count = double((!normalised.isNaN()).count());
  return count > 0.0 ? std::sqrt(normalised.isNaN().select(0.0, normalised).square().sum() / count) : 0.0;
}

class DiagnosingRests {
 public:
  DiagnosingRests(const RestData& data, const RestData* holdout, RestDiagnosis& r)
      : data_(data), holdout_(holdout), r_(r), d_(r.diagnosis) {
    const std::vector<Block>& blocks = data.recording->blocks;
    duration_s_ = data.recording->middle_s(blocks.back()) + 0.5 * blocks.back().duration_s;
  }

  // Diagnoses r.base, which can be tested.
  void run() {
    r_.accel_not_tested =
        hangs_on_single_rests(RestKind::norm, r_.base.left_out.norm_rms_mps2, r_.base.errors.norm_rms_mps2);
    RestFit fit = r_.base;
    Evidence evidence = weigh(fit, {});
    list_candidates(evidence, duration_s_, d_);
    const std::vector<EffectColumn> named = fit_by_names(evidence, names_of, [&](const auto& more) {
      std::vector<EstimatedEffect> start;
      for (const EffectColumn& column : more) start.push_back({column, 0.0, 0.0});
      RestFit again = refine_rests(data_, r_.base.parameters, rest_effects(data_, start), r_.base.floors);
      if (!again.converged) return false;
      fit = std::move(again);
      evidence = weigh(fit, effects_of(fit, more));
      return true;
    });
    judge(evidence, fit, named);
    ask_held_out_data();
    list_names(evidence, d_);
    look_at_latitude();
  }

  // Adds the errors of base and final, tested or not.
  void add_errors() {
    const RestSystem before = rest_system_at(data_, d_.base, true), after = rest_system_at(data_, d_.extended, true);
    const VectorXd weights = rest_weights(after, r_.final.floors);
    d_.error_before = root_mean_square(before.residual, weights);
    d_.error_after = root_mean_square(after.residual, weights);
    if (r_.second_recording) return;
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    d_.holdout_source = "cross-validation over rests and rotations";
    d_.holdout_before = {
        root_mean_square(left_out_residual(before, rest_weights(before, r_.base.floors)), weights), none, none, 1, {}};
    d_.holdout_after = {root_mean_square(left_out_residual(after, weights), weights), none, none, 1, {}};
    r_.held_out_before = r_.base.left_out;
    r_.held_out_after = r_.final.left_out;
  }

 private:
  static std::vector<EstimatedEffect> effects_of(const RestFit& fit, const std::vector<EffectColumn>& columns) {
    std::vector<EstimatedEffect> effects;
    for (const EffectColumn& column : columns) {
      const auto k = std::ssize(effects);
      effects.push_back({column, fit.effect_values[k], fit.sigma[parameter_count + k]});
    }
    return effects;
  }
  // Poses taken in a regular order are confounded with time, so a name stands only where its driver is said.
  static std::vector<EffectColumn> names_of(const Evidence& e) {
    const TermTable& table = *e.at_each_noise.front().table;
    const auto is_named = [&](int c) {
      return std::ranges::count(e.named.columns, table.effects[std::size_t(c)].key(), &EffectColumn::key) > 0;
    };
    for (const Term& term : table.terms)
      if (std::ranges::any_of(term.columns, is_named) && !said_driver(e.statements, term.what)) return {};
    return named_columns(e);
  }
  Evidence weigh(const RestFit& fit, const std::vector<EstimatedEffect>& effects) const {
    return weigh_rests(data_, fit, effects, r_.base.floors, r_.accel_not_tested.empty());
  }

  void judge(const Evidence& e, const RestFit& fit, const std::vector<EffectColumn>& named) {
    judge_by(e.statements, !named.empty(), d_);
    if (!named.empty()) r_.final = fit;
    std::vector<EstimatedEffect> effects = effects_of(fit, named);
    d_.why_not_trusted = d_.verdict == Verdict::unexplained ? d_.reason : "";
    hand_out(e, fit, effects);
    d_.extended = as_joint(r_.final, effects, data_);
    const auto worst = std::ranges::max_element(r_.final.white_ratio);
    if (*worst > rest_limits.most_over_white) {
      const std::string kind = to_string(static_cast<RestKind>(worst - r_.final.white_ratio.begin()));
      const std::string why = fmt::format("{} is {:.1f} times as large as the white noise", kind, *worst);
      d_.distrust(why);
      if (d_.verdict == Verdict::clean) {
        d_.verdict = Verdict::unexplained;
        d_.unexplained_pattern = kind;
        d_.reason = why + "; " + d_.reason;
      }
    }
    if (!r_.accel_not_tested.empty()) {
      const std::string why = "no effect of the accelerometers was looked for: " + r_.accel_not_tested;
      d_.distrust(why);
      d_.reason = why + "; " + d_.reason;
      if (d_.verdict == Verdict::clean) d_.verdict = Verdict::not_tested;
    }
  }

  // Replaces the values and sigmas of the final model by the averages about `fit`.
  void hand_out(const Evidence& e, const RestFit& fit, std::vector<EstimatedEffect>& effects) {
    const AveragedEstimate average = average_over_models(
        e.at_each_noise, e.posterior, effects.empty() ? std::vector<EffectColumn>{} : e.named.columns);
    d_.distrust(hangs_on_a_name(average, e.columns));
    ParameterVector values = to_vector(fit.parameters);
    Eigen::Index k = 0;
    for (const int column : e.columns) {
      values[column] += average.shift[k];
      r_.final.sigma[column] = average.sigma[k++];
    }
    r_.final.parameters = from_vector(values);
    for (EstimatedEffect& effect : effects) {
      effect.value = average.shift[k];
      effect.sigma = average.sigma[k++];
      effect.column.tau_s = e.named.columns[std::size_t(&effect - effects.data())].tau_s;
      r_.final.effect_values[&effect - effects.data()] = effect.value;
    }
  }

  HoldoutError on_holdout(const JointResult& model, RestErrors& errors) const {
    const RestSystem system = rest_system_at(*holdout_, model);
    errors = rest_errors(system, system.residual);
    const VectorXd normalised = rest_weights(system, r_.final.floors).cwiseProduct(system.residual);
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    HoldoutError error{normalised.norm() / std::sqrt(double(normalised.size())), none, none, normalised.size(), {}};
    for (Eigen::Index k = 0; k < normalised.size(); ++k) error.normalised.emplace_back(normalised[k], 0.0, 0.0);
    return error;
  }
  void ask_held_out_data() {
    if (holdout_ == nullptr) return;
    r_.second_recording = true;
    d_.holdout_source = "second recording";
    d_.holdout_before = on_holdout(d_.base, r_.held_out_before);
    d_.holdout_after = on_holdout(d_.extended, r_.held_out_after);
    const std::vector<EstimatedEffect>& effects = d_.extended.effects;
    const bool of_one_run =
        std::ranges::all_of(effects, [](const EstimatedEffect& e) { return e.column.entry->of_one_run; });
    if (of_one_run || !holdout_gain(d_.holdout_before, d_.holdout_after).contradicted(GateLimits{}.contradiction))
      return;
    for (const EstimatedEffect& effect : effects) d_.gated_out.push_back(effect.column.key());
    withdraw("held-out data contradict what was found", d_);
    r_.final = r_.base;
    r_.held_out_after = r_.held_out_before;
  }

  void look_at_latitude() {
    for (const EstimatedEffect& effect : d_.extended.effects) {
      if (effect.column.key() != vertical_earth_rate().key()) continue;
      d_.latitude = latitude_of_vertical(data_.recording->info.latitude_deg, effect.value, effect.sigma);
      d_.reason = d_.latitude + "; " + d_.reason;
    }
  }

  const RestData& data_;
  const RestData* holdout_;
  RestDiagnosis& r_;
  Diagnosis& d_;
  double duration_s_ = 0.0;
};

}  // namespace

RestSystem rest_system_at(const RestData& data, const JointResult& model, bool with_columns) {
  return make_rest_system(data, model.parameters, effect_model_of(model, data.recording->info.latitude_deg),
                          with_columns);
}

JointResult as_joint(const RestFit& fit, const std::vector<EstimatedEffect>& effects, const RestData& data) {
  JointResult r;
  r.converged = fit.converged;
  r.message = fit.message;
  r.iterations = fit.iterations;
  r.parameters = fit.parameters;
  for (int k = 0; k < parameter_count; ++k) {
    const double sigma = fit.sigma[k];
    r.determined[std::size_t(k)] = sigma > 0.0;
    r.sigma[k] = sigma > 0.0 ? sigma : 0.0;
  }
  r.effects = effects;
  for (const std::string& key : fit.undetermined) r.undetermined.push_back({{{key, 1.0}}});
  r.reference_temperature_c = rest_reference_temperature_c(data);
  r.noise = rest_noise(data, fit.parameters);
  for (const RestLeg& leg : data.legs) {
    if (leg.fault.empty()) continue;
    Fault fault;
    const std::vector<Block>& blocks = data.recording->blocks;
    if (leg.first_block < leg.end_block) {
      fault.first_sample = blocks[leg.first_block].start_sample;
      fault.last_sample = blocks[leg.end_block - 1].start_sample + blocks[leg.end_block - 1].samples - 1;
    }
    fault.what = leg.fault;
    fault.action = "rotation set aside";
    r.faults.push_back(fault);
  }
  return r;
}

// Only rows beyond the base fit can support a name.
std::string why_not_tested(const RestData& data, const RestFit& base) {
  double redundancy = 0.0;
  for (const double r : base.redundancy) redundancy += r;
  if (!base.converged) return "the 21 parameters could not be fitted: " + base.message;
  std::string why;
  if (redundancy < rest_limits.least_redundancy)
    why = fmt::format("{} rests and {} rotations leave {} observations beyond the 21 parameters, where {} are wanted",
                      data.rests.size(), data.legs.size(), std::lround(redundancy), rest_limits.least_redundancy);
  if (!base.undetermined.empty()) {
    why += (why.empty() ? "" : "; ") + std::string("not determined:");
    for (const std::string& key : base.undetermined) why += " " + key;
  }
  // A reversed accelerometer makes the body frame left-handed, and two gyros turn the other way in it.
  if (why.empty()) why = wrong_axes(base.parameters.n / start_parameters(data.recording->info).n(0, 0));
  if (!why.empty()) return why;
  return hangs_on_single_rests(RestKind::direction, base.left_out.direction_rms_rad, base.errors.direction_rms_rad);
}

Result<RestDiagnosis> diagnose_rests(const RestData& data, const RestData* holdout) {
  RestDiagnosis r;
  Diagnosis& d = r.diagnosis;
  d.verdict = Verdict::not_tested;
  if (d.why_not_trusted = d.reason = r.not_tested = wrong_units(data); !r.not_tested.empty()) {
    r.base.message = r.not_tested;
    return r;
  }
  r.base = r.final = TRY(fit_rests(data, EffectModel{}));
  d.base = d.extended = as_joint(r.base, {}, data);
  d.why_not_trusted = d.reason = r.not_tested = why_not_tested(data, r.base);
  DiagnosingRests diagnosing(data, holdout, r);
  if (r.not_tested.empty()) diagnosing.run();
  if (r.base.converged) diagnosing.add_errors();
  return r;
}

}  // namespace turncal
