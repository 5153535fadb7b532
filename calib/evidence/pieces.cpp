#include "calib/evidence/pieces.h"

#include <algorithm>
#include <cmath>

#include "calib/model/parameters.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Sums of what a cell's blocks have, over their lengths; divided at its end.
void add(const BlockState& s, ErrorCell& cell) {
  const double t = s.duration_s;
  BlockState& sum = cell.at;
  if (sum.duration_s == 0.0) {
    sum = s;
    sum.f_b *= t;
    sum.w_b *= t;
    sum.w_dot_b *= t;
    sum.table_rad *= t;
    sum.time_s *= t;
    sum.since_rotation_s *= t;
    sum.temperature_c *= t;
    return;
  }
  sum.f_b += t * s.f_b;
  sum.w_b += t * s.w_b;
  sum.w_dot_b += t * s.w_dot_b;
  sum.table_rad += t * s.table_rad;
  sum.time_s += t * s.time_s;
  sum.since_rotation_s += t * s.since_rotation_s;
  sum.temperature_c += t * s.temperature_c;
  sum.duration_s += t;
}

void divide(ErrorCell& cell) {
  BlockState& s = cell.at;
  const double t = s.duration_s > 0.0 ? s.duration_s : 1.0;
  for (Vector3d* v : {&s.f_b, &s.w_b, &s.w_dot_b, &s.table_rad}) *v /= t;
  for (double* v : {&s.time_s, &s.since_rotation_s, &s.temperature_c}) *v /= t;
}

// The table's angles half way through a block of a turn, as if it went evenly from rest to rest.
BlockState with_table_angle(const CompressedRecording& recording, const Block& block, BlockState state) {
  const Segment& to = recording.segments[block.segment];
  const Segment& from = recording.segments[block.segment > 0 ? block.segment - 1 : 0];
  const double length = static_cast<double>(std::max<std::int64_t>(1, to.end_sample - to.start_sample));
  const double part =
      std::clamp((static_cast<double>(block.start_sample - to.start_sample) + 0.5 * block.samples) / length, 0.0, 1.0);
  const Vector3d before(from.heading_deg, from.pitch_deg, from.roll_deg),
      after(to.heading_deg, to.pitch_deg, to.roll_deg);
  state.table_rad = rad_per_deg * (before + part * (after - before));
  return state;
}

}  // namespace

void append(const Pieces& more, int recording, Pieces& all) {
  const std::size_t before = all.cells.size();
  for (ErrorCell cell : more.cells) {
    cell.epoch += all.epochs;
    cell.at.recording = recording;
    all.cells.push_back(cell);
  }
  for (Piece piece : more.pieces) {
    piece.first_cell += before;
    piece.rest_cell += before;
    all.pieces.push_back(piece);
  }
  all.epochs += more.epochs;
}

void average_cells(const std::vector<BlockState>& states, Pieces& pieces) {
  for (std::size_t k = 0; k < states.size(); ++k)
    if (pieces.cell_of_block[k] >= 0) add(states[k], pieces.cells[static_cast<std::size_t>(pieces.cell_of_block[k])]);
  for (ErrorCell& cell : pieces.cells) divide(cell);
  pieces.fitted_cells = pieces.cells.size();
}

Pieces cut_into_pieces(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                       const std::vector<BlockState>& states) {
  Pieces result;
  result.cell_of_block.assign(recording.blocks.size(), -1);
  const double period = recording.info.sample_period_s;
  std::vector<ErrorCell> turn;                                   // parts since the last rest
  std::vector<std::pair<std::size_t, std::size_t>> turn_blocks;  // block, part
  std::vector<double> turned;
  bool at_rest = false;
  double rest_began_s = 0.0, epoch_began_s = 0.0, since_at_begin = 0.0;
  int epoch = 0;
  for (std::size_t k = 0; k < steps.size(); ++k) {
    const std::size_t index = steps[k].block;
    const Block& block = recording.blocks[index];
    const BlockState& state = states[index];
    if (!steps[k].observed) {
      if (!recording.rotates(block)) continue;
      at_rest = false;
      if (turn.empty() || turned.back() >= part_rad) {
        turn.emplace_back();
        turn.back().turns = true;
        turned.push_back(0.0);
      }
      // An error of a part that is over tilts gravity until the turn ends.
      const double t = block.duration_s;
      const Matrix3d Ft = steps[k].F * t, more = steps[k].C_mid * t;
      for (ErrorCell& part : turn) {
        const Matrix3d now = &part == &turn.back() ? more : Matrix3d::Zero();
        part.fallen -= Ft * (part.pushed + 0.5 * now);
        part.pushed += now;
      }
      add(with_table_angle(recording, block, state), turn.back());
      turned.back() += steps[k].rotation.norm();
      turn_blocks.emplace_back(index, turn.size() - 1);
      continue;
    }
    const double begin = static_cast<double>(block.start_sample - recording.blocks.front().start_sample) * period;
    const bool after_turn = !at_rest;
    const bool begins = after_turn || result.pieces.back().segment != block.segment || steps[k].begins_chain;
    if (after_turn) {
      rest_began_s = begin;
      epoch += result.pieces.empty() ? 0 : 1;
      epoch_began_s = begin;
    } else if (begin - epoch_began_s >= epoch_s) {
      ++epoch;
      epoch_began_s = begin;
    }
    const double since = begin - rest_began_s;
    const auto passes = [&](double cut) { return since_at_begin < cut && since >= cut; };
    const bool cut = begins || std::any_of(first_cuts_s.begin(), first_cuts_s.end(), passes) ||
                     begin - result.pieces.back().begin_s >= longest_piece_s || begin == epoch_began_s;
    if (cut) {
      if (!result.pieces.empty()) divide(result.cells.back());
      since_at_begin = since;
      Piece piece;
      piece.first_step = k;
      piece.segment = block.segment;
      piece.after_turn = after_turn && !result.pieces.empty();
      if (!result.pieces.empty()) piece.turn = result.pieces.back().turn + (piece.after_turn ? 1 : 0);
      piece.begin_s = begin;
      piece.first_cell = result.cells.size();
      if (piece.after_turn) {
        for (const auto& [of, part] : turn_blocks) result.cell_of_block[of] = static_cast<int>(piece.first_cell + part);
        for (ErrorCell& part : turn) {
          divide(part);
          part.epoch = epoch;
          result.cells.push_back(part);
        }
      }
      turn.clear();
      turn_blocks.clear();
      turned.clear();
      piece.rest_cell = result.cells.size();
      result.cells.emplace_back();
      result.cells.back().epoch = epoch;
      result.pieces.push_back(piece);
    }
    at_rest = true;
    result.pieces.back().last_step = k;
    result.pieces.back().end_s = begin + block.duration_s;
    result.cell_of_block[index] = static_cast<int>(result.cells.size()) - 1;
    // At rest the unit turns with the earth: what the gyros measure has noise, which the velocities to be explained share.
    BlockState still = state;
    still.w_b = state.C_nb.transpose() * earth_rate_n(recording.info.latitude_deg);
    add(still, result.cells.back());
  }
  if (!result.pieces.empty()) divide(result.cells.back());
  result.epochs = result.pieces.empty() ? 0 : epoch + 1;
  result.fitted_cells = result.cells.size();
  return result;
}

}  // namespace turncal
