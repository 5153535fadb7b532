// Every threshold of the estimates and of the diagnosis, with its derivation or its calibration (docs/diagnosis.md, "Limits").
#pragma once

#include <cstddef>
#include <cstdint>

namespace turncal {

struct LackOfFitLimits {
  // All tests together; each gets an equal share (Bonferroni).
  double family_wise = 0.005;
  // A direction of which the model imitates all but this is not tested: rounding and linearisation are larger than what is left.
  double rank_floor = 1e-3;
  // chi2 of the innovations' correlation is divided by this: pulses of an accelerometer that counts close to a whole number a sample
  // beat. Not calibrated by itself: 0.7 % false alarms of all tests in 300 clean runs (docs/diagnosis.md) are with it.
  double innovations_inflation = 2.0;
  // Lags nearer than this (s) are judged by the size of their correlation (NoiseLimits): pulses make some of 0.1 in a quiet unit. A lag
  // with fewer pairs than `fewest_pairs` has a correlation that scatters by a tenth and more.
  int near_lags_s = 5;
  double fewest_pairs = 100.0;
  // Share of pulses in the variance of a second's mean velocity beyond which that axis and second are left out of the innovations'
  // correlation. Calibrated: with these seconds chi2 a degree of clean runs came to 37, without them to 2.5 at most (96 runs).
  double pulse_share = 0.02;
  int lags_s = 30;
};

struct SelectionLimits {
  // 2 ln L by which an effect is better than another: "very strong" of Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773.
  double bic_margin = 10.0;
  // A component whose columns' multiple correlation with another effect is above this is its alias: 4 sigma of one are then 1 sigma
  // of the difference (1 / sqrt(1 - 0.97^2) = 4.1).
  double alias_correlation = 0.97;
  // Of what the columns hold, the part that the model does not imitate must be above rounding.
  double visible_part = 1e-9;
  // What a recording would have caught: five sigma, which the family-wise 0.5 % (4.3 of them) then finds three times in four.
  double caught_at = 5.0;
};

struct GateLimits {
  // A second recording contradicts an effect whose gain there is this many standard errors below its promise: one real one in 160.
  double contradiction = 2.5;
  // Normalised error of held-out data beyond which no model is trusted: clean recordings come to 0.95 +- 0.02 (docs/diagnosis.md).
  double highest_error = 1.2;
};

// Of hand-turned data (rests, rest_diagnosis.h).
struct RestLimits {
  // Observations beyond the 21 parameters below which any name fits. And the left-out error over the fitted one beyond which the fit hangs on
  // single rests: it is 2 where half of them are redundant.
  double least_redundancy = 20.0, most_leverage = 5.0;
  // Residual over white noise beyond which a kind of observation is not explained.
  double most_over_white = 3.0;
  // Gravity after a turn, rms over the legs: below the first no wrong unit of the rates (unit_slip.h) is looked for; a right one leaves
  // less than this part. Of wrong factors 2 is the nearest: 90 deg turned as 180.
  double least_misfit_rad = 0.15, of_misfit = 0.3;
  // Quarters of a second that stand still in a rest: fewer have no scatter to judge by.
  std::size_t fewest_still = 4;
  // Singular value over the largest, columns of unit length: what lies below is rounding of doubles, squared in the normal equations.
  double unseen_ratio = 1e-7;
  // One pose: seconds for noise and coefficients, and the change of temperature (C) of which a thermometer's 0.1 C is a fifth.
  double least_pose_s = 100.0, least_temperature_span_c = 0.5;
};
inline constexpr RestLimits rest_limits;

// Rests found in a stream (segmentation.h, segmentation.h).
struct SegmentationLimits {
  // Fewer rests calibrate nothing: nine parameters of the accelerometers, one equation a rest, and noise of its own.
  int fewest_rests = 4;
  // log10 of threshold over which the number of rests must stay the same: two steps and a half of the search.
  double shortest_plateau = 0.25;
  // A rest ends where the ratio is so many times its threshold: above the scatter of one window (chi2 of some hundred samples).
  double hysteresis = 3.0;
  // Robust deviations by which a slow even turn stands out from the rests: by chance 1e-15, so drift and a few unlike rests stay.
  double slow_turn_sigmas = 8.0;
  // Variance over half the mean square of differences, of quiet windows: 1 for white noise, 10 behind a filter of a tenth of the bandwidth.
  double smooth_motion = 30.0;
  // Variance over that of a quiet rest to which one may tremble: held by hand 500 (docs/accuracy.md), a turn of 1 deg/s 10^4 and more.
  double most_tremor = 1000.0;
};
inline constexpr SegmentationLimits segmentation_limits;

// Gyros at the end of their range (clipping.h).
struct ClippingLimits {
  // One and the same extreme value, as often in a row and in all. Three in a row within a band of many equally likely values is a chance
  // of one in the band's width squared.
  std::int64_t shortest_run = 3, fewest = 6;
  // Part of all samples within about 1 % of it: a turn passes through many values. And of the fastest that the gyro reads in any turn.
  double of_band = 0.5;
  // And so many of the smallest steps that the channel makes: a coarse channel repeats itself anyway.
  double least_steps = 50.0;
  // In a table's turn, where a gyro repeats itself anyway, the turn is also short of the commanded one by so much: 12 arcmin of 20 deg.
  double short_by = 0.01;
};
inline constexpr ClippingLimits clipping_limits;

// Where the joint estimate begins, and when it begins again (joint_start.cpp, joint_estimate.cpp).
struct StartLimits {
  // Mean square of the sine between gravity at rest and where the table's angles have it, within which a mounting fits: 0.2 rad. The next
  // of the 24 is off by 1 in half the rests or more. And the part of the misfit another one must leave to be preferred: rounding.
  double mounting_misfit = 0.04, better_mounting = 0.98;
  // The earth's rate at the rests tells the heading when its sigma is this part of it, and its size right within that part and so many
  // sigma: from a quarter of a radian the passes converge.
  double of_earth_rate = 0.25, earth_rate_sigmas = 4.0;
  // Directions of the rests' rates flatter than this are open: heading and biases change together.
  double open_direction = 0.02;
  // Biases (deg/h) by which a unit turns through a radian in three hours are taken from the rests: the first pass is not linear in them.
  double large_bias_degph = 20.0;
  // chi2 an observation beyond which another start is tried: ten times the noise.
  double misfit = 100.0;
};
inline constexpr StartLimits start_limits;

// Of many units (fleet).
struct FleetLimits {
  // False alarms of a fleet without any effect: of all tests of levels together, and of units that stand out.
  double false_alarm = 0.01, unit_false_alarm = 0.01;
  // Of z^2, by which a change of shape is better than a constant: "very strong" in the scale of Kass and Raftery, as bic_margin.
  double shape_margin = 10.0;
  int most_effects = 20, most_of_unit = 4;
  // Recordings at a level before and after it changes, so that none makes a change alone.
  std::size_t least_of_shape = 8;
  // z^2 within which the day of a change lies: chi2 of one, 95 %.
  double interval = 3.84;
  // Directions of the effects' common information flatter than this say nothing of what is left.
  double open_direction = 0.01;
  // Units and pairs of calibrations below which a covariance of 21 parameters is not taken for a prior.
  std::size_t least_prior_units = 10, least_prior_pairs = 10;
};
inline constexpr FleetLimits fleet_limits;

// Where a recording contradicts itself (joint_faults.cpp).
struct FaultLimits {
  // chi2 of the three velocities of a second, beyond which it is no noise: one in 10^9, one recording of two hours in 2e5.
  double chi_square = 44.8;
  // And so many times what this share of the seconds after a rotation stay below: an effect that the model lacks pushes after each.
  double of_usual = 10.0, usual_share = 0.9;
  // A rotation interpolated over a gap is not used when it may be wrong by more: gravity then leaks 30 mm/s into every second.
  double worst_fill_rad = 0.003;
  // Such a trial on stretches nearby must have been made so often.
  int fewest_trials = 4;
  // Samples lost together that are filled in between those beside them. Twice as many in a row where one in ten is lost: one in 10^10.
  int most_filled = 5;
  // Gaps filled in that are listed one by one.
  int most_listed = 20;
};
inline constexpr FaultLimits fault_limits;

// What a recording determines (score_algebra.h).
struct DeterminedLimits {
  // A direction is determined when the data shrink its plausible range to this part; a parameter takes part in an open one with so much.
  double of_range = 0.1, smallest_part = 0.1;
  // A parameter is lost when what is open may move it by more than this part of the sigma it has from the rest.
  double of_sigma = 0.5;
};
inline constexpr DeterminedLimits determined_limits;

// Several recordings of one unit (several_recordings.h): they disagree when chance makes them differ as much once in a thousand. A line
// of a unit a day has one false one in three years.
struct AgreementLimits {
  double chance = 1e-3;
};
inline constexpr AgreementLimits agreement_limits;

// Does the earth turn as the record says? (felt_latitude.h, alignment.h)
struct LatitudeLimits {
  // As one of the 150 tests of the lack of fit, which share a family-wise 0.5 %. Of 219 clean fits from -65 to 65 deg the furthest was 2.7
  // sigma off, rms 1.04.
  double sigmas = 4.15;
  // What a site is known to without a map: 3 km.
  double least_deg = 0.03;
  // Where the calibration is of another day, for the biases of another switch-on: a degree is 0.2 deg/h about the vertical.
  double least_of_another_day_deg = 1.0;
};
inline constexpr LatitudeLimits latitude_limits;

struct NoiseLimits {
  // Innovations are white when no correlation at 1 to 5 s is larger, and their mean square is between these (a sixth and a tenth of
  // sigma); of few seconds within so many sigma of chance (one in 10^5). Fewer than `fewest_seconds` are not judged.
  double white_correlation = 0.1, white_lowest = 0.8, white_highest = 1.25, of_chance = 4.5;
  int fewest_seconds = 100;
  // A second that stands out (a fault not worth cutting) is limited to so many sigma in a correlation: it must not decide alone.
  double outlier = 4.0;
  // 2 ln L_R above which a bias instability is kept (of clean triads one in twenty is given one: noise_fit.h), and above which the axes of
  // the triads get a value each: chi2 of 4, one in 10^4.
  double instability_gain = 2.71, axes_differ = 23.5;
  // Neither is looked for where the score at the optimum of the walks promises less than this part: of 72 fits none was decided otherwise.
  double worth_a_look = 0.5;
  // Usual bias instability of ring lasers and quartz by their data sheets, in units of the walk's own (prior of noise_fit.h).
  double usual_gyro = 0.2, usual_accel = 0.5;
  // Beyond these the noise model is wrong as a whole. A correlation of r makes means (1 + r) / (1 - r) as uncertain: 0.15 is a sixth of
  // sigma. A level of 1.25 is an eighth of sigma; a low one only makes sigmas too large: 3 of 120 clean runs came to 0.76 to 0.78.
  double correlation = 0.15;
  double lowest_level = 0.64, highest_level = 1.25;
  // Where innovations are those of pulses: a sawtooth stays within a quarter of its height squared, three times its mean square.
  double highest_of_pulses = 3.0;
};
inline constexpr NoiseLimits noise_limits;

}  // namespace turncal
