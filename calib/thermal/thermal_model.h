// The 24 parameters as functions of temperature, from calibrations of one unit at several temperatures (docs/thermal.md).
//
// A leg is one calibration: values y_i with full covariance C_i at temperature T_i, its mean rate of change r_i and the direction d_i from
// which the temperature was approached. With a lag tau of the unit, the sensors are at T_i - tau r_i. For parameter p, at that temperature,
//   f_p = c_0 + sum_k c_k P_k + (h + l (1 - u^2)) d_i + s
//   y_i = f + D_i f' + a r_i + b_i + e_i,   e_i ~ N(0, C_i) over all parameters of the leg
//   D_i   the leg's response to parameters that change with the temperature during it (`within`)
//   u     temperature over the range, -1 to 1: h depends on the direction alone, l is a loop that closes at the ends
//   P_k   Legendre polynomials of the range, k up to 3
//   s     a Gaussian process, exp(-x^2 / 2 l^2), l = 0.35 of the range, less its nearest cubic, so that the P_k keep their meaning
//   b_i   of biases, one per switch-on: N(0, t^2); scale factors and misalignments have none
// A model says which orders, rate, hysteresis and s a parameter has, how large each is (a grid of prior sigmas), and t. Its evidence is that of a
// linear Gaussian system (Harville 1977; Kass and Raftery 1995), c_0 flat, terms added one by one as in calib/evidence/posterior.h. The result is the
// average over all models (Hoeting et al., Stat. Sci. 14 (1999) 382); its sigma includes their uncertainty.
//
// Models are weighed parameter by parameter. All that the legs tell of the coefficients g_p, given the model-averaged prior of the other
// parameters' coefficients (N(0, sum w v)), is one precision and vector: the cavity of expectation propagation (Minka, UAI 2001, 362). The
// joint covariance of all coefficients is that of the averaged priors, with each parameter's block replaced by that of its own average. The
// lag is weighed likewise, as one more unknown common to all parameters: -tau r f' about the average of the round before.
//
// Units: those of the parameter file; coefficients per C^k, per C/h, and half the difference of approach from below and above.
// Not modelled: change of a parameter with age; a lag that differs between sensors; second-order effects of temperature excursions within a leg.
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
  // free x free, C: the error of each parameter where another has a slope of one of its units per C (response_to_temperature). Empty: none.
  Eigen::MatrixXd within = {};
};

// All constants; docs/thermal.md gives the reason of each.
inline constexpr struct ThermalPriors {
  // No dependence, orders 1 to 3, and a smooth function beside them: even odds of a dependence, each further one half as likely.
  std::array<double, 5> shape = {7.5 / 15, 4.0 / 15, 2.0 / 15, 1.0 / 15, 0.5 / 15};
  double per_effect = 1.0 / 3.0;  // rate, hysteresis, loop: expected number over all parameters
  double smallest = 2.0;          // smallest prior sigma of a coefficient, in its own sigma; the next by `factor`
  double factor = 4.0;
  int sizes = 6;
  double most_of_spread = 10.0;     // largest coefficient, in the spread of the legs' values; s: half of the spread
  double length_of_range = 0.35;    // of s
  double switch_on_smallest = 0.4;  // in a leg's sigma; up to twice the spread; or none at all
  double switch_on_factor = 1.6;
  double same_temperature_c = 0.5;  // legs that differ by less are at one temperature
  double same_rate_c_per_h = 1.0;   // the same for a rate
  double disagrees_z = 6.0;         // of a leg, from the others
  double lag = 0.5;                 // probability of a lag; its sizes as of a coefficient
  double longest_lag_h = 0.25;      // its sigma; a unit follows its own thermometer within the hour
} thermal_priors;

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
  double smooth = 0.0;            // that it needs a function beside the polynomial
  double rate = 0.0, hysteresis = 0.0;
  double switch_on = 0.0;  // sigma, of biases
  // Rms over temperatures left out: error of the others' mean, of this model, as its sigmas expect, noise of a leg and its switch-on.
  std::array<double, 4> left_out{};
  double at_least(int k) const;  // probability of order k or more, smooth functions included
  int said_order() const;        // the largest order with a probability of at least said_from
};

// Mean squares over the legs, their temperature left out: errors of the others' mean and of the model, and variance of a leg and its switch-on.
struct ThermalHoldout {
  int legs = 0;
  ParameterCovariance before = ParameterCovariance::Zero(), after = before, noise = before;
  double worst_z = 0.0;  // the largest error in its own sigma, with its leg and parameter
  std::string worst_leg;
  int worst_key = 0;
};

struct ThermalModel {
  double reference_c = 0.0, low_c = 0.0, high_c = 0.0;
  int temperatures = 0, most_order = 0;  // that the legs allow
  std::vector<ThermalParameter> parameters;
  double lag = 0.0;  // probability that the sensors lag behind the thermometer
  // thermal_columns for each of `parameters`, one behind the other; then the lag, h.
  Eigen::VectorXd coefficients;
  Eigen::MatrixXd covariance;
  std::vector<ParameterVector> at_legs;  // its prediction for each leg
  ThermalHoldout holdout;
  std::vector<std::string> notes;  // what the legs do not allow

  const ThermalParameter* find(int key) const;
  double coefficient(std::size_t j, int column) const { return coefficients[j * thermal_columns + column]; }
  double sigma(std::size_t parameter, int column) const;
  double lag_h() const { return coefficients[coefficients.size() - 1]; }
  double lag_sigma_h() const { return sigma(parameters.size(), 0); }
};

// Returns an error for fewer than two temperatures, numbers that are not finite, a covariance that is not positive definite.
Result<ThermalModel> fit_thermal_model(const std::vector<ThermalLeg>& legs, const ThermalOptions& options = {});

struct ThermalPoint {
  ParameterVector value = ParameterVector::Zero();               // at a steady temperature, mean of both directions
  ParameterCovariance covariance = ParameterCovariance::Zero();  // without the switch-on
};
ThermalPoint evaluate(const ThermalModel& model, double temperature_c);  // outside the range as at its end

// Returns the largest distance, in the range, of a parameter's curve from its coefficients 0 to 3, the nearest cubic (least squares).
double off_its_cubic(const ThermalModel& model, std::size_t parameter);

// The sigmas that legs of these temperatures and covariances would give, whatever their values: least squares of one polynomial a parameter, of the
// largest order that the temperatures allow (3 at most), all parameters jointly. A parameter that some leg does not determine is left out: sigma 0.
struct ThermalExpectation {
  double reference_c = 0.0;            // the middle of the range
  std::vector<ParameterVector> sigma;  // by power of T - reference
};
ThermalExpectation expected_thermal_sigmas(const std::vector<ThermalLeg>& legs);

}  // namespace turncal
