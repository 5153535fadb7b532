// Is anything left that no term explains? Tests that name nothing: each piece of rest and each turn against the most probable model, and
// the innovations of every second.
//   turn         a jump of attitude and velocity at a turn (chi2, 6), the worst
//   rest         a bias within a piece of rest (chi2, 6), the worst
//   innovations  their correlation over 6 to 30 s, seconds in which pulses beat set aside
// Each gets an equal share of a family-wise probability (Bonferroni).
#pragma once

#include <string>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/model/limits.h"

namespace turncal {

struct Pieces;
struct UnderNoise;
struct WeighedModel;

struct OmnibusTest {
  std::string family;  // "turn"
  std::string what;    // "jump at the turn that ends at 1234 s (step 4)"
  double chi_square = 0.0;
  double degrees = 0.0;
  double tries = 1.0;    // of which this is the worst
  double log10_p = 0.0;  // of chi_square, times tries
};
struct Omnibus {
  std::vector<OmnibusTest> tests;
  // Of the innovations on body axes, seconds in which pulses beat set aside: the largest correlation over 1 to 5 s, and the mean square;
  // negative: too few to say. And the part that was set aside.
  double innovation_correlation = -1.0, innovation_level = -1.0, beating_part = 0.0;
  const OmnibusTest* worst() const;  // null: nothing could be tested
  double log10_limit() const;
  bool passed() const { return worst() == nullptr || worst()->log10_p > log10_limit(); }
};

// Of one that has not passed: its worst test.
std::string reason_of(const Omnibus& omnibus);
void add_test(OmnibusTest test, Omnibus& result);
void test_pieces(const CompressedRecording& recording, const Pieces& pieces, const UnderNoise& system,
                 const WeighedModel& model, Omnibus& result);
void test_innovations(const CompressedRecording& recording, const JointResult& fit, Omnibus& result);

// chi2 and rank of s' Q^-1 s on the directions that hold more than `floor` of what they had before the parameters were eliminated.
struct RankedChiSquare {
  double chi_square = 0.0;
  int rank = 0;
};
RankedChiSquare ranked_chi_square(const Eigen::MatrixXd& Q, const Eigen::VectorXd& s, const Eigen::VectorXd& before,
                                  double floor);

}  // namespace turncal
