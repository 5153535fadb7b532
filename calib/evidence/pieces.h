// A recording cut into cells: pieces of rest, and parts of the turns between them.
//
// Whatever the sensors may read wrong is taken as constant over a cell. A rest is cut where it is young (first_cuts_s), since what comes
// with a turn fades, and every longest_piece_s; a turn wherever the unit has turned by part_rad. Epochs are coarser: a turn with the
// rest after it, long rests cut at epoch_s.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/model/effects.h"

namespace turncal {

inline constexpr std::array<double, 4> first_cuts_s = {3.0, 9.0, 25.0, 60.0};
inline constexpr double longest_piece_s = 120.0, part_rad = 0.2, epoch_s = 150.0;

struct ErrorCell {
  BlockState at;  // means over it; duration_s: of all of it
  bool turns = false;
  int epoch = 0;
  // Of a part of a turn: a reading that is too large by a rate w and a force f gives psi += pushed w, v += fallen w + pushed f by the end
  // of the turn.
  Eigen::Matrix3d pushed = Eigen::Matrix3d::Zero(), fallen = Eigen::Matrix3d::Zero();
};

struct Piece {  // of rest
  std::size_t first_step = 0, last_step = 0;
  int segment = 0;
  int turn = 0;                       // how many came before
  bool after_turn = false;            // the first one after a turn
  double begin_s = 0.0, end_s = 0.0;  // from the first sample
  std::size_t first_cell = 0;         // the parts of the turn before it, then the rest itself
  std::size_t rest_cell = 0;
};

struct Pieces {
  std::vector<Piece> pieces;
  std::vector<ErrorCell> cells;
  std::vector<int> cell_of_block;  // -1: of none
  int epochs = 0;
  std::size_t fitted_cells = 0;  // those behind them are of recordings that the parameters were not fitted to
  // Of hand-turned data (rest_evidence.h), of each cell: what its readings do to the coordinates, which are observations. Else empty.
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> responses;
};

// Behind those of `all`: the pieces of another recording, which has this number.
void append(const Pieces& more, int recording, Pieces& all);

// ErrorCell::at of all cells, from the states of the blocks.
void average_cells(const std::vector<BlockState>& states, Pieces& pieces);

// `steps`, `states`: of the blocks, as one filter pass saw them (states.size() == recording.blocks.size() or fewer at the front).
Pieces cut_into_pieces(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                       const std::vector<BlockState>& states);

}  // namespace turncal
