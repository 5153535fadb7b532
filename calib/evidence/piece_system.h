// The information and the score of sensor errors, piece by piece of a recording, with the parameters eliminated.
//
// The filter of the estimate (calib/joint/joint_filter.h) is run backward over its own steps (the disturbance smoother of de Jong, Biometrika 75
// (1988) 594). The coordinates of a piece are piece_dims: the excess reading of gyros x y z within the rest (rad/s), that of the accelerometers
// (m/s^2), and the jump of psi and v (n frame) over the turn before it. With r the score of an error that begins at some step, I its information, R
// its information with the parameters' columns N, L the closed-loop transition, nu the innovation:
//   r <- H' S^-1 nu + L' r,   I <- H' S^-1 H + L' I L,   R <- H' S^-1 N' + L' R
// With A the information of the parameters and g their gradient at the fit,
//   Q = I - R A^-1 R',   s = r - R A^-1 g
// and one unit of a coordinate moves the fit by A^-1 R'. Between pieces the state carries the information, so Q is never formed as a whole: with E =
// d(state where the next piece begins) / d(coordinates), M the state's transition, G = information of (state, coordinates),
//   I_ab = E_a' M_(a+1)' ... M_(b-1)' G_b for a < b.
// Not modelled: unobserved blocks at rest; variation within a cell at rest, or of a pattern within a part of a turn.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>

#include "calib/joint/joint_filter.h"
#include "calib/model/effects.h"

namespace turncal {

// A recording cut into cells: pieces of rest, and parts of the turns between them.
//
// Sensor errors are taken as constant over a cell. A rest is cut soon after its beginning (first_cuts_s), since the
// after-effects of a turn fade, and then every longest_piece_s; a turn is cut wherever the unit has turned by part_rad.
// Epochs are coarser: a turn with the rest after it, long rests cut at epoch_s.

inline constexpr std::array<double, 4> first_cuts_s = {3.0, 9.0, 25.0, 60.0};
inline constexpr double longest_piece_s = 120.0, part_rad = 0.2, epoch_s = 150.0;

struct ErrorCell {
  BlockState at;  // means over it; duration_s: its whole length
  bool turns = false;
  int epoch = 0;
  JumpByReadings jump = JumpByReadings::Zero();  // part of a turn: its jump at the end of the turn
};

struct Piece {  // of rest
  std::size_t first_step = 0, last_step = 0;
  int segment = 0;
  int turn = 0;                       // number of turns before it
  bool after_turn = false;            // the first piece after a turn
  double begin_s = 0.0, end_s = 0.0;  // from the first sample
  std::size_t first_cell = 0;         // first part of the turn before it; up to rest_cell, the rest
  std::size_t rest_cell = 0;
};

struct Pieces {
  std::vector<Piece> pieces;
  std::vector<ErrorCell> cells;
  std::vector<int> cell_of_block;             // -1: none
  std::vector<JumpByReadings> jump_of_block;  // 0: at rest
  int epochs = 0;
  std::size_t fitted_cells = 0;  // cells behind these belong to held-out recordings
  // Hand-turned data (rest_diagnosis.h): by cell, the derivatives of the coordinates (there the observations) by its readings. Else empty.
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> responses;
};

// Appends the pieces of another recording, under this number.
void append(const Pieces& more, int recording, Pieces& all);

// Sets ErrorCell::at of all cells from the states of the blocks.
void average_cells(const std::vector<BlockState>& states, Pieces& pieces);

// Cuts a recording into pieces. `steps`, `states`: of the blocks, from one filter pass; states.size() == recording.blocks.size().
Pieces cut_into_pieces(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                       std::vector<BlockState> states);

// ---- the equations of the pieces ----

inline constexpr int piece_dims = 12;

// Sparse columns over the coordinates. A row holds `mine` of them, beginning with column `first`; rows that are zero in all columns are left out.
struct Weights {
  Eigen::Index columns = 0, mine = 0;
  std::vector<Eigen::Index> rows, first;  // coordinates, rising
  std::vector<std::size_t> begin = {0};   // where each piece begins in `rows`; and the end
  std::vector<double> values;
  Eigen::VectorXd pull;  // bias of the scores due to noise in the columns (errors in variables); empty: none
  Eigen::Map<const Eigen::MatrixXd> of() const { return {values.data(), mine, std::ssize(rows)}; }  // mine x rows
  // Adds the next piece; `coordinates`: mine x piece_dims.
  void add(Eigen::Index first_column, const Eigen::MatrixXd& coordinates);
  // Returns dense `rows`, one per coordinate, cut into pieces.
  static Weights of_rows(const Eigen::MatrixXd& rows);
  // Both use the first coordinates only. `times` returns the rows times L; `products` returns y, with a column per coordinate, times the rows.
  Eigen::MatrixXd times(const Eigen::MatrixXd& L, Eigen::Index coordinates) const;
  Eigen::MatrixXd products(const Eigen::MatrixXd& y) const;
  std::size_t rows_of(Eigen::Index coordinates) const { return begin[std::size_t(coordinates / piece_dims)]; }
};

class PieceSystem {
 public:
  // `pass`: run with keep_steps (not kept), at `parameters` and `noise`; `columns`: which of the model's parameters.
  PieceSystem(const CompressedRecording& recording, const FilterResult& pass, const Parameters& parameters,
              const NoiseModel& noise, const std::vector<int>& columns, const Pieces& pieces);

