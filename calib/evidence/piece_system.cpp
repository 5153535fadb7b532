#include "calib/evidence/piece_system.h"

#include <algorithm>

#include "calib/joint/noise_fit.h"
#include "calib/model/parameters.h"
#include "calib/statistics/numerics.h"

namespace turncal {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The fields of BlockState that a cell averages over its blocks.
constexpr std::array mean_vectors = {&BlockState::f_b, &BlockState::w_b, &BlockState::w_dot_b, &BlockState::table_rad};
constexpr std::array mean_numbers = {&BlockState::time_s, &BlockState::since_rotation_s, &BlockState::temperature_c};

// Adds a block to the sums of a cell, weighted by its length; divide() turns them into means.
void add(const BlockState& s, ErrorCell& cell) {
  const bool first = cell.at.duration_s == 0.0;
  if (first) cell.at = s;
  for (const auto m : mean_vectors)
    cell.at.*m = (first ? Vector3d::Zero() : Vector3d(cell.at.*m)) + s.duration_s * s.*m;
  for (const auto m : mean_numbers) cell.at.*m = (first ? 0.0 : cell.at.*m) + s.duration_s * s.*m;
  if (!first) cell.at.duration_s += s.duration_s;
}

void divide(ErrorCell& cell) {
  const double t = cell.at.duration_s > 0.0 ? cell.at.duration_s : 1.0;
  for (const auto m : mean_vectors) cell.at.*m /= t;
  for (const auto m : mean_numbers) cell.at.*m /= t;
}

// Sets the table angles of the blocks in turns, interpolated by the rotation up to the middle of the block.
void set_table_angles(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                      std::vector<BlockState>& states) {
  std::vector<double> whole(recording.segments.size(), 1e-9);
  for (const FilterStep& step : steps) whole[recording.blocks[step.block].segment] += step.rotation.norm();
  std::vector<double> left = whole;
  for (const FilterStep& step : steps) {
    const auto to = std::size_t(recording.blocks[step.block].segment);
    const Vector3d from(angles_of(recording.segments[std::max<std::size_t>(to, 1) - 1]).value.data());
    Vector3d& angle = states[step.block].table_rad;
    angle += (left[to] - 0.5 * step.rotation.norm()) / whole[to] * (rad_per_deg * from - angle);
    left[to] -= step.rotation.norm();
  }
}

// Sets the jumps of the blocks before step `end`, back to the previous rest. An early error tilts gravity until the turn ends.
void set_jumps(const CompressedRecording& recording, const std::vector<FilterStep>& steps, std::size_t end,
               std::vector<JumpByReadings>& jump_of_block) {
  JumpByReadings onward = JumpByReadings::Identity();  // transition of psi and v from the end of a block
  for (std::size_t k = end; k-- > 0 && !steps[k].observed;) {
    const FilterStep& step = steps[k];
    jump_of_block[step.block] = onward * step.jump;
    if (step.begins_chain) return;
    const Matrix3d tilted = onward.bottomLeftCorner<3, 3>() * step.turn_n;
    onward.topLeftCorner<3, 3>() *= step.turn_n;
    onward.bottomLeftCorner<3, 3>() = tilted - step.F * recording.blocks[step.block].duration_s;
  }
}

}  // namespace

void append(const Pieces& more, int recording, Pieces& all) {
  const std::size_t before = all.cells.size();
  const int turns = all.pieces.empty() ? 0 : all.pieces.back().turn + 1;
  for (ErrorCell cell : more.cells) {
    cell.epoch += all.epochs;
    cell.at.recording = recording;
    all.cells.push_back(cell);
  }
  for (Piece piece : more.pieces) {
    piece.first_cell += before;
    piece.rest_cell += before;
    piece.turn += turns;
    all.pieces.push_back(piece);
  }
  all.epochs += more.epochs;
}

void average_cells(const std::vector<BlockState>& states, Pieces& pieces) {
  for (std::size_t k = 0; k < states.size(); ++k)
    if (pieces.cell_of_block[k] >= 0) add(states[k], pieces.cells[std::size_t(pieces.cell_of_block[k])]);
  for (ErrorCell& cell : pieces.cells) divide(cell);
  pieces.fitted_cells = pieces.cells.size();
}

