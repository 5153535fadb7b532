#include "calib/evidence/evidence.h"

#include <cmath>
#include <span>

#include "calib/evidence/holdout.h"
#include "calib/joint/several_recordings.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

// Sets the derivatives of an effect's readings by those same readings.
void set_slopes(const EffectModel& effects, const BlockState& at, Readings& readings) {
  constexpr double rate_radps = 1e-4, force_mps2 = 1e-2;
  EffectRegressors here(effects.columns), beside(effects.columns);
  effects.regressors(at, here);
  for (int axis = 0; axis < 3; ++axis) {
    BlockState faster = at, heavier = at;
    faster.w_b[axis] += rate_radps;
    heavier.f_b[axis] += force_mps2;
    effects.regressors(faster, beside);
    readings.row(12 + axis) = (beside.gyro.row(axis) - here.gyro.row(axis)) / rate_radps;
    effects.regressors(heavier, beside);
    readings.row(15 + axis) = (beside.accel.row(axis) - here.accel.row(axis)) / force_mps2;
  }
}

}  // namespace

std::vector<Readings> readings_of(const EffectModel& effects, const Pieces& pieces,
                                  const std::vector<BlockState>& states) {
  std::vector<Readings> readings(pieces.cells.size(), Readings::Zero(18, effects.columns));
  EffectRegressors one(effects.columns);
  for (std::size_t k = 0; k < states.size(); ++k) {
    if (states[k].duration_s <= 0.0) continue;
    effects.regressors(states[k], one);
    if (pieces.cell_of_block[k] < 0) continue;
    const auto c = std::size_t(pieces.cell_of_block[k]);
    const double part = states[k].duration_s / pieces.cells[c].at.duration_s;
    readings[c].topRows<3>() += part * one.gyro;
    readings[c].middleRows<3>(3) += part * one.accel;
    if (!pieces.cells[c].turns || pieces.jump_of_block.empty()) continue;
    readings[c].middleRows<6>(6) += pieces.jump_of_block[k].leftCols<3>() * one.gyro;
    readings[c].middleRows<6>(6) += pieces.jump_of_block[k].rightCols<3>() * one.accel;
  }
  if (!pieces.jump_of_block.empty())
    for (std::size_t c = 0; c < readings.size(); ++c) set_slopes(effects, pieces.cells[c].at, readings[c]);
  return readings;
}

std::vector<EffectColumn> columns_beside(const std::vector<EstimatedEffect>& effects, std::vector<EffectColumn> columns,
                                         bool finer) {
  constexpr double half_way = 0.5, quarter = 0.25, finest = 0.005, farthest = 0.3;
  const auto acts_on = [](const EffectColumn& c) {
    return std::tuple(c.entry->sensor, c.entry->quantity, c.entry->components[std::size_t(c.component)].front());
  };
  std::vector<EffectColumn> more;
  for (EffectColumn c : columns) {
    const auto next = std::ranges::upper_bound(c.entry->taus_s, c.tau_s);
    if (next == c.entry->taus_s.end() || !finer) continue;
    const bool beside = std::ranges::any_of(effects, [&](const auto& e) { return acts_on(e.column) == acts_on(c); });
    const double step = std::pow(*next / c.tau_s, beside ? quarter : half_way);
    while ((c.tau_s *= step) < 0.99 * *next) more.push_back(c);
  }
  for (const auto& [fitted, value, sigma] : effects) {
    if (!(fitted.tau_s > 0.0)) continue;
    more.push_back(fitted);
    for (double step = std::max(finest, sigma / std::abs(value)); step < farthest; step *= 2.0)
      for (const double tau_s : {fitted.tau_s * std::exp(-step), fitted.tau_s * std::exp(step)})
        more.push_back({fitted.entry, fitted.component, tau_s, fitted.recording});
  }
  std::ranges::stable_sort(more, {}, [](const EffectColumn& c) { return std::tuple(c.entry, c.recording, c.tau_s); });
  columns.insert(columns.end(), more.begin(), more.end());
  return columns;
}

