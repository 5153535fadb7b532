// What a recording says of errors of the sensors in its cells, as information and score, the parameters eliminated.
//
// The filter of the estimate (calib/joint/joint_filter.h) is run backward over its own steps (the disturbance smoother of de Jong,
// Biometrika 75 (1988) 594). Coordinates of a piece are piece_dims: what gyros x y z read too much within the rest (rad/s), what the
// accelerometers do (m/s^2), and the jump of psi and v (n frame) by the turn before it. With r the score of an error that begins
// somewhere, I its information, R its information with the parameters' columns N, L the closed-loop transition, nu the innovation:
//   r <- H' S^-1 nu + L' r,   I <- H' S^-1 H + L' I L,   R <- H' S^-1 N' + L' R
// With A the information of the parameters and g their gradient at the fit,
//   Q = I - R A^-1 R',   s = r - R A^-1 g
// and a unit of a coordinate moves the fit by A^-1 R'. Between two pieces the state carries the information, so Q is never whole: with
// E = d(state where the next piece begins) / d(coordinates), M the state's transition, G = information of (state, coordinates),
//   I_ab = E_a' M_(a+1)' ... M_(b-1)' G_b for a < b.
// Not modelled: errors in blocks at rest that are not observed; what varies within a cell at rest, and of patterns in turns.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/model/effects.h"

namespace turncal {

// A recording cut into cells: pieces of rest, and parts of the turns between them.
//
// Whatever the sensors may read wrong is taken as constant over a cell. A rest is cut where it is young (first_cuts_s), since what comes
// with a turn fades, and every longest_piece_s; a turn wherever the unit has turned by part_rad. Epochs are coarser: a turn with the
// rest after it, long rests cut at epoch_s.

inline constexpr std::array<double, 4> first_cuts_s = {3.0, 9.0, 25.0, 60.0};
inline constexpr double longest_piece_s = 120.0, part_rad = 0.2, epoch_s = 150.0;

struct ErrorCell {
  BlockState at;  // means over it; duration_s: of all of it
  bool turns = false;
  int epoch = 0;
  JumpByReadings jump = JumpByReadings::Zero();  // of a part of a turn, by the end of the turn
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
  std::vector<int> cell_of_block;             // -1: of none
  std::vector<JumpByReadings> jump_of_block;  // 0: at rest
  int epochs = 0;
  std::size_t fitted_cells = 0;  // those behind them are of recordings that the parameters were not fitted to
  // Of hand-turned data (rest_diagnosis.h), of each cell: what its readings do to the coordinates, which are observations. Else empty.
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> responses;
};

// Behind those of `all`: the pieces of another recording, which has this number.
void append(const Pieces& more, int recording, Pieces& all);

// ErrorCell::at of all cells, from the states of the blocks.
void average_cells(const std::vector<BlockState>& states, Pieces& pieces);

// `steps`, `states`: of the blocks, as one filter pass saw them (states.size() == recording.blocks.size() or fewer at the front).
Pieces cut_into_pieces(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                       std::vector<BlockState> states);

// ---- their equations ----

inline constexpr int piece_dims = 12;

// Columns of coordinates. A coordinate has `mine` of them, from its `first` on; those that are zero in all are left out: one sensor's are few.
struct Weights {
  Eigen::Index columns = 0, mine = 0;
  std::vector<Eigen::Index> rows, first;  // coordinates, rising
  std::vector<std::size_t> begin = {0};   // of each piece, in `rows`; and the end
  std::vector<double> values;
  Eigen::VectorXd
      pull;  // what the noise of the readings that columns are made of adds to their scores (errors in variables); empty: nothing
  Eigen::Map<const Eigen::MatrixXd> of() const { return {values.data(), mine, std::ssize(rows)}; }  // mine x rows
  // The next piece; `coordinates`: mine x piece_dims.
  void add(Eigen::Index first_column, const Eigen::MatrixXd& coordinates);
  // Coordinates are the rows, cut into pieces.
  static Weights of_rows(const Eigen::MatrixXd& rows);
  // Of the coordinates that come first: the rows times L, and y, which has a column for each, times the rows.
  Eigen::MatrixXd times(const Eigen::MatrixXd& L, Eigen::Index coordinates) const;
  Eigen::MatrixXd products(const Eigen::MatrixXd& y) const;
  std::size_t rows_of(Eigen::Index coordinates) const { return begin[std::size_t(coordinates / piece_dims)]; }
};

class PieceSystem {
 public:
  // `pass`: run with keep_steps (not kept), at `parameters` and `noise`; `columns`: of the model's parameters.
  PieceSystem(const CompressedRecording& recording, const FilterResult& pass, const Parameters& parameters,
              const NoiseModel& noise, const std::vector<int>& columns, const Pieces& pieces);

