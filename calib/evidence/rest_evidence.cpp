#include "calib/evidence/rest_evidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "calib/model/parameters.h"

namespace turncal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Floors are looked for from what the most probable model leaves, and from this part of them: what is missing of three axes at once is not
// found beside a floor that holds it.
constexpr double low_floors = 0.3;
constexpr int most_floors = 4;        // tried, one after the other
constexpr double same_floors = 0.05;  // relative

// An epoch is a rest with the turn before it.
Pieces cells_of(const RestData& data, const SensorModel& model) {
  const std::vector<Block>& blocks = data.recording->blocks;
  Pieces pieces;
  pieces.cell_of_block.assign(blocks.size(), -1);
  const auto cell = [&](std::size_t first, std::size_t end, bool turns) {
    if (first >= end) return;
    pieces.cells.emplace_back();
    pieces.cells.back().turns = turns;
    pieces.cells.back().epoch = static_cast<int>(pieces.pieces.size());
    std::fill(pieces.cell_of_block.begin() + static_cast<std::ptrdiff_t>(first),
              pieces.cell_of_block.begin() + static_cast<std::ptrdiff_t>(end), std::ssize(pieces.cells) - 1);
  };
  for (std::size_t k = 0; k < data.rests.size(); ++k) {
    Piece piece;
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
  pieces.epochs = static_cast<int>(pieces.pieces.size());
  return pieces;
}

// The effects of the model, then six columns for each cell: gyros and accelerometers that read one unit too much there. `states`: of the blocks.
EffectModel with_readings(const CompressedRecording& recording, EffectModel model, const Pieces& pieces,
                          std::vector<BlockState>& states) {
  std::vector<double> middles;
  for (const Block& block : recording.blocks) middles.push_back(recording.middle_s(block));
  const Index own = model.columns, all = own + 6 * static_cast<Index>(pieces.cells.size());
  model.columns = static_cast<int>(all);
  model.values.conservativeResize(all);
  model.values.tail(all - own).setZero();
  model.regressors = [inner = model.regressors, own, &pieces, &states, middles, last = Index{own}](
                         const BlockState& s, EffectRegressors& out) mutable {
    if (own > 0) inner(s, out);
    out.gyro.middleCols(last, std::min<Index>(6, out.gyro.cols() - last)).setZero();
    out.accel.middleCols(last, std::min<Index>(6, out.accel.cols() - last)).setZero();
    const auto block =
        static_cast<std::size_t>(std::lower_bound(middles.begin(), middles.end(), s.time_s) - middles.begin());
    states[block] = s;
    last = own + 6 * static_cast<Index>(pieces.cell_of_block[block]);
    out.gyro.middleCols<3>(last).setIdentity();
    out.accel.middleCols<3>(last + 3).setIdentity();
  };
  return model;
}

// The rows of `system` over their sigmas, of which the first 21 columns are parameters, and what readings in the cells do to them.
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

// What the most probable model leaves, as floors: by the redundancy that it leaves of each kind.
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
  for (Index k = 0; k < rows; ++k) freedom[index(system.kind[static_cast<std::size_t>(k)])] += redundant[k];
  return estimate_floors(beside, freedom);
}

bool alike(const RestFloors& a, const RestFloors& b) { return ((a - b).abs() <= same_floors * a.max(b)).all(); }

}  // namespace

NoiseModel rest_noise(const RestData& data, const Parameters& parameters) {
  const SensorModel model = sensor_model(parameters, data.recording->info);
  NoiseModel noise;
  noise.angle_random_walk = (model.gyro_scale * data.gyro_white).cwiseAbs();
  noise.velocity_random_walk = (model.accel_scale * data.accel_white).cwiseAbs();
  return noise;
}

double rest_reference_temperature_c(const RestData& data) {
  const double mean = data.recording->mean_temperature_c;
  return std::isnan(mean) ? 0.0 : mean;
}

EffectModel rest_effects(const RestData& data, const std::vector<EstimatedEffect>& effects) {
  std::vector<EffectColumn> columns;
  for (const EstimatedEffect& effect : effects) columns.push_back(effect.column);
  EffectModel model =
      make_effect_model(columns, {data.recording->info.latitude_deg}, rest_reference_temperature_c(data));
  for (std::size_t k = 0; k < effects.size(); ++k) model.values[static_cast<Index>(k)] = effects[k].value;
  return model;
}

Evidence weigh_rests(const RestData& data, const RestFit& fit, const std::vector<EstimatedEffect>& effects,
                     const RestFloors& without, bool accelerometers) {
  const CompressedRecording& recording = *data.recording;
  std::vector<EffectColumn> catalogue = catalogue_columns(recording.info);
  std::erase_if(catalogue,
                [](const EffectColumn& c) { return c.entry->driver == Driver::field; });  // the heading is open
  catalogue = columns_beside(effects, std::move(catalogue));
  const EffectModel of_fit = rest_effects(data, effects);
  PiecewiseView first;
  first.columns.assign(free_parameters().begin(), free_parameters().end());
  first.pieces = cells_of(data, sensor_model(fit.parameters, recording.info));
  first.states.resize(recording.blocks.size());
  const RestSystem system =
      make_rest_system(data, fit.parameters, with_readings(recording, of_fit, first.pieces, first.states), true);
  average_cells(first.states, first.pieces);
  for (ErrorCell& cell : first.pieces.cells)  // of the earth's rate the heading is open
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

}  // namespace turncal
