#include "calib/diagnosis/segment_scores.h"

#include <algorithm>
#include <cmath>

#include "calib/diagnosis/backward_step.h"
#include "calib/model/parameters.h"
#include "calib/statistics/linear_algebra.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Pieces of rest in order, with what the tests need to know of each.
std::vector<Piece> pieces_of(const CompressedRecording& recording, const std::vector<FilterStep>& steps,
                             double reference_temperature_c, const LackOfFitLimits& limits) {
  std::vector<Piece> pieces;
  const double period = recording.info.sample_period_s;
  const auto start_s = [&](const Block& b) {
    return static_cast<double>(b.start_sample - recording.blocks.front().start_sample) * period;
  };
  std::vector<Turn> turns;
  int turn = 0;
  double rest_began_s = 0.0;
  bool at_rest = false;
  int segment = -1;  // of the last turn
  const auto commanded = [&](int of) -> Vector3d {
    const Segment& s = recording.segments[static_cast<std::size_t>(of)];
    return Vector3d(s.heading_deg, s.pitch_deg, s.roll_deg) * rad_per_deg;
  };
  double temperature = 0.0, weight = 0.0;
  for (std::size_t k = 0; k < steps.size(); ++k) {
    const Block& block = recording.blocks[steps[k].block];
    if (!steps[k].observed) {
      if (recording.segments[block.segment].kind != SegmentKind::rotate) continue;
      if (at_rest) ++turn;
      at_rest = false;
      if (turns.empty() || segment != block.segment) {
        turns.emplace_back();
        turns.back().turn = turn;
        turns.back().table_rad = 0.5 * (commanded(block.segment) + commanded(std::max(0, block.segment - 1)));
      }
      segment = block.segment;
      const Matrix3d& C = steps[k].C_mid;
      for (Turn& earlier : turns)
        if (&earlier != &turns.back()) earlier.go_on(steps[k].F, block.duration_s, Matrix3d::Zero(), Matrix3d::Zero());
      turns.back().go_on(steps[k].F, block.duration_s, C * steps[k].rotation.asDiagonal(), C * block.duration_s);
      turns.back().length_s += block.duration_s;
      turns.back().rotation += steps[k].rotation;
      turns.back().lifted += C * Vector3d(C.row(1).transpose() * block.duration_s).asDiagonal();
      if (!std::isnan(block.temperature_c)) turns.back().temperature_c = block.temperature_c - reference_temperature_c;
      continue;
    }
    const double t = start_s(block);
    if (!at_rest) rest_began_s = t;
    const bool begins = !at_rest || pieces.back().segment != block.segment;
    const double since = t - rest_began_s;
    const bool cut = !begins && ((pieces.back().since_turn_s < limits.first_piece_s && since >= limits.first_piece_s) ||
                                 t - pieces.back().begin_s >= limits.longest_piece_s);
    if (begins || cut) {
      Piece piece;
      piece.first_step = k;
      piece.segment = block.segment;
      piece.after_turn = !at_rest && !pieces.empty();
      piece.begin_s = t;
      piece.since_turn_s = since;
      piece.C_nb = steps[k].C_mid;
      piece.turn = turn;
      piece.table_rad = commanded(block.segment);
      if (piece.after_turn) piece.turns = turns;
      turns.clear();
      temperature = weight = 0.0;
      pieces.push_back(piece);
    }
    at_rest = true;
    Piece& piece = pieces.back();
    piece.last_step = k;
    piece.end_s = t + block.duration_s;
    if (!std::isnan(block.temperature_c)) {
      temperature += block.temperature_c - reference_temperature_c;
      weight += 1.0;
    }
    piece.temperature_c = weight > 0.0 ? temperature / weight : 0.0;
  }
  return pieces;
}

}  // namespace

void Turn::go_on(const Matrix3d& F, double t, const Matrix3d& more_turned, const Matrix3d& more_pushed) {
  fallen_turned -= F * (turned + 0.5 * more_turned) * t;
  fallen_pushed -= F * (pushed + 0.5 * more_pushed) * t;
  turned += more_turned;
  pushed += more_pushed;
}

Matrix3d Piece::turned() const {
  Matrix3d sum = Matrix3d::Zero();
  for (const Turn& part : turns) sum += part.turned;
  return sum;
}

Matrix3d Piece::fallen() const {
  Matrix3d sum = Matrix3d::Zero();
  for (const Turn& part : turns) sum += part.fallen_turned;
  return sum;
}

