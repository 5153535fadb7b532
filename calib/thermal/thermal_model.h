// The 24 parameters as functions of temperature, from calibrations of one unit at several temperatures (docs/thermal.md).
//
// A leg is one calibration: values y_i with their full covariance C_i at temperature T_i, its mean rate of change r_i and the direction d_i from
// which the temperature was approached. Of parameter p
//   y_i,p = c_0 + sum_k c_k P_k(T_i) + a r_i + (h + l (1 - u_i^2)) d_i + s(T_i) + b_i + e_i,   e_i ~ N(0, C_i) over all parameters of the leg
//   u     T over the range, -1 to 1: h goes with the direction alone, l is a loop that closes at the ends
//   P_k   Legendre polynomials of the range, k up to 3
//   s     what a Gaussian process, exp(-x^2 / 2 l^2), l = 0.35 of the range, has beside its nearest cubic: the P_k keep their meaning beside it
//   b_i   of biases, one for each switch-on: N(0, t^2); scale factors and misalignments have none
// A model says which orders, rate, hysteresis and s a parameter has, how large each is (a grid of prior sigmas) and t. Its evidence is that of
// a linear Gaussian system (Harville 1977; Kass and Raftery 1995), c_0 flat, taken in term by term as in calib/evidence/posterior.h; what is
// handed out is the average over all models (Hoeting et al., Stat. Sci. 14 (1999) 382), whose sigma holds what is not certain.
//
// Models are weighed parameter by parameter: what all legs say of the coefficients g_p, given the prior of the other parameters' coefficients in
// their average over models (N(0, sum w v)), is one precision and vector, the cavity of expectation propagation (Minka, UAI 2001, 362). The
// joint covariance of all coefficients is that of the averaged priors, its block of each parameter replaced by that of its own average.
//
// Units: those of the parameter file; coefficients per C^k, per C/h, and half the difference of approach from below and above. Not modelled: changes of a
// parameter with age; a temperature that differs between the sensors; what the square of a leg's own excursions about its mean does.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "calib/types/status.h"

namespace turncal {

struct ThermalLeg {
  std::string name;
  double temperature_c = 0.0, rate_c_per_h = 0.0;  // means over the leg
  int direction = 0;                               // 1: approached from below, -1: from above, 0: not known
  int switch_on = 0;                               // legs of one switch-on have the same number
  ParameterVector value = ParameterVector::Zero();
  Eigen::MatrixXd covariance;  // free x free
  std::vector<int> free;       // parameters that the leg determines
};

// All constants; docs/thermal.md gives the reason of each.
struct ThermalPriors {
  // Of no dependence, orders 1 to 3 and a smooth function beside them: even odds that there is one, each further one half as likely.
  std::array<double, 5> shape = {7.5 / 15, 4.0 / 15, 2.0 / 15, 1.0 / 15, 0.5 / 15};
  double per_effect =
      1.0 / 3.0;  // rate, hysteresis, loop: expected number over all parameters (evidence: one in three recordings)
  double smallest = 2.0;  // prior sigma of a coefficient, in its own sigma; and so on by `factor`
  double factor = 4.0;
  int sizes = 6;
  double most_of_spread = 10.0;   // no coefficient is larger, in the spread of the legs' values; s: half of the spread
  double length_of_range = 0.35;  // of s
  double switch_on_smallest =
      0.4;  // of a leg's sigma; and so on by `switch_on_factor` up to twice the spread; or none at all
  double switch_on_factor = 1.6;
  double same_temperature_c = 0.5;  // legs that differ by less are at one temperature
  double same_rate_c_per_h = 1.0;   // the same of a rate
  double disagrees_z = 6.0;         // a leg, with the others
};
inline constexpr ThermalPriors thermal_priors;

struct ThermalOptions {
  std::optional<double> reference_c = {};  // default: the middle of the range
  bool hold_out = true;                    // leave each temperature out in turn
};

// Columns of a parameter: powers 0 to 3 of T - T_ref, rate, hysteresis, loop, and functions that span s.
inline constexpr int thermal_rate = 4, thermal_hysteresis = 5, thermal_loop = 6, thermal_smooth = 7,
                     thermal_columns = 11;

struct ThermalParameter {
  int key = 0;                    // of parameter_keys
  std::array<double, 4> order{};  // probability of each
  double smooth = 0.0;            // that no polynomial carries it
  double rate = 0.0, hysteresis = 0.0;
  double switch_on = 0.0;                        // sigma, of biases
  double error_before = 0.0, error_after = 0.0;  // rms over temperatures left out: mean of the others, and this model
  double error_expected = 0.0,
         error_noise = 0.0;      // the second by the model's sigmas; of the leg and its switch-on alone
  double at_least(int k) const;  // probability that the order is k or more, smooth functions among them
  int said_order() const;        // the largest order that is at least said_from probable
};

// Of the temperatures left out, a row a leg: what was off, and what a leg is off by itself.
struct ThermalHoldout {
  std::vector<std::string> leg;
  std::vector<ParameterVector> before, after;
  Eigen::Matrix<double, parameter_count, parameter_count> noise =
      Eigen::Matrix<double, parameter_count, parameter_count>::Zero();  // mean covariance of legs and switch-ons
  // The largest error in its own sigma: of which leg and parameter.
  double worst_z = 0.0;
  std::string worst_leg;
  int worst_key = 0;
};

struct ThermalModel {
  double reference_c = 0.0, low_c = 0.0, high_c = 0.0;
  int temperatures = 0, most_order = 0;  // that the legs allow
  std::vector<ThermalParameter> parameters;
  // thermal_columns for each of `parameters`, one behind the other.
  Eigen::VectorXd coefficients;
  Eigen::MatrixXd covariance;
  ThermalHoldout holdout;
  std::vector<std::string> notes;  // what the legs do not allow

  const ThermalParameter* find(int key) const;
  double coefficient(std::size_t parameter, int column) const {
    return coefficients[parameter * thermal_columns + column];
  }
  double sigma(std::size_t parameter, int column) const;
};

// Errors: fewer than two temperatures, numbers that are not finite, a covariance that is not positive definite.
Result<ThermalModel> fit_thermal_model(const std::vector<ThermalLeg>& legs, const ThermalOptions& options = {});

struct ThermalPoint {
  ParameterVector value = ParameterVector::Zero();  // without hysteresis: the mean of both directions
  Eigen::Matrix<double, parameter_count, parameter_count> covariance =
      Eigen::Matrix<double, parameter_count, parameter_count>::Zero();  // without the switch-on
  bool clamped = false;                                                 // to the range
};
ThermalPoint evaluate(const ThermalModel& model, double temperature_c, double rate_c_per_h = 0.0, int direction = 0);

// How far the curve of a parameter is from its coefficients 0 to 3, at most in the range. They are the nearest cubic (least squares).
double off_its_cubic(const ThermalModel& model, std::size_t parameter);

// What legs of these temperatures and covariances, whatever their values, would determine: least squares of one polynomial a parameter, of the
// largest order that the temperatures allow (3 at most), all parameters jointly. Parameters that a leg does not determine are not there: sigma 0.
struct ThermalExpectation {
  double reference_c = 0.0;            // the middle of the range
  std::vector<ParameterVector> sigma;  // by power of T - reference
};
ThermalExpectation expected_thermal_sigmas(const std::vector<ThermalLeg>& legs);

}  // namespace turncal
