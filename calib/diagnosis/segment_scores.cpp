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
  const auto forget = [&] {  // psi and v before a chain say nothing about what comes in it
    carried.leftCols<6>().setZero();
    I.topRows<6>().setZero();
    I.leftCols<6>().setZero();
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
      if (step.begins_chain) forget();
      continue;
    }
    const auto state = Eigen::seqN(0, NS);
    const Eigen::Index row = piece_dims * static_cast<Eigen::Index>(piece);
    s_.segment<piece_dims>(row) = -r()(mine).transpose();
    R_.middleRows<piece_dims>(row) = R()(Eigen::all, mine).transpose();
    Link& link = links_[piece];
    link.I = I(mine, mine);
    link.E = T()(state, mine);
    if (step.begins_chain) forget();
    link.G = I(state, mine);
    link.M = T()(state, state);
    T().setIdentity();
    carried.bottomRows(p + 1).rightCols<6>().setZero();
    I.bottomRows<6>().setZero();
    I.rightCols<6>().setZero();
  }
}

std::vector<SegmentScores::Test> SegmentScores::tests(const std::vector<MatrixXd>& weights) const {
  Eigen::Index all = 0;
  for (const MatrixXd& w : weights) all += w.cols();
  std::vector<Test> results(weights.size());
  MatrixXd together(rows(), all);  // side by side: products of many columns cost little more than those of one
  std::vector<MatrixXd> with_later(weights.size()), with_itself(weights.size());
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const Eigen::Index n = weights[k].cols();
    together.middleCols(at, n) = weights[k];
    with_later[k] = with_itself[k] = MatrixXd::Zero(n, n);
    at += n;
  }
  // All transposed: a row a weight.
  MatrixXd later;  // information of the state where the next piece begins with the weighted pieces from there on
  MatrixXd w(all, piece_dims), itself(all, piece_dims), next, from_later;
  for (std::size_t a = pieces_.size(); a-- > 0;) {
    const Link& link = links_[a];
    w = together.middleRows<piece_dims>(piece_dims * static_cast<Eigen::Index>(a)).transpose();
    itself.noalias() = w * link.I;
    if (later.size() > 0) from_later.noalias() = later * link.E;
    at = 0;
    for (std::size_t k = 0; k < weights.size(); ++k) {
      const Eigen::Index n = weights[k].cols();
      for (int d = 0; d < piece_dims; ++d) {
        const auto mine = w.col(d).segment(at, n);
        if ((mine.array() == 0.0).all()) continue;  // one sensor's weights are of few dimensions
        with_itself[k].noalias() += mine * itself.col(d).segment(at, n).transpose();
        if (later.size() > 0) with_later[k].noalias() += mine * from_later.col(d).segment(at, n).transpose();
      }
      at += n;
    }
    next.noalias() = w * link.G.transpose();
    if (later.size() > 0) next.noalias() += later * link.M;
    later.swap(next);
  }
  const MatrixXd cross = R_.transpose() * together;
  const MatrixXd shift = -A_inverse_ * cross;
  const VectorXd s = together.transpose() * s_;
  at = 0;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const Eigen::Index n = weights[k].cols();
    Test& result = results[k];
    result.s = s.segment(at, n);
    result.shift = shift.middleCols(at, n);
    result.Q = with_itself[k] + with_later[k] + with_later[k].transpose();
    result.before = result.Q.diagonal();
    result.Q.noalias() += cross.middleCols(at, n).transpose() * result.shift;
    result.Q = (0.5 * (result.Q + result.Q.transpose())).eval();
    at += n;
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

MatrixXd SegmentScores::covariance(const std::vector<int>& dims) const {
  const Eigen::Index d = static_cast<Eigen::Index>(dims.size()), n = static_cast<Eigen::Index>(pieces_.size());
  MatrixXd Q = MatrixXd::Zero(n * d, n * d);
  MatrixXd R(n * d, R_.cols());
  MatrixXd later;  // information of the state where the next piece begins with the pieces from there on
  for (Eigen::Index a = n; a-- > 0;) {
    const Link& link = links_[static_cast<std::size_t>(a)];
    const Eigen::Index after = (n - a - 1) * d;
    MatrixXd here(link.M.rows(), after + d);
    here.leftCols(d) = link.G(Eigen::all, dims);
    if (after > 0) {
      Q.block(a * d, (a + 1) * d, d, after).noalias() = link.E(Eigen::all, dims).transpose() * later;
      here.rightCols(after).noalias() = link.M.transpose() * later;
    }
    Q.block(a * d, a * d, d, d) = link.I(dims, dims);
    for (Eigen::Index k = 0; k < d; ++k) R.row(a * d + k) = R_.row(piece_dims * a + dims[static_cast<std::size_t>(k)]);
    later = std::move(here);
  }
  Q.triangularView<Eigen::StrictlyLower>() = Q.transpose();
  Q.noalias() -= R * (A_inverse_ * R.transpose());
  return Q;
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
