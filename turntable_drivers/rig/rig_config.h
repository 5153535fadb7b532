// Everything that can be set on the rig. docs/rig.md lists the keys of the text form with their defaults.
//
// Values that are not set are drawn from the seed (truth and table errors), as large as in Wang (2020): every seed is another
// unit on another table. `random_truth = false` and `table_error.random_arcmin = 0` turn that off.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/base/text.h"
#include "turntable_drivers/rig/rig_effects.h"

namespace turncal {

// How the mock table's in_position flag behaves. All but honest are lies seen on real tables (docs/rig.md).
enum class InPositionFlag {
  honest,      // true when the axis stands at the target it was last sent to
  servo_on,    // true whenever the axis is enabled, also while it moves
  after_stop,  // also true after a stop short of the target
  stale,       // for in_position_time_s after a move was started the answer is still the old one: arrived
  late,        // true only in_position_time_s after the arrival
  flicker      // from in_position_time_s before the arrival to as long after it, alternates every 50 ms
};

struct RigSite {
  double latitude_deg = 29.53;
  double gravity_mps2 = 9.7914;
  double earth_rate_radps = 7.292115e-5;
  Triple magnetic_field_gauss = {0.34, -0.36, -0.015};  // north, up, east
};

struct RigNoise {
  double gyro_random_walk_deg_per_rt_h = 0.002;  // angle random walk: sigma of the angle after t is N sqrt(t)
  double accel_random_walk_ug_per_rt_hz = 8.0;   // velocity random walk: sigma of the velocity after t is N sqrt(t)
  double gyro_bias_instability_degph = 0.0005;   // B of IEEE 952: Allan deviation floor 0.664 B
  double accel_bias_instability_ug = 0.3;
  double gyro_rate_random_walk_degph_per_rt_h = 0.0;  // K: sigma of the bias change after t is K sqrt(t)
  double accel_acceleration_random_walk_ug_per_rt_h = 0.0;
  // Flicker noise is a sum of stationary first-order Markov processes; this is the longest time constant. Beyond about
  // half of it the Allan deviation falls below 0.664 B, and the mean over a long run is that of N0 and A0.
  double flicker_longest_s = 1000.0;
};

struct RigTemperature {  // T = start + rise (1 - exp(-t/tau)), recorded to 0.001 C
  double start_c = 24.0;
  double rise_c = 6.0;
  double tau_s = 2400.0;
  std::optional<double> reference_c;  // T_ref of the temperature effects; not set: start_c
};

// Angles of the table that are not as they should be (C_nb: rig_geometry.h); a value not set is drawn.
struct RigTableErrors {
  double random_arcmin = 3.0;  // drawn angles lie between half of this and all of it, either sign; 0: none are drawn
  std::optional<double> tilt_north_arcmin;               // base turned about north (positive: up leans to east)
  std::optional<double> tilt_east_arcmin;                // base turned about east (positive: north leans to up)
  std::optional<double> north_arcmin;                    // base turned about up: true heading = H - north
  std::optional<double> heading_pitch_arcmin;            // pitch axis not square to the heading axis
  std::optional<double> pitch_roll_arcmin;               // roll axis not square to the pitch axis
  std::array<std::optional<double>, 3> mounting_arcmin;  // unit in the fixture, about x y z
  // True angle: rig_axes.h. Drawn if not set: offset up to 5 arcsec, scale up to 1 ppm, harmonic up to 2 arcsec.
  struct Encoder {
    std::optional<double> offset_arcsec;
    std::optional<double> scale_ppm;
    std::optional<double> harmonic_arcsec;
    std::optional<double> phase_deg;
    int order = 2;
  };
  std::array<Encoder, 3> encoder;  // by Axis
  Triple creep_arcsec{};           // by Axis: after a motion the axis goes on in its direction by c (1 - exp(-t/tau))
  double creep_tau_s = 20.0;
};

struct RigTableBehaviour {
  Triple power_on_deg{};          // encoder reading at start, by Axis
  bool absolute_encoder = false;  // it knows its zero from the start: homing moves nothing
  Triple limit_min_deg = {-3600.0, -3600.0, -3600.0};
  Triple limit_max_deg = {3600.0, 3600.0, 3600.0};
  Triple max_rate_degps = {100.0, 100.0, 100.0};
  Triple max_acceleration_degps2 = {200.0, 200.0, 200.0};
  double home_rate_degps = 10.0;
  double home_acceleration_degps2 = 10.0;
  double home_time_s = 2.0;  // homing takes at least this long
  double encoder_resolution_deg = 1e-4;
  double in_position_tolerance_deg = 0.002;
  InPositionFlag in_position = InPositionFlag::honest;
  double in_position_time_s = 1.0;  // of stale, late, flicker
};

enum class RigQuantisation { floor, round, off };  // off: real-valued pulses

// What can go wrong on the rig, on demand: faults of the unit (by sample) and of the table (by time).
//
// Samples are numbered from the rig's first one (0), whatever the unit's counter shows. Times are rig time in seconds;
// a fault takes effect at the first sample boundary at or after its time.
enum class RigFaultKind {
  // The unit. `sample` says when, `axis` 0..2 is the sensor axis.
  lost_sample,        // `count` samples are not delivered and their increments are gone; the unit's counter shows the
                      // gap, unless `hidden`: then the counter runs on as if nothing were missing
  duplicated_sample,  // delivered a second time with the same counter; `hidden`: with the next counter value
  gyro_glitch,        // + size [mrad] in the gyro increment of that sample
  velocity_knock,     // + size [m/s] in the accelerometer increment of that sample
  invalid_sample,     // `count` samples from there carry sample_flag_invalid, data as always
  imu_silent,         // from time_s for duration_s nothing is delivered (samples are lost, counter shows the gap)
  imu_unplugged,      // from time_s read() is a device error until the unit is opened again, which succeeds
  // The table. `axis` is the table axis as Axis.
  table_moved,  // at time_s the axis turns by size [deg] at rate_degps by itself and stays there; the encoder
                // shows it, unless `hidden` (the platform moved, the encoder did not)
  too_fast,  // from time_s for duration_s (0: for good) moves of the axis are made at rate_factor and acceleration_factor times
             // what was sent
  never_in_position,  // from time_s for duration_s (0: for good) in_position stays false
  stuck_axis,         // from time_s the axis stops dead and takes commands without moving, until clear_fault()
  axis_fault,         // at time_s the drive trips: the axis brakes at its last acceleration; latched until
                      // clear_fault()
  emergency_stop,     // at time_s all axes stop within one sample; latched until an operator releases the button
                      // (Rig::release_emergency_stop, or by itself after duration_s if that is not 0) and clear_fault()
  link_lost,          // from time_s for duration_s (0: for good) every call to the table is a device error
  // The chamber, from time_s for duration_s (0: for good).
  chamber_never_settles,  // its air swings by size [C] about the set point
  chamber_sensor_dead,    // it reads what it read last
  chamber_door_open,
  chamber_alarm,
  chamber_overheats,  // its air is size [C] hotter than its sensor says
  chamber_link_lost,  // every call to it is a device error
  chamber_stays_on    // it takes the command to go off, and stays on
};

template <>
inline constexpr auto enum_words<RigFaultKind> = std::to_array(
    {"lost_sample",         "duplicated_sample", "gyro_glitch",    "velocity_knock",    "invalid_sample",
     "imu_silent",          "imu_unplugged",     "table_moved",    "too_fast",          "never_in_position",
     "stuck_axis",          "axis_fault",        "emergency_stop", "link_lost",         "chamber_never_settles",
     "chamber_sensor_dead", "chamber_door_open", "chamber_alarm",  "chamber_overheats", "chamber_link_lost",
     "chamber_stays_on"});
bool concerns_unit(RigFaultKind kind);  // else the table

struct RigFault {
  RigFaultKind kind = RigFaultKind::lost_sample;
  std::int64_t sample = 0;
  std::int64_t count = 1;
  double time_s = 0.0;
  double duration_s = 0.0;
  int axis = 0;
  double size = 0.0;
  double rate_degps = 1.0;
  double rate_factor = 1.0, acceleration_factor = 1.0;
  bool hidden = false;
  int unit = 1;  // of the unit's kinds: which of several on the table, from 1
  // Of those that last.
  bool in_force(double now_s) const { return now_s >= time_s && (duration_s == 0.0 || now_s < time_s + duration_s); }
};

// A lot of units: the unit on the rig follows from its serial number, and some are faulty. For rehearsing a line (docs/fleet.md).
//
// The same serial number is the same unit: its truth is drawn from the lot's seed and the serial. Another beginning is another turn-on:
// noise, and a step of the biases from there. Between turn-ons the biases walk: a step a day.
// What a faulty unit has. All but unsettled have it at every turn-on.
enum class LotFault {
  none,
  gyro_bias,        // one N0 is off by 0.6 deg/h
  accel_nonlinear,  // accel_second_order of one axis, 80 ug/g^2
  g_sensitive,      // gyro_g_sensitivity of one gyro to a force across it, 0.08 deg/h/g
  noisy,            // six times the random walk of the gyros
  unsettled         // at about every second turn-on an accelerometer jumps by 500 ug in mid-run
};
template <>
inline constexpr auto enum_words<LotFault> = std::to_array({"none", "gyro_bias", "accel_nonlinear", "g_sensitive",
                                                            "noisy", "unsettled"});

struct RigLot {
  std::optional<std::uint64_t> seed;  // not set: the unit has nothing to do with its serial number
  double faulty = 0.0;                // so many of the units, 0 to 1
  double between_h = 0.25;            // from the end of a run to the beginning of the next
  double turn_on_gyro_degph = 0.0;    // sigma of a bias from turn-on to turn-on
  double turn_on_accel_ug = 0.0;
  double month_gyro_degph = 0.0;  // sigma of the change of a bias in 30 days
  double month_accel_ug = 0.0;
  // Of the unit that rig_of_lot() made, at this turn-on.
  LotFault fault = LotFault::none;
  bool fault_shows = false;
};

struct RigConfig {
  std::uint64_t seed = 1;                   // of truth and table errors
  std::optional<std::uint64_t> noise_seed;  // not set: seed
  std::optional<std::uint64_t> unit_seed;   // of the truth; not set: seed
  std::string unit_serial;                  // what identify() says; empty: the unit does not tell
  double start_utc_s = 1767225600.0;        // 2026-01-01T00:00:00Z
  double sample_period_s = 0.005;
  std::int64_t first_counter = 0;  // the unit's counter at the rig's first sample
  int quadrature_substeps = 1;     // motion: each piece of a sample is cut into so many, for checks of the quadrature
  double gyro_pulse_arcsec = 0.932920;  // start value of the diagonal of n
  double accel_pulse_mps = 0.0005;
  RigQuantisation quantisation = RigQuantisation::floor;
  bool random_truth = true;                     // false: parameters not set are start values of Wang (2020)
  std::array<std::optional<double>, 24> truth;  // Table 1 order; units of the parameter file
  RigSite site;
  RigNoise noise;
  RigTemperature temperature;
  RigTableErrors table_errors;
  RigTableBehaviour table;
  RigEffects effects;
  RigOutsideEffects outside;
  std::vector<RigFault> faults;
  RigLot lot;
};

// Names of Table 1 in its order, for truth[].
extern const std::array<const char*, 24> rig_truth_keys;

RigConfig default_rig_config();
// Errors (kind input) name file, line, key, value and what was expected; an unknown key is an error.
// A key that is not in the file keeps the value of `base`.
Result<RigConfig> read_rig_config(const std::string& path, const RigConfig& base = {});
Result<RigConfig> parse_rig_config(const std::string& text, const std::string& file_name);
// The rig of one of several units on the table, from 0. The first is the rig as configured. The others have a truth and noise of
// their own, do not tell a serial number, and have their own faults; site, table, effects and temperature are the same for all.
RigConfig rig_of_unit(const RigConfig& config, std::size_t unit);
// What is true of the unit `serial` when it is turned on at config.start_utc_s; config itself without lot.seed.
RigConfig rig_of_lot(RigConfig config, const std::string& serial);
// What read_rig_config checks beyond each key's range: that a value makes sense with the others.
Status check(const RigConfig& config);

}  // namespace turncal