void put_back(const Values& effects, const std::vector<Values>& held_out, const TermTable& table, PieceSystem& system) {
  if (effects.empty()) return;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(system.coordinates());
  for (std::size_t e = 0; e < effects.size(); ++e) {
    const EstimatedEffect& effect = effects[e];
    const auto found = std::ranges::find_if(table.effects, [&](const EffectColumn& c) {
      return c.key() == effect.column.key() && c.tau_s == effect.column.tau_s;
    });
    const auto at = std::size_t(found - table.effects.begin());
    const Weights& basis = table.bases[table.basis_of_effect[at]];
    for (std::size_t i = 0; i < basis.rows_of(x.size()); ++i) {
      const auto recording = std::size_t(basis.first[i] / basis.mine);  // from 1 on: a held-out one
      const double value = recording == 0 ? effect.value : held_out[recording - 1][e].value;
      x[basis.rows[i]] += value * basis.of()(table.column_of_effect[at], Eigen::Index(i));
    }
  }
  system.put_back(x);
}
void score_again(UnderNoise& under) {
  for (std::size_t k = 0; k < under.blocks.size(); ++k) under.blocks[k].s = under.system->score(under.table->bases[k]);
}

void conclude(Posterior posterior, const std::vector<EstimatedEffect>& effects, Evidence& result) {
  result.posterior = std::move(posterior);
  result.statements = statements_of(result.at_each_noise, result.posterior);
  std::vector<std::string> fitted;
  for (const EstimatedEffect& effect : effects) fitted.push_back(effect.column.key());
  result.named = named_effects(result.at_each_noise, result.posterior, fitted);
}

PiecewiseView view_in_pieces(const CompressedRecording& recording, const JointResult& fit, const NoiseModel& noise) {
  FilterSetup setup = fit.setup;
  setup.noise = noise;
  setup.with_columns = setup.keep_steps = true;
  PiecewiseView view;
  view.recording = coarser(recording, coarseness_of_scores, setup);
  for (const int column : fit.free)
    if (column < parameter_count || is_turn_on(fit.effects[std::size_t(column - parameter_count)].column))
      view.columns.push_back(column);
  // One more column of zeros, whose regressors record the state of every block.
  EffectModel of_fit = effect_model_of(fit, recording.info.latitude_deg), looks_on = of_fit;
  ++looks_on.columns;
  looks_on.values.conservativeResize(looks_on.columns);
  looks_on.values[of_fit.columns] = 0.0;
  EffectRegressors inner(of_fit.columns);
  looks_on.regressors = [&](const BlockState& s, EffectRegressors& out) {
    view.states.push_back(s);
    if (of_fit.columns == 0) return;
    of_fit.regressors(s, inner);
    out.gyro.leftCols(of_fit.columns) = inner.gyro;
    out.accel.leftCols(of_fit.columns) = inner.accel;
  };
  FilterResult pass = run_filter(view.recording, fit.parameters, looks_on, setup);
  for (const int c : view.columns)  // prior for what the recording leaves open
    if (c < fit.ranges.size()) pass.information(c, c) += 1.0 / (fit.ranges[c] * fit.ranges[c]);
  if (pass.steps.empty()) return view;
  // Before the first rest nothing is navigated.
  view.states.insert(view.states.begin(), pass.steps.front().block, BlockState{});
  view.states.resize(view.recording.blocks.size());
  // At rest w_b is the Earth's rate: the noise of a measured rate is also in the velocities to be explained.
  const Eigen::Vector3d earth = earth_rate_n(recording.info.latitude_deg);
  for (const FilterStep& step : pass.steps)
    if (step.observed) view.states[step.block].w_b = view.states[step.block].C_nb.transpose() * earth;
  view.pieces = cut_into_pieces(view.recording, pass.steps, view.states);
  if (!view.pieces.pieces.empty() && !view.columns.empty())
    view.system = std::make_unique<PieceSystem>(view.recording, pass, fit.parameters, noise, view.columns, view.pieces);
  return view;
}