Pieces cut_into_pieces(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                       std::vector<BlockState> states) {
  Pieces result;
  result.cell_of_block.assign(recording.blocks.size(), -1);
  result.jump_of_block.assign(recording.blocks.size(), JumpByReadings::Zero());
  const double period = recording.info.sample_period_s;
  std::vector<ErrorCell> turn;                                   // parts since the last rest
  std::vector<std::pair<std::size_t, std::size_t>> turn_blocks;  // block, part
  std::vector<double> turned;
  set_table_angles(recording, steps, states);
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
      add(state, turn.back());
      turned.back() += steps[k].rotation.norm();
      turn_blocks.emplace_back(index, turn.size() - 1);
      continue;
    }
    const double begin = double(block.start_sample - recording.blocks.front().start_sample) * period;
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
    const bool cut = begins || std::ranges::any_of(first_cuts_s, passes) ||
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
        set_jumps(recording, steps, k, result.jump_of_block);
        for (const auto& [of, part] : turn_blocks) {
          result.cell_of_block[of] = int(piece.first_cell + part);
          turn[part].jump += result.jump_of_block[of];
        }
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
    result.cell_of_block[index] = int(result.cells.size()) - 1;
    add(state, result.cells.back());
  }
  if (!result.pieces.empty()) divide(result.cells.back());
  result.epochs = result.pieces.empty() ? 0 : epoch + 1;
  result.fitted_cells = result.cells.size();
  return result;
}

// ---- the equations of the pieces ----

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Columns = Eigen::Matrix<double, Eigen::Dynamic, 3>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double rounding = 1e-9;  // part of a column's information before elimination

double log_determinant(const MatrixXd& A) {
  double log_det = 0.0;
  solve_symmetric(A, VectorXd(VectorXd::Zero(A.rows())), log_det);
  return log_det;
}

// One step of the filter run backward, applied to matrices whose columns are
//   psi, v (n frame), with bias instability b_g, b_a, and then the gyro and accelerometer biases within the current piece of rest.
// With Phi the transition of these and H the derivatives of nu by them (joint_filter.h), the closed-loop transition is L = Phi - K H. Phi
// is an identity but for a few 3x3 blocks, and K has three columns, so M L costs a tenth of the product of full matrices.
class BackwardStep {
 public:
  // `states`: 6 or 12. `t`: length of the step's block. `in_piece`: it is rest, so the piece's biases act.
  BackwardStep(const FilterStep& step, double t, int states, bool in_piece)
      : step_(step),
        states_(states),
        in_piece_(in_piece),
        psi_psi_(step.turn_n),
        v_psi_(-step.F * t),
        psi_b_(step.jump.topLeftCorner<3, 3>()),
        v_b_(step.jump.bottomLeftCorner<3, 3>()),
        v_a_(step.jump.bottomRightCorner<3, 3>()) {
    if (!step.observed) return;
    H_.setZero(3, states + 6);
    H_.leftCols<3>() = 0.5 * v_psi_;
    H_.middleCols<3>(3).setIdentity();
    const Matrix3d by_gyro = v_b_ / 3.0;
    const Matrix3d by_accel = 0.5 * v_a_;
    for (int at = 6; at <= states; at += 6) {  // b_g, b_a where there are any, then the piece's
      H_.middleCols<3>(at) = by_gyro;
      H_.middleCols<3>(at + 3) = by_accel;
    }
  }
  // M <- M L; M Phi if the step is not observed
  void apply(MatrixXd& M) const {
    const Columns psi = M.leftCols<3>(), v = M.middleCols<3>(3);
    Columns by_gain;
    if (step_.observed) {
      by_gain = psi * step_.K.middleRows<3>(0) + v * step_.K.middleRows<3>(3);
      if (states_ == 12) {
        by_gain += M.middleCols<3>(6) * step_.K.middleRows<3>(6);
        by_gain += M.middleCols<3>(9) * step_.K.middleRows<3>(9);
      }
    }
    const Columns gyro = psi * psi_b_ + v * v_b_, accel = v * v_a_;
    M.leftCols<3>() = psi * psi_psi_ + v * v_psi_;
    if (states_ == 12) {
      M.middleCols<6>(6) *= step_.rho;
      M.middleCols<3>(6) += gyro;
      M.middleCols<3>(9) += accel;
    }
    if (in_piece_) {
      M.middleCols<3>(states_) += gyro;
      M.middleCols<3>(states_ + 3) += accel;
    }
    if (!step_.observed) return;
    for (int at = 0; at < M.cols(); at += 3)
      if (at == 3)
        M.middleCols<3>(3) -= by_gain;
      else
        M.middleCols<3>(at) -= by_gain * H_.middleCols<3>(at);
  }
  const Eigen::Matrix<double, 3, Eigen::Dynamic>& H() const { return H_; }
  // Returns the information on the walks of the readings of an observed step of length t, times their variance at unit density. I: information on the
  // state at its end. A walk has a mean over the step and departs from it (StepNoise, linear_motion.h): by t^3 / 12 in v, t / 12 in mean v.
  Vector6 of_walks(const MatrixXd& I, double t) const {
    const auto gain = step_.K.topRows(states_);
    const auto seen = [&](const MatrixXd& by_state, const MatrixXd& by_mean) {
      const MatrixXd to = by_state - gain * by_mean;
      return Vector6((to.transpose() * I * to + by_mean.transpose() * step_.S_inverse * by_mean).diagonal());
    };
    MatrixXd mean = MatrixXd::Zero(states_, 6), departs = mean, departs_mean = MatrixXd::Zero(3, 6);
    mean.topRows<6>() = step_.jump;
    departs.block<3, 3>(3, 0) = step_.F * step_.C_mid * std::sqrt(t * t * t / 12.0);
    departs_mean.rightCols<3>() = step_.C_mid * std::sqrt(t / 12.0);
    return seen(mean, H_.rightCols<6>()) / t + seen(departs, departs_mean);
  }

