#include "calib/evidence/segment_scores.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "calib/evidence/lack_of_fit.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

SegmentScores scores_of_a_run() {
  RigConfig config = default_rig_config();
  config.noise.gyro_bias_instability_degph = 0.01;  // states of their own
  const RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  const JointResult fit = joint_estimate(made.recording);
  const FitPass pass = run_fit_pass(made.recording, fit, fit.setup);
  return {pass.recording, pass.filter, pass.columns, fit.reference_temperature_c, LackOfFitLimits{}};
}

// A column for one dimension of each piece: the information of those together is the covariance of the scores, whole. What comes a few columns
// at a time along the pieces has the same traces. And a step after a piece is the sum of the values of all later ones.
TEST(SegmentScores, TracesAndSumsAreThoseOfTheWholeCovariance) {
  const SegmentScores scores = scores_of_a_run();
  const std::vector<Piece>& pieces = scores.pieces();
  const Eigen::Index n = pieces.size();
  ASSERT_GT(n, 60);
  constexpr int dim = 4;
  const auto number = [&](const Piece& piece) {
    return std::find_if(pieces.begin(), pieces.end(), [&](const Piece& p) { return p.begin_s == piece.begin_s; }) -
           pieces.begin();
  };
  Weights each{n, [&](const Piece& piece) {
                 Weights::Part part{number(piece), {}};
                 part.of.setZero(piece_dims, 1);
                 part.of(dim, 0) = 1.0;
                 return part;
               }};
  Weights summed = each;
  summed.summed = true;
  const Weights steps{n - 1, [&](const Piece& piece) {
                        Weights::Part part{0, {}};
                        part.of.setZero(piece_dims, n - 1);
                        part.of.row(dim).head(number(piece)).setOnes();
                        return part;
                      }};
  const std::vector<SegmentScores::Test> tests = scores.tests({each, summed, steps});
  const Eigen::MatrixXd& C = tests[0].Q;
  std::vector<SegmentScores::Whitened> all;
  for (std::size_t k = 0; k < pieces.size(); ++k) all.push_back({k, Eigen::MatrixXd::Identity(1, 1)});
  const auto [first, second, third] = scores.traces({dim}, all);
  EXPECT_NEAR(first / C.trace(), 1.0, 1e-9);
  EXPECT_NEAR(second / C.squaredNorm(), 1.0, 1e-9);
  EXPECT_NEAR(third / (C * C).cwiseProduct(C).sum(), 1.0, 1e-9);
  EXPECT_LT((tests[1].Q - tests[2].Q).norm(), 1e-9 * tests[2].Q.norm());
  EXPECT_LT((tests[1].s - tests[2].s).norm(), 1e-9 * tests[2].s.norm());
  EXPECT_LT((tests[1].shift - tests[2].shift).norm(), 1e-9 * tests[2].shift.norm());
}

}  // namespace
}  // namespace turncal