SegmentScores::SegmentScores(const CompressedRecording& recording, const FilterResult& pass,
                             const std::vector<int>& columns, double reference_temperature_c,
                             const LackOfFitLimits& limits, const MatrixXd& prior)
    : pieces_(pieces_of(recording, pass.steps, reference_temperature_c, limits)) {
  MatrixXd A = pass.information(columns, columns);
  if (prior.size() > 0) A += prior;
  const VectorXd scale = A.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const MatrixXd unit = scale.asDiagonal() * A * scale.asDiagonal();
  const MatrixXd lifted = unit + 1e-13 * MatrixXd::Identity(A.rows(), A.cols());
  A_inverse_ = scale.asDiagonal() * solve_symmetric(lifted, MatrixXd(scale.asDiagonal()));
  s_.setZero(piece_dims * static_cast<Eigen::Index>(pieces_.size()));
  R_.setZero(s_.size(), static_cast<Eigen::Index>(columns.size()));
  links_.resize(pieces_.size());
  const bool biases = std::any_of(pass.steps.begin(), pass.steps.end(), [](const FilterStep& s) {
    return s.observed && s.K.bottomRows<6>().squaredNorm() > 0.0;
  });
  run(biases ? 12 : 6, pass, recording, columns);
  s_ += R_ * (A_inverse_ * VectorXd(pass.gradient(columns)));  // the fit stops a little short of its optimum
}