 private:
  const FilterStep& step_;
  const int states_;
  const bool in_piece_;
  Matrix3d psi_psi_, v_psi_, psi_b_, v_b_, v_a_;
  Eigen::Matrix<double, 3, Eigen::Dynamic> H_;
};

}  // namespace

void Weights::add(Eigen::Index first_column, const MatrixXd& coordinates) {
  for (int d = 0; d < piece_dims; ++d) {
    const auto column = coordinates.col(d);
    if ((column.array() == 0.0).all()) continue;
    rows.push_back(piece_dims * (std::ssize(begin) - 1) + d);
    first.push_back(first_column);
    values.insert(values.end(), column.data(), column.data() + mine);
  }
  begin.push_back(rows.size());
}

Weights Weights::of_rows(const MatrixXd& rows) {
  Weights weights;
  weights.columns = weights.mine = rows.cols();
  MatrixXd piece(rows.cols(), piece_dims);
  for (Eigen::Index at = 0; at < rows.rows(); at += piece_dims) {
    const Eigen::Index count = std::min<Eigen::Index>(piece_dims, rows.rows() - at);
    piece.setZero();
    piece.leftCols(count) = rows.middleRows(at, count).transpose();
    weights.add(0, piece);
  }
  return weights;
}

MatrixXd Weights::times(const MatrixXd& L, Eigen::Index coordinates) const {
  MatrixXd x = MatrixXd::Zero(coordinates, L.cols());
  for (std::size_t i = 0; i < rows_of(coordinates); ++i)
    x.row(rows[i]).noalias() = of().col(Eigen::Index(i)).transpose() * L.middleRows(first[i], mine);
  return x;
}

MatrixXd Weights::products(const MatrixXd& y) const {
  const auto count = Eigen::Index(rows_of(y.cols()));
  const MatrixXd mine_of_y = y(Eigen::all, Eigen::Map<const Eigen::Matrix<Eigen::Index, -1, 1>>(rows.data(), count));
  if (mine == columns) return mine_of_y * of().leftCols(count).transpose();
  MatrixXd all = MatrixXd::Zero(y.rows(), columns);
  for (Eigen::Index i = 0, end; i < count; i = end) {  // a run of coordinates that share their columns
    for (end = i + 1; end < count && first[std::size_t(end)] == first[std::size_t(i)];) ++end;
    all.middleCols(first[std::size_t(i)], mine).noalias() +=
        mine_of_y.middleCols(i, end - i) * of().middleCols(i, end - i).transpose();
  }
  return all;
}

// A coordinate is the error of its observation, and a residual is prediction less observation.
PieceSystem::PieceSystem(const MatrixXd& derivatives, const VectorXd& residuals, double log_variance)
    : floor_(rounding) {
  A_ = derivatives.transpose() * derivatives;
  gradient_ = derivatives.transpose() * residuals;
  misfit_ = residuals.squaredNorm() + log_variance;
  links_.resize(std::size_t((residuals.size() + piece_dims - 1) / piece_dims));
  for (Link& link : links_) {
    link.I.setIdentity();
    link.E.setZero(states_, piece_dims);
    link.G.setZero(states_, piece_dims);
    link.M.setZero(states_, states_);
  }
  s_.setZero(piece_dims * std::ssize(links_));
  R_.setZero(s_.size(), derivatives.cols());
  R_.topRows(derivatives.rows()) = -derivatives;
  s_.head(residuals.size()) = -residuals;
  eliminate_parameters();
}

