// Families of disturbances without a name: what a bias or a scale factor may do when nothing in the catalogue describes it.
//
// A family is one sensor's bias or scale factor times a function that is not known but for what it goes with:
//   the heading, pitch or roll angle of the table   harmonics 1 to 4 with sizes 1/h
//   scatter                                          another value for every turn and the rest after it
//   walk                                             steps of one size at every turn
//   temperature                                      four cosines over its range
//   the rate about a body axis                       two waves, odd and even, up to the fastest turn; nothing at rest
// Its coefficients are drawn from one normal distribution of unknown variance v, so a family is one parameter richer than the model,
// as an effect is, and the two are compared by likelihood. With weights B (a column a function, segment_scores.h), s = B' score and
// Q = B' information B, the model's parameters eliminated,
//   2 ln L(v) = s' (Q + 1/v)^-1 s - ln det(1 + v Q)
// (the marginal likelihood of a variance component; Harville, J. Am. Stat. Assoc. 72 (1977) 320). The coefficients' mean is then
// (Q + 1/v)^-1 s. As a test of lack of fit v is fixed beforehand, and s' (Q + 1/v)^-1 s is a quadratic form with a known distribution.
// Nothing here is added to a model or written to a file as an effect: a family is what a name has to be better than.
#pragma once

#include <string>
#include <vector>

#include "calib/diagnosis/segment_scores.h"

namespace turncal {

inline constexpr const char* temperature_curve = "temperature curve";

enum class DisturbedSensor { gyro_bias, gyro_scale, accel_bias, accel_scale };
// "scale factor of gyro x"
std::string words_of(DisturbedSensor sensor, int axis);
// What goes with a rate or a force by a curve, x up to +-1: two waves, odd and even, with sizes 1/k.
inline constexpr int curve_waves = 2;
void write_curve(double x, double* out);

struct Family {
  std::string kind;                                     // "angle", "scatter", "walk", "temperature curve", "rate"
  std::string what;                                     // "scale factor of gyro x from turn to turn"
  Weights weights;                                      // a column a function
  DisturbedSensor sensor = DisturbedSensor::gyro_bias;  // of nameless_families()
  int axis = 0;
  bool by_a_curve() const { return kind == temperature_curve || kind == "rate"; }
};
std::vector<Family> nameless_families(const std::vector<Piece>& pieces);

struct FamilyFit {
  double gain = 0.0;      // of 2 ln L at the best variance; 0: none
  Eigen::VectorXd mean;   // of the coefficients at that variance
  Eigen::VectorXd shift;  // what explaining it away does to the model's columns
  // As a test: s' (Q + 1/v)^-1 s at v = 1 / mean eigenvalue of Q, its eigenvalues' weights.
  double statistic = 0.0;
  Eigen::VectorXd weights;
};
// `before`: the diagonal of Q before the model's parameters were eliminated. Without a shift.
FamilyFit fit_family(const Eigen::MatrixXd& Q, const Eigen::VectorXd& s, const Eigen::VectorXd& before);
std::vector<FamilyFit> fit_families(const SegmentScores& scores, const std::vector<Family>& families);

// What a gyro's scale factor may scatter from turn to turn without being seen, in the model's columns: their covariance is the sum of the
// squares of these. The mean over its size s, weighed by L(s^2) and a prior 1 / (1 + (s / usual)^2)^2; where two turns tell a scale factor, the scatter of their
// mean does not show in their difference.
std::vector<Eigen::VectorXd> unseen_scatter(const SegmentScores& scores, const std::vector<Family>& families);

}  // namespace turncal