// Going back, the transition T to where the next piece begins, the scores r and their information with the columns R go through the same
// steps: they are rows of one matrix.
void SegmentScores::run(int states, const FilterResult& pass, const CompressedRecording& recording,
                        const std::vector<int>& columns) {
  const int NS = states;
  const int Z = NS + 6;  // state, then the biases within the piece
  const int p = static_cast<int>(columns.size());
  MatrixXd carried = MatrixXd::Zero(Z + p + 1, Z);
  const auto T = [&] { return carried.topRows(Z); };
  const auto R = [&] { return carried.middleRows(Z, p); };
  const auto r = [&] { return carried.bottomRows<1>(); };
  T().setIdentity();
  MatrixXd I = MatrixXd::Zero(Z, Z), half(Z, Z);
  MatrixXd turn = MatrixXd::Identity(Z, Z);  // the steps of a turn are taken together
  bool turning = false;
  const auto end_turn = [&] {
    if (!turning) return;
    carried = (carried * turn).eval();
    half.noalias() = I * turn;
    I.noalias() = turn.transpose() * half;
    turn.setIdentity();
    turning = false;
  };
  // psi and v before a chain say nothing about what comes in it, and biases of one recording nothing about the next.
  const auto forget = [&](const FilterStep& step) {
    const int states_lost = step.begins_recording ? NS : 6;
    carried.leftCols(states_lost).setZero();
    I.topRows(states_lost).setZero();
    I.leftCols(states_lost).setZero();
  };
  std::vector<int> mine;  // of a piece: its biases, and a jump of psi and v
  for (int d = 0; d < 6; ++d) mine.push_back(NS + d);
  for (int d = 0; d < 6; ++d) mine.push_back(d);
  Eigen::Matrix<double, Eigen::Dynamic, 3> N(p + 1, 3);
  std::size_t piece = pieces_.size();
  for (std::size_t k = pass.steps.size(); k-- > 0;) {
    const FilterStep& step = pass.steps[k];
    const double t = recording.blocks[step.block].duration_s;
    if (piece > 0 && k == pieces_[piece - 1].last_step) --piece;
    const bool in_piece = piece < pieces_.size() && k >= pieces_[piece].first_step && k <= pieces_[piece].last_step;
    const BackwardStep back(step, t, NS, in_piece);
    if (!step.observed && !in_piece && !step.begins_chain) {
      back.apply(turn);
      turning = true;
      continue;
    }
    end_turn();
    back.apply(carried);
    back.apply(I);
    half = I.transpose();
    I.swap(half);
    back.apply(I);
    if (step.observed) {
      const Eigen::Matrix<double, 3, Eigen::Dynamic> SH = step.S_inverse * back.H();
      I.noalias() += back.H().transpose() * SH;
      for (int c = 0; c < p; ++c) N.row(c) = step.N.row(columns[static_cast<std::size_t>(c)]);
      N.row(p) = step.nu.transpose();
      carried.bottomRows(p + 1).noalias() += N * SH;
    }
    if (!in_piece || k != pieces_[piece].first_step) {
      if (step.begins_chain) forget(step);
      continue;
    }
    const auto state = Eigen::seqN(0, NS);
    const Eigen::Index row = piece_dims * static_cast<Eigen::Index>(piece);
    s_.segment<piece_dims>(row) = -r()(mine).transpose();
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

namespace {

// Columns k < n - 1 become the sum of those after k; the last one goes.
void sum_later(MatrixXd& M) {
  for (Eigen::Index k = M.cols() - 1; k > 1; --k) M.col(k - 1) += M.col(k);
  M = M.rightCols(std::max<Eigen::Index>(M.cols() - 1, 0)).eval();
}

}  // namespace

std::vector<SegmentScores::Test> SegmentScores::tests(const std::vector<Weights>& weights) const {
  Eigen::Index all = 0;
  for (const Weights& w : weights) all += w.columns;
  std::vector<MatrixXd> Q(weights.size());  // with itself, and half of what it has with later pieces
  for (std::size_t k = 0; k < weights.size(); ++k) Q[k].setZero(weights[k].columns, weights[k].columns);
  MatrixXd cross = MatrixXd::Zero(R_.cols(), all);
  VectorXd s = VectorXd::Zero(all);
  // Side by side, products of many columns cost little more than those of one. Transposed: a row a weight.
  MatrixXd later;  // information of the state where the next piece begins with the weighted pieces from there on
  MatrixXd next, from_later, W, WI;
  for (std::size_t a = pieces_.size(); a-- > 0;) {
    const Link& link = links_[a];
    const Eigen::Index row = piece_dims * static_cast<Eigen::Index>(a);
    const bool last = later.size() == 0;
    if (!last) from_later.noalias() = later * link.E;
    if (last)
      next.setZero(all, link.M.rows());
    else
      next.noalias() = later * link.M;
    Eigen::Index at = 0;
    for (std::size_t k = 0; k < weights.size(); at += weights[k].columns, ++k) {
      const Weights::Part part = weights[k].at(pieces_[a]);
      const Eigen::Index n = weights[k].columns, m = part.of.cols();
      if (m == 0) continue;
      W = part.of.transpose();
      WI.noalias() = W * link.I;
      auto mine = Q[k].middleRows(part.first, m);
      for (int d = 0; d < piece_dims; ++d) {
        if ((W.col(d).array() == 0.0).all()) continue;  // one sensor's weights are of few dimensions
        mine.middleCols(part.first, m).noalias() += W.col(d) * (0.5 * WI.col(d)).transpose();
        if (!last) mine.noalias() += W.col(d) * from_later.col(d).segment(at, n).transpose();
      }
      next.middleRows(at + part.first, m).noalias() += W * link.G.transpose();
      cross.middleCols(at + part.first, m).noalias() += R_.middleRows<piece_dims>(row).transpose() * part.of;
      s.segment(at + part.first, m).noalias() += W * s_.segment<piece_dims>(row);
    }
    later.swap(next);
  }
  std::vector<Test> results(weights.size());
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < weights.size(); at += weights[k].columns, ++k) {
    Test& result = results[k];
    result.Q = Q[k] + Q[k].transpose();
    MatrixXd with_model(R_.cols() + 1, weights[k].columns);
    with_model << cross.middleCols(at, weights[k].columns), s.segment(at, weights[k].columns).transpose();
    if (weights[k].summed) {
      sum_later(with_model);
      sum_later(result.Q);
      result.Q.transposeInPlace();
      sum_later(result.Q);
    }
    const MatrixXd by_model = with_model.topRows(R_.cols());
    result.s = with_model.bottomRows<1>().transpose();
    result.shift = -A_inverse_ * by_model;
    result.before = result.Q.diagonal();
    result.Q.noalias() += by_model.transpose() * result.shift;
    result.Q = (0.5 * (result.Q + result.Q.transpose())).eval();
  }
  return results;
}

// With the other columns eliminated: q = 1 / (A^-1)_ee of the column e, -q shift_e between it and the test's, Q + q shift_e' shift_e of those.
double SegmentScores::correlation(const Test& test, Eigen::Index column, double floor) const {
  const double q = 1.0 / A_inverse_(column, column);
  const Eigen::RowVectorXd shift = test.shift.row(column);
  Test free = test;
  free.Q += q * shift.transpose() * shift;
  return std::sqrt(q) * (ranked_chi_square(free, floor).whiten * shift.transpose()).norm();
}

SegmentScores::Test SegmentScores::test(std::size_t piece, const std::vector<int>& dims) const {
  std::vector<int> rows;
  for (const int d : dims) rows.push_back(piece_dims * static_cast<int>(piece) + d);
  Test result;
  result.s = s_(rows);
  result.Q = links_[piece].I(dims, dims);
  result.before = result.Q.diagonal();
  const MatrixXd cross = R_(rows, Eigen::all).transpose();
  result.shift = -A_inverse_ * cross;
  result.Q += cross.transpose() * result.shift;
  return result;
}

// C x, with C_ab = W_a (E_a' M_(a+1)' ... M_(b-1)' G_b - R_a A^-1 R_b') W_b' for a < b.
MatrixXd SegmentScores::covariance_times(const std::vector<int>& dims, const std::vector<Whitened>& scores,
                                         const MatrixXd& columns) const {
  const Eigen::Index n = static_cast<Eigen::Index>(links_.size()), k = columns.cols();
  const Eigen::Index d = static_cast<Eigen::Index>(dims.size());
  const Eigen::Index states = n > 0 ? links_.front().M.rows() : 0;
  MatrixXd x = MatrixXd::Zero(n * d, k), y = MatrixXd::Zero(n * d, k), result(columns.rows(), k);
  MatrixXd by_model = MatrixXd::Zero(R_.cols(), k);
  const auto model_of = [&](std::size_t piece) -> MatrixXd {
    MatrixXd rows(d, R_.cols());
    for (Eigen::Index i = 0; i < d; ++i)
      rows.row(i) = R_.row(piece_dims * static_cast<Eigen::Index>(piece) + dims[static_cast<std::size_t>(i)]);
    return rows;
  };
  Eigen::Index at = 0;
  for (const Whitened& w : scores) {
    auto of_piece = x.middleRows(d * static_cast<Eigen::Index>(w.piece), d);
    of_piece.noalias() = w.whiten.transpose() * columns.middleRows(at, w.whiten.rows());
    by_model.noalias() += model_of(w.piece).transpose() * of_piece;
    at += w.whiten.rows();
  }
  MatrixXd later = MatrixXd::Zero(states, k), earlier = later, next(states, k);
  for (Eigen::Index a = n; a-- > 0;) {
    const Link& link = links_[static_cast<std::size_t>(a)];
    const MatrixXd E = link.E(Eigen::all, dims), G = link.G(Eigen::all, dims), I = link.I(dims, dims);
    y.middleRows(a * d, d).noalias() = I * x.middleRows(a * d, d);
    y.middleRows(a * d, d).noalias() += E.transpose() * later;
    next.noalias() = link.M.transpose() * later;
    next.noalias() += G * x.middleRows(a * d, d);
    later.swap(next);
  }
  for (Eigen::Index a = 0; a < n; ++a) {
    const Link& link = links_[static_cast<std::size_t>(a)];
    const MatrixXd E = link.E(Eigen::all, dims), G = link.G(Eigen::all, dims);
    y.middleRows(a * d, d).noalias() += G.transpose() * earlier;
    next.noalias() = link.M * earlier;
    next.noalias() += E * x.middleRows(a * d, d);
    earlier.swap(next);
  }
  const MatrixXd eliminated = A_inverse_ * by_model;
  at = 0;
  for (const Whitened& w : scores) {
    const MatrixXd of_piece = y.middleRows(d * static_cast<Eigen::Index>(w.piece), d) - model_of(w.piece) * eliminated;
    result.middleRows(at, w.whiten.rows()).noalias() = w.whiten * of_piece;
    at += w.whiten.rows();
  }
  return result;
}

std::array<double, 3> SegmentScores::traces(const std::vector<int>& dims, const std::vector<Whitened>& scores) const {
  constexpr Eigen::Index at_once = 120;
  Eigen::Index rows = 0;
  for (const Whitened& w : scores) rows += w.whiten.rows();
  std::array<double, 3> traces = {};
  for (Eigen::Index begin = 0; begin < rows; begin += at_once) {
    const Eigen::Index k = std::min(at_once, rows - begin);
    MatrixXd unit = MatrixXd::Zero(rows, k);
    unit.middleRows(begin, k).setIdentity();
    const MatrixXd C = covariance_times(dims, scores, unit);
    traces[0] += C.middleRows(begin, k).trace();
    traces[1] += C.squaredNorm();
    traces[2] += C.cwiseProduct(covariance_times(dims, scores, C)).sum();
  }
  return traces;
}

RankedChiSquare ranked_chi_square(const SegmentScores::Test& test, double floor) {
  RankedChiSquare result;
  result.estimate.setZero(test.s.size());
  result.whiten.resize(test.s.size(), test.s.size());
  // A column of which the pieces show nothing (a product of two axes where all stand on one) is left out.
  const double least = 1e-12 * test.before.maxCoeff();
  VectorXd scale = VectorXd::Zero(test.before.size());
  for (Eigen::Index k = 0; k < scale.size(); ++k)
    if (test.before[k] > least) scale[k] = 1.0 / std::sqrt(test.before[k]);
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * test.Q * scale.asDiagonal());
  const VectorXd along = eigen.vectors.transpose() * scale.cwiseProduct(test.s);
  for (Eigen::Index k = 0; k < along.size(); ++k) {
    const double value = eigen.values[k];
    if (value < floor) continue;
    result.chi_square += along[k] * along[k] / value;
    result.whiten.row(result.rank) = eigen.vectors.col(k).cwiseProduct(scale).transpose() / std::sqrt(value);
    ++result.rank;
    result.estimate += scale.cwiseProduct(eigen.vectors.col(k)) * (along[k] / value);
  }
  result.whiten.conservativeResize(result.rank, Eigen::NoChange);
  return result;
}

}  // namespace turncal