PieceSystem::PieceSystem(const CompressedRecording& recording, const FilterResult& pass, const Parameters& parameters,
                         const NoiseModel& noise, const std::vector<int>& columns, const Pieces& pieces) {
  A_ = pass.information(columns, columns);
  gradient_ = pass.gradient(columns);
  misfit_ = pass.chi_square + pass.log_determinant;
  if (std::ranges::any_of(pass.steps, [](const FilterStep& step) {
        return step.observed && step.K.bottomRows<6>().squaredNorm() > 0.0;
      }))
    states_ = 12;
  const auto n = Eigen::Index(pieces.pieces.size());
  s_.setZero(piece_dims * n);
  R_.setZero(s_.size(), Eigen::Index(columns.size()));
  links_.resize(pieces.pieces.size());
  pull_.assign(pieces.cells.size(), Vector6::Zero());
  Vector6 walks, all = Vector6::Zero();
  walks << noise.angle_random_walk.cwiseAbs2(), noise.velocity_random_walk.cwiseAbs2();
  run(pass, recording, columns, walks, pieces);
  for (const Vector6& of_cell : pull_) all += of_cell;
  const ParameterVector values = to_vector(parameters);
  VectorXd pull = VectorXd::Zero(gradient_.size());
  for (std::size_t k = 0; k < columns.size(); ++k)
    if (const auto at = std::ranges::find(scale_factor_parameters, columns[k]); at != scale_factor_parameters.end())
      pull[Eigen::Index(k)] = all[at - scale_factor_parameters.begin()] / values[columns[k]];
  gradient_ -= pull;
  eliminate_parameters();
  const double largest = (A_inverse_ * pull).cwiseAbs2().cwiseQuotient(A_inverse_.diagonal()).maxCoeff();
  floor_ = std::max(rounding, largest * std::min(1.0, largest));
}

PieceSystem::PieceSystem(const PieceSystem& first, const PieceSystem& second, const std::vector<Eigen::Index>& own)
    : states_(first.states_),
      misfit_(first.fixed_misfit() + second.fixed_misfit()),
      floor_(first.floor_),
      links_(first.links_),
      pull_(first.pull_) {
  pull_.insert(pull_.end(), second.pull_.begin(), second.pull_.end());
  const Eigen::Index p = first.A_.rows(), all = p + std::ssize(own), n = first.s_.size(), m = second.s_.size();
  Eigen::VectorXi place = Eigen::VectorXi::LinSpaced(second.A_.rows(), 0, int(second.A_.rows()) - 1);
  for (std::size_t k = 0; k < own.size(); ++k) place[own[k]] = int(p) + int(k);
  A_.setZero(all, all);
  A_.topLeftCorner(p, p) = first.A_;
  A_(place, place) += second.A_;
  gradient_.setZero(all);
  gradient_.head(p) = first.gradient_;
  gradient_(place) += second.gradient_;
  R_.setZero(n + m, all);
  R_.topLeftCorner(n, p) = first.R_;
  R_(Eigen::lastN(m), place) = second.R_;
  s_.resize(n + m);
  s_ << first.s_ - first.R_ * first.fit_shift_, second.s_ - second.R_ * second.fit_shift_;
  links_.back().E.setZero();
  links_.back().M.setZero();
  links_.insert(links_.end(), second.links_.begin(), second.links_.end());
  eliminate_parameters();
}

void PieceSystem::eliminate_parameters() {
  A_inverse_ = balanced_inverse(A_);
  fit_shift_ = -A_inverse_ * gradient_;
  misfit_ += gradient_.dot(fit_shift_) + log_determinant(A_);
  s_ += R_ * fit_shift_;
}

double PieceSystem::fixed_misfit() const { return misfit_ - gradient_.dot(fit_shift_) - log_determinant(A_); }

