// Every threshold of the estimates and of the diagnosis, with its derivation or its calibration (docs/diagnosis.md, "Limits").
#pragma once

#include <cstddef>
#include <cstdint>

namespace turncal {

struct LackOfFitLimits {
  // False-alarm probability of all tests together; each gets an equal share (Bonferroni).
  double family_wise = 0.005;
  // A direction that the model imitates but for this part is not tested: rounding and linearisation exceed what is left.
  double rank_floor = 1e-3;
  // Divisor of the chi2 of the innovations' correlation: the pulses of an accelerometer that counts close to a whole number per
  // sample beat. Not calibrated by itself: the 0.7 % false alarms of all tests in 300 clean runs (docs/diagnosis.md) include it.
  double innovations_inflation = 2.0;
  // Lags up to this (s) are judged by the size of their correlation (NoiseLimits): in a quiet unit pulses make
  // correlations of 0.1. With fewer pairs than `fewest_pairs` a correlation scatters by a tenth or more.
  int near_lags_s = 5;
  double fewest_pairs = 100.0;
  // Share of the pulses in the variance of a second's mean velocity above which that axis and second are left out of the innovations'
  // correlation. Calibrated: with these seconds chi2 a degree of clean runs came to 37, without them to 2.5 at most (96 runs).
  double pulse_share = 0.02;
  int lags_s = 30;
};

struct SelectionLimits {
  // Lead in 2 ln L of one effect over another: "very strong" of Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773.
  double bic_margin = 10.0;
  // A component with a larger multiple correlation with another effect is its alias: 4 sigma of one are then 1 sigma of
  // the difference (1 / sqrt(1 - 0.97^2) = 4.1).
  double alias_correlation = 0.97;
  // The part of a column that the model does not imitate must be above rounding.
  double visible_part = 1e-9;
  // Size that a recording would have caught, in sigma: the family-wise 0.5 % (4.3 sigma) finds it three times in four.
  double caught_at = 5.0;
};

struct GateLimits {
  // A second recording contradicts an effect whose gain there is this many standard errors below its promise: one real effect in 160.
  double contradiction = 2.5;
  // Normalised error of held-out data above which no model is trusted: clean recordings come to 0.95 +- 0.02 (docs/diagnosis.md).
  double highest_error = 1.2;
};

// Hand-turned data (rests, rest_diagnosis.h).
inline constexpr struct RestLimits {
  // Observations beyond the 21 parameters below which any name fits; and the left-out error over the fitted one above
  // which the fit depends on single rests: the ratio is 2 if half of them are redundant.
  double least_redundancy = 20.0, most_leverage = 5.0;
  // Residual over white noise above which a kind of observation is not explained.
  double most_over_white = 3.0;
  // Gravity after a turn, rms over the legs: below the first no wrong unit of the rates (unit_slip.h) is sought; the
  // right one must leave less than this part. Of the wrong factors 2 is the nearest: 90 deg turned as 180.
  double least_misfit_rad = 0.15, of_misfit = 0.3;
  // Quarter seconds that a rest must stand still: fewer show no scatter.
  std::size_t fewest_still = 4;
  // Singular value over the largest, columns of unit length: below it is rounding of doubles, squared in the normal equations.
  double unseen_ratio = 1e-7;
  // One pose: minimum time (s) for noise and coefficients, and minimum range of temperature (C), of which a thermometer's 0.1 C is a fifth.
  double least_pose_s = 100.0, least_temperature_span_c = 0.5;
} rest_limits;

// Rests found in a stream (segmentation.h).
inline constexpr struct SegmentationLimits {
  // Fewer rests calibrate nothing: the accelerometers have nine parameters, and a rest gives one equation, with noise of its own.
  int fewest_rests = 4;
  // Stretch of log10 threshold over which the number of rests must stay the same: two and a half steps of the search.
  double shortest_plateau = 0.25;
  // A rest ends where the ratio exceeds its threshold by this factor: above the scatter of one window (chi2 of some hundred samples).
  double hysteresis = 3.0;
  // Robust deviations by which a slow even turn stands out from the rests: 1e-15 by chance, so drift and a few unlike rests stay.
  double slow_turn_sigmas = 8.0;
  // Variance over half the mean square of differences, in quiet windows: 1 for white noise, 10 behind a filter at a tenth of the bandwidth.
  double smooth_motion = 30.0;
  // Variance over that of a quiet rest up to which a rest may tremble: held by hand 500 (docs/accuracy.md), a turn of 1 deg/s 10^4 and more.
  double most_tremor = 1000.0;
} segmentation_limits;

// Gyros at the end of their range (clipping.h).
inline constexpr struct ClippingLimits {
  // Repeats of one and the same extreme value: in a row, and in all. Three in a row within a band of many equally
  // likely values have a probability of one in the band's width squared.
  std::int64_t shortest_run = 3, fewest = 6;
  // Part of the samples within about 1 % of it, since a turn passes through many values: of all samples; of a table's turn, of that turn's.
  double of_band = 0.5;
  // Smallest steps of the channel that the extreme value must exceed: a coarse channel repeats itself anyway.
  double least_steps = 50.0;
  // In a table's turn, where a gyro repeats itself anyway, the turn must also fall short of the commanded one by this part: 12 arcmin of 20 deg.
  double short_by = 0.01;
} clipping_limits;

// The start of the joint estimate, and its restarts (joint_start.cpp, joint_estimate.cpp).
inline constexpr struct StartLimits {
  // Mean square of the sine between gravity at rest and its direction by the table's angles, up to which a mounting fits: 0.2 rad. The next
  // of the 24 is off by 1 in half the rests or more. And the part of the misfit that another mounting must leave to be preferred: rounding.
  double mounting_misfit = 0.04, better_mounting = 0.98;
  // The Earth's rate at the rests tells the heading if its sigma is below this part of it, and its size right within
  // this part and this many sigma: the passes converge from a quarter of a radian.
  double of_earth_rate = 0.25, earth_rate_sigmas = 4.0;
  // Directions of the rests' rates flatter than this are open: heading and biases are confounded in them.
  double open_direction = 0.02;
  // Gyro biases above this (deg/h) are taken from the rests: they turn a unit by a radian in three hours, beyond the first pass's linear range.
  double large_bias_degph = 20.0;
  // chi2 per observation above which another start is tried: ten times the noise.
  double misfit = 100.0;
} start_limits;

// Many units (fleet).
inline constexpr struct FleetLimits {
  // False-alarm probability in a fleet without any effect: of all tests of levels together, and of units that stand out.
  double false_alarm = 0.01, unit_false_alarm = 0.01;
  // Lead in z^2 of a change in time over a constant: "very strong" in the scale of Kass and Raftery, as bic_margin.
  double shape_margin = 10.0;
  int most_effects = 20, most_of_unit = 4;
  // Recordings that a level needs before and after its change, so that none makes a change alone.
  std::size_t least_of_shape = 8;
  // Fall of z^2 within the interval of the day of a change: chi2 of one degree, 95 %.
  double interval = 3.84;
  // Directions of the effects' common information flatter than this are left out of the lack of fit.
  double open_direction = 0.01;
  // Minimum number of other units for a prior on the 21 parameters, and of pairs of calibrations for the unit's own history.
  std::size_t least_prior_units = 10, least_prior_pairs = 10;
} fleet_limits;

// Where a recording contradicts itself (joint_faults.cpp).
inline constexpr struct FaultLimits {
  // chi2 of the three velocities of a second above which it is no noise: one second in 10^9, one recording of two hours in 2e5.
  double chi_square = 44.8;
  // And above this many times the given quantile of the seconds after a rotation: an effect that the model lacks acts after each.
  double of_usual = 10.0, usual_share = 0.9;
  // A rotation interpolated over a gap is not used if it may be wrong by more: gravity then leaks 30 mm/s into every second.
  double worst_fill_rad = 0.003;
  // Minimum number of trials of the interpolation on nearby stretches.
  int fewest_trials = 4;
  // Longest gap, in samples, that is filled in. With one sample in ten lost, twice as many in a row have a probability of 10^-10.
  int most_filled = 5;
  // Filled gaps that are listed one by one; more of them are one line.
  int most_listed = 20;
} fault_limits;

// What a recording determines (score_algebra.h).
inline constexpr struct DeterminedLimits {
  // A direction is determined if the data shrink its plausible range to this part; a parameter with this part in an open one takes part in it.
  double of_range = 0.1, smallest_part = 0.1;
  // A parameter is lost if the open directions may move it by more than this part of its sigma from the determined ones.
  double of_sigma = 0.5;
} determined_limits;

// Several recordings of one unit (several_recordings.h): they disagree if chance makes such a difference once in a
// thousand. A line that calibrates a unit a day has one false alarm in three years.
inline constexpr struct AgreementLimits { double chance = 1e-3; } agreement_limits;

// Does the Earth's rate match the stated latitude? (felt_latitude.h, alignment.h)
inline constexpr struct LatitudeLimits {
  // The limit of one of 150 lack-of-fit tests that share a family-wise 0.5 %. Of 219 clean fits from -65 to 65 deg the
  // largest deviation was 2.7 sigma, the rms 1.04.
  double sigmas = 4.15;
  // Accuracy to which a site is known without a map: 3 km.
  double least_deg = 0.03;
  // For a calibration of another day, with biases of another switch-on: a degree is 0.2 deg/h about the vertical.
  double least_of_another_day_deg = 1.0;
} latitude_limits;

inline constexpr struct NoiseLimits {
  // Innovations are white if no correlation at 1 to 5 s is larger, and their mean square is between these (a sixth and a tenth of
  // sigma); of few seconds, within this many sigma of chance (one in 10^5). Fewer than `fewest_seconds` are not judged.
  double white_correlation = 0.1, white_lowest = 0.8, white_highest = 1.25, of_chance = 4.5;
  int fewest_seconds = 100;
  // Limit (sigma) on a second that stands out (a fault not worth cutting), so that it does not decide a correlation alone.
  double outlier = 4.0;
  // Gain in 2 ln L_R above which a bias instability is kept (one clean triad in twenty gets one: noise_fit.h), and
  // above which the axes of the triads get a value each: chi2 of 4 degrees, one in 10^4.
  double instability_gain = 2.71, axes_differ = 23.5;
  // Neither is sought if the score at the optimum of the walks promises less than this part: in 72 fits that changed no decision.
  double worth_a_look = 0.5;
  // Usual bias instability of ring lasers and quartz by their data sheets, in units of the walk's own (prior of noise_fit.h).
  double usual_gyro = 0.2, usual_accel = 0.5;
  // Beyond these the noise model is wrong as a whole. A correlation of r makes means (1 + r) / (1 - r) as uncertain: 0.15 is a sixth of
  // sigma. A level of 1.25 is an eighth of sigma; a low one only makes sigmas too large: 3 of 120 clean runs came to 0.76 to 0.78.
  double correlation = 0.15;
  double lowest_level = 0.64, highest_level = 1.25;
  // Where innovations are those of pulses: a sawtooth stays within a quarter of its height squared, three times its mean square.
  double highest_of_pulses = 3.0;
} noise_limits;

}  // namespace turncal