namespace {

// A noise at which models are weighed, made from the fitted one.
struct NoiseVariant {
  Eigen::Matrix<double, 6, 1> instability = Eigen::Matrix<double, 6, 1>::Ones();  // factors, as NoiseModel::unstable
  int unstable = -1;  // the sensor, 0 to 5, that alone has the instability of its triad; -1: none
  NoiseModel of(NoiseModel noise) const {
    noise.unstable = instability;
    return noise;
  }
};
const NoiseVariant stable{.instability = Eigen::Matrix<double, 6, 1>::Zero()};
constexpr double prior_unstable_sensor = 0.01;

// Returns, of each triad with an instability, the most likely variant in which one sensor has it. Sensors of a kind are alike: one that is
// unstable among stable ones has a defect. The fitted value is common to the three.
std::vector<NoiseVariant> variants_with_one_unstable(const CompressedRecording& recording, const JointResult& fit) {
  std::vector<NoiseVariant> all;
  for (const int triad : {0, 3}) {
    if (!(fit.noise.bias_instability()[triad] > 0.0)) continue;
    NoiseVariant best;
    double least = 1e300;
    const auto consider = [&](int sensor, double factor) {
      NoiseVariant one = {.unstable = sensor};
      one.instability.segment<3>(triad) = factor * Eigen::Vector3d::Unit(sensor - triad);
      const PiecewiseView view = view_in_pieces(recording, fit, one.of(fit.noise));
      if (view.system && view.system->misfit() < least) best = one, least = view.system->misfit();
    };
    for (int axis = 0; axis < 3; ++axis) consider(triad + axis, std::sqrt(3.0));
    for (const double factor : {1.0, 3.0}) consider(best.unstable, factor);
    all.push_back(best);
  }
  return all;
}
Values without_turn_ons(Values effects) {
  std::erase_if(effects, [](const EstimatedEffect& e) { return is_turn_on(e.column); });
  return effects;
}

// The recording of the fit, followed by the held-out ones.
struct Together {
  PieceSystem system;
  Pieces pieces;
  std::vector<Readings> readings;  // of the catalogue
  std::vector<Values> taken_off;   // values in each held-out recording
};

// Computes the blocks that the averages need from the fitted data alone.
void of_the_fit_alone(Evidence& e) {
  for (std::size_t n = 0; n < e.at_each_noise.size(); ++n) {
    UnderNoise& under = e.at_each_noise[n];
    std::vector<char> wanted(under.table->bases.size(), 0);
    for (const std::size_t basis : under.table->basis_of_effect) wanted[basis] = 1;
    for (const WeighedModel& m : std::span(e.posterior.models).first(averaged_models(e.posterior)))
      for (const ModelTerm& t : m.terms)
        if (m.noise == n) wanted[under.table->terms[std::size_t(t.term)].basis] = 1;
    under.blocks = under.system->blocks(under.table->bases, wanted);
  }
}

}  // namespace

Evidence weigh_evidence(const CompressedRecording& recording, const JointResult& fit, int recordings,
                        const std::vector<const CompressedRecording*>& held_out, bool something) {
  const Values taken_off = without_turn_ons(fit.effects);  // turn-on columns stay in the model
  const bool finer = something || !taken_off.empty();
  const auto effects = columns_beside(taken_off, catalogue_columns(recording.info, recordings), finer);
  const auto readings = [&](const PiecewiseView& view) {
    return readings_of(make_effect_model(effects, {recording.info.latitude_deg}, fit.reference_temperature_c),
                       view.pieces, view.states);
  };
  std::vector<JointResult> others;
  for (const CompressedRecording* other : held_out) others.push_back(model_on_holdout(*other, fit, fit.noise));
  const auto join = [&](const PiecewiseView& view, const NoiseVariant& variant, bool tells_terms) {
    Together all = {*view.system, view.pieces, {}, {}};
    if (tells_terms) all.readings = readings(view);
    std::vector<Eigen::Index> own;
    for (std::size_t k = 0; k < view.columns.size(); ++k)
      if (view.columns[k] < 6) own.push_back(Eigen::Index(k));
    for (std::size_t k = 0; k < others.size(); ++k) {
      const PiecewiseView other = view_in_pieces(*held_out[k], others[k], variant.of(others[k].setup.noise));
      if (!other.system) continue;
      all.system = PieceSystem(all.system, *other.system, own);
      append(other.pieces, recordings + int(all.taken_off.size()), all.pieces);
      const std::vector<Readings> more = tells_terms ? readings(other) : std::vector<Readings>{};
      all.readings.insert(all.readings.end(), more.begin(), more.end());
      all.taken_off.push_back(without_turn_ons(others[k].effects));
    }
    return all;
  };
  Evidence result;
  std::vector<LogWeights> models;
  double most_probable = -1e300;
  std::vector<NoiseVariant> variants = {{}};
  if (fit.noise.has_bias_instability()) variants.push_back(stable);
  for (const NoiseVariant& one : variants_with_one_unstable(recording, fit)) variants.push_back(one);
  for (const NoiseVariant& variant : variants) {
    result.views.push_back(view_in_pieces(recording, fit, variant.of(fit.noise)));
    PiecewiseView& view = result.views.back();
    result.columns = view.columns;
    if (!view.system) return result;
    const bool tells_terms = result.at_each_noise.empty();  // they are the same at each noise
    Together all = join(view, variant, tells_terms);
    UnderNoise together;
    if (tells_terms) {
      together = make_terms(all.system, all.pieces, effects, all.readings, fit.noise, fit.parameters, result.columns);
    } else {
      const auto& table = result.at_each_noise.front().table;
      together = {&all.system, table, all.system.blocks(table->bases)};
    }
    if (variant.unstable >= 0) {
      together.what = {sensor_name(variant.unstable < 3 ? Sensor::gyro : Sensor::accelerometer, variant.unstable % 3),
                       std::string(to_string(Quantity::bias)), std::string(to_string(Driver::time)), "", 0.0};
      together.log_prior = std::log(prior_unstable_sensor);
    }
    const TermTable& table = *together.table;
    put_back(taken_off, all.taken_off, table, all.system);
    put_back(taken_off, all.taken_off, table, *view.system);
    if (!taken_off.empty()) score_again(together);
    models.push_back(weigh_models(together, most_probable));
    for (const auto& [terms, log_weight] : models.back()) most_probable = std::max(most_probable, log_weight);
    together.system = view.system.get();
    result.at_each_noise.push_back(std::move(together));
  }
  conclude(posterior_of(models), taken_off, result);
  if (!finer && result.statements.anything >= said_from && result.named.probability < carried_by_names)
    return result = {}, weigh_evidence(recording, fit, recordings, held_out, true);  // only one in memory at a time
  if (!held_out.empty()) of_the_fit_alone(result);
  const WeighedModel& best = result.posterior.models.front();
  const PiecewiseView& view = result.views[best.noise];
  test_pieces(view.recording, view.pieces, result.at_each_noise[best.noise], best, result.omnibus);
  return result;
}