// Backward, the transition T to the beginning of the next piece, the score r and the information R with the parameters
// take the same steps, so they are rows of one matrix. The steps of a turn are multiplied first and applied together.
void PieceSystem::run(const FilterResult& pass, const CompressedRecording& recording, const std::vector<int>& columns,
                      const Vector6& walks, const Pieces& cut) {
  const std::vector<Piece>& pieces = cut.pieces;
  const auto add_pull = [&](std::size_t block, const Vector6& of_walks) {
    if (const int cell = cut.cell_of_block[block]; cell >= 0) pull_[std::size_t(cell)] += walks.cwiseProduct(of_walks);
  };
  const int states = states_;
  const int Z = states + 6;  // state, then the biases within the piece
  const int p = int(columns.size());
  MatrixXd carried = MatrixXd::Zero(Z + p + 1, Z);
  const auto T = [&] { return carried.topRows(Z); };
  const auto R = [&] { return carried.middleRows(Z, p); };
  const auto r = [&] { return carried.bottomRows<1>(); };
  T().setIdentity();
  MatrixXd I = MatrixXd::Zero(Z, Z), half(Z, Z);
  MatrixXd turn = MatrixXd::Identity(Z, Z);
  bool turning = false;
  const auto end_turn = [&] {
    if (!turning) return;
    carried = (carried * turn).eval();
    half.noalias() = I * turn;
    I.noalias() = turn.transpose() * half;
    turn.setIdentity();
    turning = false;
  };
  // psi and v before a chain tell nothing about what follows, nor do the biases of one recording about the next.
  const auto forget = [&](const FilterStep& step) {
    const int lost = step.begins_recording ? states : 6;
    carried.leftCols(lost).setZero();
    I.topRows(lost).setZero();
    I.leftCols(lost).setZero();
  };
  std::vector<int> mine;  // columns of a piece: its biases, and a jump of psi and v
  for (int d = 0; d < 6; ++d) mine.push_back(states + d);
  for (int d = 0; d < 6; ++d) mine.push_back(d);
  const auto state = Eigen::seqN(0, states);
  Eigen::Matrix<double, Eigen::Dynamic, 3> N(p + 1, 3);
  std::size_t piece = pieces.size();
  for (std::size_t k = pass.steps.size(); k-- > 0;) {
    const FilterStep& step = pass.steps[k];
    if (piece > 0 && k == pieces[piece - 1].last_step) --piece;
    const bool in_piece = piece < pieces.size() && k >= pieces[piece].first_step && k <= pieces[piece].last_step;
    const BackwardStep back(step, recording.blocks[step.block].duration_s, states, in_piece);
    if (!step.observed && !in_piece && !step.begins_chain) {
      const JumpByReadings& jump = cut.jump_of_block[step.block];
      const JumpByReadings seen = jump.transpose() * I.topLeftCorner<6, 6>() * jump;
      add_pull(step.block, seen.diagonal() / recording.blocks[step.block].duration_s);
      back.apply(turn);
      turning = true;
      continue;
    }
    end_turn();
    if (step.observed)
      add_pull(step.block, back.of_walks(I.topLeftCorner(states, states), recording.blocks[step.block].duration_s));
    back.apply(carried);
    back.apply(I);
    half = I.transpose();
    I.swap(half);
    back.apply(I);
    if (step.observed) {
      const Eigen::Matrix<double, 3, Eigen::Dynamic> SH = step.S_inverse * back.H();
      I.noalias() += back.H().transpose() * SH;
      for (int c = 0; c < p; ++c) N.row(c) = step.N.row(columns[std::size_t(c)]);
      N.row(p) = step.nu.transpose();
      carried.bottomRows(p + 1).noalias() += N * SH;
    }
    if (!in_piece || k != pieces[piece].first_step) {
      if (step.begins_chain) forget(step);
      continue;
    }
    const Eigen::Index row = piece_dims * Eigen::Index(piece);
    s_.segment<piece_dims>(row) = r()(mine).transpose();
    R_.middleRows<piece_dims>(row) = R()(Eigen::all, mine).transpose();
    Link& link = links_[piece];
    link.I = I(mine, mine);
    link.E = T()(state, mine);
    if (step.begins_chain) forget(step);
    link.G = I(state, mine);
    link.M = T()(state, state);
    T().setIdentity();
    carried.bottomRows(p + 1).rightCols<6>().setZero();
    I.bottomRows<6>().setZero();
    I.rightCols<6>().setZero();
  }
}

void PieceSystem::put_back(const VectorXd& x) {
  const VectorXd Qx = times(x);
  misfit_ += x.dot(2.0 * s_ + Qx);
  s_ += Qx;
  fit_shift_ -= A_inverse_ * (R_.transpose() * x);
}