  // Of independent observations: residuals over their sigmas, and their derivatives by the parameters. Coordinates are the observations, filled up
  // to whole pieces. `log_variance`: sum of the logarithms of their variances.
  PieceSystem(const Eigen::MatrixXd& derivatives, const Eigen::VectorXd& residuals, double log_variance);

  // Of two recordings, before anything is put back: pieces of one behind those of the other. Parameters are common, but for those at `own`, which
  // the second has for itself.
  PieceSystem(const PieceSystem& first, const PieceSystem& second, const std::vector<Eigen::Index>& own);

  // Of each by itself: Q, s, and what one of each moves the parameters by.
  struct Block {
    Eigen::MatrixXd Q;
    Eigen::VectorXd s;
    Eigen::MatrixXd shift;   // parameters x columns
    Eigen::VectorXd before;  // diagonal of Q before the parameters were eliminated
  };
  // `wanted`, of each; empty: all. Of the others nothing is in the result.
  std::vector<Block> blocks(const std::vector<Weights>& weights, const std::vector<char>& wanted = {}) const;
  const Eigen::VectorXd& scores() const { return s_; }  // of the coordinates; put_back() changes them
  Eigen::VectorXd score(const Weights& weights) const;
  // Of one piece.
  using Information = Eigen::Matrix<double, piece_dims, piece_dims>;
  struct OfPiece {
    Information Q;
    Eigen::Matrix<double, piece_dims, 1> s, before;
  };
  OfPiece of_piece(std::size_t piece) const;
  const Information& information(std::size_t piece) const { return links_[piece].I; }  // before they were eliminated
  // Readings have white noise, which goes with what it does to the velocities (errors in variables, noise_fit.h): of each reading of a cell, by
  // how much a column that it is a factor of is scored too high.
  const Eigen::Matrix<double, 6, 1>& pull(std::size_t cell) const { return pull_[cell]; }
  // Q x, all coordinates.
  Eigen::MatrixXd times(const Eigen::MatrixXd& x) const;
  // The pass had errors `x` taken off: from here on they are in the data, as linearised.
  void put_back(const Eigen::VectorXd& x);
  // What errors x move the parameters by.
  Eigen::MatrixXd shift(const Eigen::MatrixXd& x) const { return A_inverse_ * (R_.transpose() * x); }
  const Eigen::VectorXd& fit_shift() const { return fit_shift_; }  // of the parameters to their optimum with no error
  const Eigen::MatrixXd& covariance() const { return A_inverse_; }
  // Of the pass with no error, the parameters averaged over: -2 ln L but for a constant.
  double misfit() const { return misfit_; }
  Eigen::Index coordinates() const { return s_.size(); }

 private:
  void run(const FilterResult& pass, const CompressedRecording& recording, const std::vector<int>& columns,
           const Eigen::Matrix<double, 6, 1>& walks, const Pieces& pieces);
  void eliminate_parameters();
  double fixed_misfit() const;  // of the parameters where the pass had them

  struct Link {
    Information I;
    Eigen::Matrix<double, Eigen::Dynamic, piece_dims> E, G;  // states x piece_dims
    Eigen::MatrixXd M;
  };
  int states_ = 6;  // psi, v; with bias instability b_g, b_a
  double misfit_ = 0.0;
  // Of a column's information, which is not known better. Pulls are taken off to first order: where the parameters are pulled by x sigma, by x
  // of themselves they may be other ones, and by no more than themselves.
  double floor_ = 0.0;
  std::vector<Link> links_;  // of each piece, to the next
  std::vector<Eigen::Matrix<double, 6, 1>> pull_;
  Eigen::VectorXd s_;
  Eigen::MatrixXd R_;  // coordinates x parameters
  Eigen::MatrixXd A_, A_inverse_;
  Eigen::VectorXd gradient_;
  Eigen::VectorXd fit_shift_;
};

}  // namespace turncal