std::string what_speaks_against(const CompressedRecording& recording, const JointResult& estimate) {
  JointResult fit = estimate;  // undetermined parameters are held fixed: they may be known from elsewhere
  std::erase_if(fit.free, [&](int c) { return c < parameter_count && !estimate.determined[c]; });
  Evidence evidence = weigh_evidence(recording, fit);
  if (evidence.statements.anything >= said_from) return reason_of(evidence.statements);
  if (!evidence.at_each_noise.empty()) {
    const AveragedEstimate average = average_over_models(evidence.at_each_noise, evidence.posterior, {});
    if (std::string off = hangs_on_a_name(average, evidence.columns); !off.empty()) return off;
  }
  test_innovations(recording, fit, evidence.omnibus);
  return evidence.omnibus.passed() ? "" : reason_of(evidence.omnibus);
}

namespace {

// Tests the biases within a rest (`first` = 0) or the jumps at turns (6).
bool stands_out(const PiecewiseView& view, Eigen::Index first, bool turns_only) {
  const std::vector<Piece>& pieces = view.pieces.pieces;
  double others = 0.0;
  int degrees = 0;
  std::vector<RankedChiSquare> last;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    if (turns_only && !pieces[k].after_turn) continue;
    const PieceSystem::OfPiece of = view.system->of_piece(k);
    const RankedChiSquare ranked = ranked_chi_square(of.Q.block<6, 6>(first, first), of.s.segment<6>(first),
                                                     of.before.segment<6>(first), LackOfFitLimits{}.rank_floor);
    if (pieces[k].segment == pieces.back().segment) last.push_back(ranked);
    if (pieces[k].turn == pieces.back().turn) continue;
    others += ranked.chi_square;
    degrees += ranked.rank;
  }
  const double scatter = std::max(1.0, others / std::max(1, degrees));
  return std::ranges::any_of(last, [&](const RankedChiSquare& one) {
    return one.rank > 0 && chi_square_tail(one.chi_square / scatter, one.rank) < last_rest_limits.probability;
  });
}

}  // namespace

bool last_rest_disagrees(const CompressedRecording& recording, const JointResult& fit) {
  const PiecewiseView view = view_in_pieces(recording, fit, stable.of(fit.noise));
  if (!view.system || view.pieces.pieces.back().turn < last_rest_limits.fewest) return false;
  return stands_out(view, 0, false) || stands_out(view, 6, true);
}

}  // namespace turncal
