#include "calib/diagnosis/segment_scores.h"

#include <algorithm>
#include <cmath>

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
      turns.back().turned += C * steps[k].rotation.asDiagonal();
      turns.back().pushed += C * block.duration_s;
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

Matrix3d Piece::turned() const {
  Matrix3d sum = Matrix3d::Zero();
  for (const Turn& part : turns) sum += part.turned;
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

// Sizes of run time: with fixed ones (12 and 18) Eigen's products take a minute to compile and are no faster.
void SegmentScores::run(int states, const FilterResult& pass, const CompressedRecording& recording,
                        const std::vector<int>& columns) {
  const int NS = states;
  const int Z = NS + 6;  // state, then the biases within the piece
  const int p = static_cast<int>(columns.size());
  MatrixXd R = MatrixXd::Zero(Z, p), next(Z, p);
  VectorXd r = VectorXd::Zero(Z);
  MatrixXd I = MatrixXd::Zero(Z, Z);
  MatrixXd T = MatrixXd::Identity(Z, Z);  // from here to where the next piece begins
  MatrixXd weighted(3, p);
  std::size_t piece = pieces_.size();
  const auto forget = [&] {  // psi and v before a chain say nothing about what comes in it
    r.head<6>().setZero();
    I.topRows<6>().setZero();
    I.leftCols<6>().setZero();
    R.topRows<6>().setZero();
    T.leftCols<6>().setZero();
  };
  MatrixXd turn = MatrixXd::Identity(Z, Z);  // the steps of a turn are taken together
  bool turning = false;
  const auto end_turn = [&] {
    if (!turning) return;
    r = (turn.transpose() * r).eval();
    I = (turn.transpose() * I * turn).eval();
    next.noalias() = turn.transpose() * R;
    R.swap(next);
    T = (T * turn).eval();
    turn.setIdentity();
    turning = false;
  };
  for (std::size_t k = pass.steps.size(); k-- > 0;) {
    const FilterStep& step = pass.steps[k];
    const double t = recording.blocks[step.block].duration_s;
    if (piece > 0 && k == pieces_[piece - 1].last_step) --piece;
    const bool in_piece = piece < pieces_.size() && k >= pieces_[piece].first_step && k <= pieces_[piece].last_step;
    MatrixXd L = MatrixXd::Identity(Z, Z);
    const Matrix3d psi_b = step.C_mid * t;
    const Matrix3d v_b = -step.F * step.C_mid * (0.5 * t * t);
    L.block<3, 3>(0, 0) = step.turn_n;
    L.block<3, 3>(3, 0) = -step.F * t;
    if (in_piece) {
      L.block<3, 3>(0, NS) = psi_b;
      L.block<3, 3>(3, NS) = v_b;
      L.block<3, 3>(3, NS + 3) = psi_b;
    }
    if (NS == 12) {
      L.block<3, 3>(0, 6) = psi_b;
      L.block<3, 3>(3, 6) = v_b;
      L.block<3, 3>(3, 9) = psi_b;
      L.block<6, 6>(6, 6) *= step.rho;
    }
    if (!step.observed && !in_piece && !step.begins_chain) {
      turn = (turn * L).eval();
      turning = true;
      continue;
    }
    end_turn();
    if (step.observed) {
      MatrixXd H = MatrixXd::Zero(3, Z);
      H.block<3, 3>(0, 0) = -step.F * (0.5 * t);
      H.block<3, 3>(0, 3).setIdentity();
      const Matrix3d by_gyro = -step.F * step.C_mid * (t * t / 6.0);
      const Matrix3d by_accel = step.C_mid * (0.5 * t);
      H.block<3, 3>(0, NS) = by_gyro;
      H.block<3, 3>(0, NS + 3) = by_accel;
      if (NS == 12) {
        H.block<3, 3>(0, 6) = by_gyro;
        H.block<3, 3>(0, 9) = by_accel;
      }
      L.topRows(NS) -= step.K.topRows(NS) * H;
      const MatrixXd HS = H.transpose() * step.S_inverse;
      r = (L.transpose() * r + HS * step.nu).eval();
      I = (L.transpose() * I * L + HS * H).eval();
      for (int c = 0; c < p; ++c) weighted.col(c) = step.N.row(columns[static_cast<std::size_t>(c)]).transpose();
      next.noalias() = L.transpose() * R;
      next.noalias() += HS * weighted;
    } else {
      r = (L.transpose() * r).eval();
      I = (L.transpose() * I * L).eval();
      next.noalias() = L.transpose() * R;
    }
    R.swap(next);
    T = (T * L).eval();
    if (!in_piece || k != pieces_[piece].first_step) {
      if (step.begins_chain) forget();
      continue;
    }
    // The piece begins here: its biases, and a jump of psi and v.
    std::vector<int> mine;
    for (int d = 0; d < 6; ++d) mine.push_back(NS + d);
    for (int d = 0; d < 6; ++d) mine.push_back(d);
    const auto state = Eigen::seqN(0, NS);
    const Eigen::Index row = piece_dims * static_cast<Eigen::Index>(piece);
    s_.segment<piece_dims>(row) = -r(mine);
    R_.middleRows<piece_dims>(row) = R(mine, Eigen::all);
    Link& link = links_[piece];
    link.I = I(mine, mine);
    link.E = T(state, mine);
    if (step.begins_chain) forget();
    link.G = I(state, mine);
    link.M = T(state, state);
    T.setIdentity();
    R.bottomRows(6).setZero();
    r.tail<6>().setZero();
    I.bottomRows<6>().setZero();
    I.rightCols<6>().setZero();
  }
}

SegmentScores::Test SegmentScores::test(const MatrixXd& weights) const {
  Test result;
  result.s = weights.transpose() * s_;
  MatrixXd with_later = MatrixXd::Zero(weights.cols(), weights.cols()), with_itself = with_later;
  MatrixXd later;  // information of the state where the next piece begins with the weighted pieces from there on
  for (std::size_t a = pieces_.size(); a-- > 0;) {
    const Link& link = links_[a];
    const MatrixXd w = weights.middleRows<piece_dims>(piece_dims * static_cast<Eigen::Index>(a));
    with_itself.noalias() += w.transpose() * (link.I * w);
    if (later.size() == 0) {
      later = link.G * w;
      continue;
    }
    with_later.noalias() += w.transpose() * (link.E.transpose() * later);
    later = (link.G * w + link.M.transpose() * later).eval();
  }
  result.Q = with_itself + with_later + with_later.transpose();
  result.before = result.Q.diagonal();
  const MatrixXd cross = R_.transpose() * weights;
  result.shift = -A_inverse_ * cross;
  result.Q += cross.transpose() * result.shift;
  result.Q = (0.5 * (result.Q + result.Q.transpose())).eval();
  return result;
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