  // The system of independent observations, from residuals over their sigmas and their derivatives by the parameters. The
  // coordinates are the observations, padded to whole pieces. `log_variance`: sum of the logarithms of the variances.
  PieceSystem(const Eigen::MatrixXd& derivatives, const Eigen::VectorXd& residuals, double log_variance);

  // The system of two recordings, before put_back(): the pieces of `second` follow those of `first`. Parameters are
  // common, except those at `own`, which the second has for itself.
  PieceSystem(const PieceSystem& first, const PieceSystem& second, const std::vector<Eigen::Index>& own);

  // Q and s of one set of columns, and how far one unit of each column moves the parameters.
  struct Block {
    Eigen::MatrixXd Q;
    Eigen::VectorXd s;
    Eigen::MatrixXd shift;   // parameters x columns
    Eigen::VectorXd before;  // diagonal of Q before elimination of the parameters
  };
  // Returns the block of each set of columns; `wanted`: marks the sets to compute, empty: all. The others stay empty.
  std::vector<Block> blocks(const std::vector<Weights>& weights, const std::vector<char>& wanted = {}) const;
  const Eigen::VectorXd& scores() const { return s_; }  // of the coordinates; put_back() changes them
  Eigen::VectorXd score(const Weights& weights) const;
  // The system of one piece.
  using Information = Eigen::Matrix<double, piece_dims, piece_dims>;
  struct OfPiece {
    Information Q;
    Eigen::Matrix<double, piece_dims, 1> s, before;
  };
  OfPiece of_piece(std::size_t piece) const;
  const Information& information(std::size_t piece) const { return links_[piece].I; }  // before elimination
  // The bias of the scores due to errors in variables (noise_fit.h): the white noise of a reading is correlated with its effect on
  // the velocities. For each reading of a cell: the excess score of a column of which that reading is a factor.
  const Eigen::Matrix<double, 6, 1>& pull(std::size_t cell) const { return pull_[cell]; }
  // Returns Q x over all coordinates.
  Eigen::MatrixXd times(const Eigen::MatrixXd& x) const;
  // The pass corrected for errors `x`; restores them in the data, to first order.
  void put_back(const Eigen::VectorXd& x);
  // Returns how far errors x move the parameters.
  Eigen::MatrixXd shift(const Eigen::MatrixXd& x) const { return A_inverse_ * (R_.transpose() * x); }
  const Eigen::VectorXd& fit_shift() const { return fit_shift_; }  // of the parameters to their optimum without errors
  const Eigen::MatrixXd& covariance() const { return A_inverse_; }
  // -2 ln L without errors, up to a constant, with the parameters integrated out.
  double misfit() const { return misfit_; }
  Eigen::Index coordinates() const { return s_.size(); }

 private:
  void run(const FilterResult& pass, const CompressedRecording& recording, const std::vector<int>& columns,
           const Eigen::Matrix<double, 6, 1>& walks, const Pieces& pieces);
  void eliminate_parameters();
  double fixed_misfit() const;  // at the parameters of the pass

  struct Link {
    Information I;
    Eigen::Matrix<double, Eigen::Dynamic, piece_dims> E, G;  // states x piece_dims
    Eigen::MatrixXd M;
  };
  int states_ = 6;  // psi, v; with bias instability b_g, b_a
  double misfit_ = 0.0;
  // The part of a column's information below which it counts as unknown. Pulls are taken off to first order: where they
  // move parameters by x sigma, they may be off by a part x of themselves, but by no more than all.
  double floor_ = 0.0;
  std::vector<Link> links_;  // from each piece to the next
  std::vector<Eigen::Matrix<double, 6, 1>> pull_;
  Eigen::VectorXd s_;
  Eigen::MatrixXd R_;  // coordinates x parameters
  Eigen::MatrixXd A_, A_inverse_;
  Eigen::VectorXd gradient_;
  Eigen::VectorXd fit_shift_;
};

}  // namespace turncal
