// Omnibus tests: is anything left that no term explains? They name nothing. Each piece of rest and each turn is tested
// against the most probable model, and so are the innovations of every second.
//   turn         a jump of attitude and velocity at a turn (chi2, 6), the worst
//   rest         a bias within a piece of rest (chi2, 6), the worst
//   innovations  their autocorrelation over 6 to 30 s, without the seconds in which pulses beat
// The tests share a family-wise probability equally (Bonferroni).
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
  double tries = 1.0;    // number of tests of which this is the worst
  double log10_p = 0.0;  // of chi_square, times tries
};
struct Omnibus {
  std::vector<OmnibusTest> tests;
  // Innovations on body axes, without the seconds in which pulses beat: their largest autocorrelation over 1 to 5 s and
  // their mean square (negative: too few to tell), and the part left out.
  double innovation_correlation = -1.0, innovation_level = -1.0, beating_part = 0.0;
  const OmnibusTest* worst() const;  // null: nothing could be tested
  double log10_limit() const;
  bool passed() const { return worst() == nullptr || worst()->log10_p > log10_limit(); }
};

// Returns the worst test in words; the omnibus must have failed.
std::string reason_of(const Omnibus& omnibus);
void add_test(OmnibusTest test, Omnibus& result);
void test_pieces(const CompressedRecording& recording, const Pieces& pieces, const UnderNoise& system,
                 const WeighedModel& model, Omnibus& result);
void test_innovations(const CompressedRecording& recording, const JointResult& fit, Omnibus& result);

// chi2 and rank of s' Q^-1 s over the directions that keep more than `floor` of their information when the parameters are eliminated.
struct RankedChiSquare {
  double chi_square = 0.0;
  int rank = 0;
};
RankedChiSquare ranked_chi_square(const Eigen::MatrixXd& Q, const Eigen::VectorXd& s, const Eigen::VectorXd& before,
                                  double floor);

}  // namespace turncal