std::vector<PieceSystem::Block> PieceSystem::blocks(const std::vector<Weights>& weights,
                                                    const std::vector<char>& wanted) const {
  const auto columns = [&](std::size_t k) { return wanted.empty() || wanted[k] ? weights[k].columns : 0; };
  Eigen::Index all = 0;
  std::vector<Block> result(weights.size());
  for (std::size_t k = 0; k < weights.size(); ++k) {
    all += columns(k);
    // Gets the products with later pieces and half the diagonal; the transpose is added below.
    result[k].Q.setZero(columns(k), columns(k));
    if (columns(k) > 0) result[k].s = score(weights[k]);
  }
  // All columns are stacked: products of many columns cost little more than those of one. Transposed: a row per column.
  MatrixXd later = MatrixXd::Zero(all, states_), next(all, states_);
  VectorXd beside(all);
  for (std::size_t a = links_.size(); a-- > 0;) {
    const Link& link = links_[a];
    const Eigen::Index row = piece_dims * Eigen::Index(a);
    next.noalias() = later * link.M;
    Eigen::Index at = 0;
    for (std::size_t k = 0; k < weights.size(); at += columns(k), ++k) {
      const Eigen::Index n = columns(k), m = weights[k].mine;
      if (n == 0) continue;
      const auto of = weights[k].of();
      const std::size_t begin = weights[k].begin[a], end = weights[k].begin[a + 1];
      const Eigen::Index lowest = begin < end ? weights[k].first[begin] : 0;  // lower columns begin in earlier pieces
      for (std::size_t i = begin; i < end; ++i) {
        const Eigen::Index d = weights[k].rows[i] - row, first = weights[k].first[i];
        const auto w = of.col(Eigen::Index(i));
        auto with = beside.head(n - lowest);
        with.noalias() = later.middleRows(at + lowest, n - lowest).lazyProduct(link.E.col(d));
        for (std::size_t j = begin; j <= i; ++j)
          with.segment(weights[k].first[j] - lowest, m) +=
              ((j < i ? 1.0 : 0.5) * link.I(weights[k].rows[j] - row, d)) * of.col(Eigen::Index(j));
        for (Eigen::Index c = 0; c < m; ++c) result[k].Q.col(first + c).tail(n - lowest) += w[c] * with;
        next.middleRows(at + first, m).noalias() += w.lazyProduct(link.G.col(d).transpose());
      }
    }
    later.swap(next);
  }
  const MatrixXd by_coordinate = R_.transpose();
  for (std::size_t k = 0; k < weights.size(); ++k) {
    Block& block = result[k];
    if (columns(k) == 0) continue;
    const MatrixXd by_parameters = weights[k].products(by_coordinate);
    block.shift = A_inverse_ * by_parameters;
    block.Q = (block.Q + block.Q.transpose()).eval();
    block.before = block.Q.diagonal();
    block.Q.noalias() -= by_parameters.transpose() * block.shift;
    block.Q = (0.5 * (block.Q + block.Q.transpose())).eval();
    block.Q.diagonal() += floor_ * block.before;
  }
  return result;
}

VectorXd PieceSystem::score(const Weights& weights) const {
  const VectorXd s = weights.products(s_.transpose()).transpose();
  return weights.pull.size() > 0 ? VectorXd(s - weights.pull) : s;
}

PieceSystem::OfPiece PieceSystem::of_piece(std::size_t piece) const {
  const Eigen::Index row = piece_dims * Eigen::Index(piece);
  const auto R = R_.middleRows<piece_dims>(row);
  const auto& I = links_[piece].I;
  return {I - R * A_inverse_ * R.transpose(), s_.segment<piece_dims>(row), I.diagonal()};
}

MatrixXd PieceSystem::times(const MatrixXd& x) const {
  const Eigen::Index k = x.cols();
  MatrixXd y(x.rows(), k), later = MatrixXd::Zero(states_, k), earlier = later, next(states_, k);
  const auto of = [](auto& all, std::size_t a) {
    return all.template middleRows<piece_dims>(piece_dims * Eigen::Index(a));
  };
  for (std::size_t a = links_.size(); a-- > 0;) {
    const Link& link = links_[a];
    of(y, a) = link.I * of(x, a) + link.E.transpose() * later;
    next = link.G * of(x, a) + link.M.transpose() * later;
    later.swap(next);
  }
  for (std::size_t a = 0; a < links_.size(); ++a) {
    const Link& link = links_[a];
    of(y, a) += link.G.transpose() * earlier;
    next = link.E * of(x, a) + link.M * earlier;
    earlier.swap(next);
  }
  y.noalias() -= R_ * (A_inverse_ * (R_.transpose() * x));
  return y;
}

}  // namespace turncal
