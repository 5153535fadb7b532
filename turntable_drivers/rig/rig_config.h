// The configuration of the rig. docs/rig.md lists the keys of the text form with their defaults.
//
// Truth and table errors that are not set are drawn from the seed, with the magnitudes of Wang (2020): every seed is another
// unit on another table. `random_truth = false` and `table_error.random_arcmin = 0` switch this off.
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

// The behaviour of the mock table's in_position flag. All but honest are faulty behaviours seen on real tables (docs/rig.md).
enum class InPositionFlag {
  honest,      // true when the axis stands at its last commanded target
  servo_on,    // true whenever the axis is enabled, even while it moves
  after_stop,  // also true after a stop short of the target
  stale,       // true, as before the command, until in_position_time_s after the start of a move
  late,        // true only in_position_time_s after the arrival
  flicker      // alternates every 50 ms from in_position_time_s before to in_position_time_s after the arrival
};

struct RigSite {
  double latitude_deg = 29.53;
  double gravity_mps2 = 9.7914;
  double earth_rate_radps = 7.292115e-5;
  Triple magnetic_field_gauss = {0.34, -0.36, -0.015};  // north, up, east
};

struct RigNoise {
  double gyro_random_walk_deg_per_rt_h = 0.002;  // N, angle random walk: sigma of the angle after t is N sqrt(t)
  double accel_random_walk_ug_per_rt_hz = 8.0;   // N, velocity random walk: sigma of the velocity after t is N sqrt(t)
  double gyro_bias_instability_degph = 0.0005;   // B of IEEE 952: floor of the Allan deviation at 0.664 B
  double accel_bias_instability_ug = 0.3;
  double gyro_rate_random_walk_degph_per_rt_h = 0.0;  // K: sigma of the bias change after t is K sqrt(t)
  double accel_acceleration_random_walk_ug_per_rt_h = 0.0;
  // Flicker noise is a sum of stationary first-order Markov processes; this is the longest time constant. Beyond about
  // half of it the Allan deviation falls below 0.664 B, and the mean over a long run tends to N0 and A0.
  double flicker_longest_s = 1000.0;
};

struct RigTemperature {  // T = start + rise (1 - exp(-t/tau)), recorded to 0.001 C
  double start_c = 24.0;
  double rise_c = 6.0;
  double tau_s = 2400.0;
  std::optional<double> reference_c;  // T_ref of the temperature effects; default start_c
};

// Angular errors of the table (C_nb: rig_geometry.h). A value that is not set is drawn.
struct RigTableErrors {
  double random_arcmin = 3.0;  // drawn magnitudes are between half of this and this, of either sign; 0: none are drawn
  std::optional<double> tilt_north_arcmin;               // base rotated about north (positive: up leans to east)
  std::optional<double> tilt_east_arcmin;                // base rotated about east (positive: north leans to up)
  std::optional<double> north_arcmin;                    // base rotated about up: true heading = H - north
  std::optional<double> heading_pitch_arcmin;            // non-orthogonality of pitch and heading axis
  std::optional<double> pitch_roll_arcmin;               // non-orthogonality of roll and pitch axis
  std::array<std::optional<double>, 3> mounting_arcmin;  // unit in the fixture, about x y z
  // The true angle is in rig_axes.h. Drawn if not set: offset up to 5 arcsec, scale up to 1 ppm, harmonic up to 2 arcsec.
  struct Encoder {
    std::optional<double> offset_arcsec;
    std::optional<double> scale_ppm;
    std::optional<double> harmonic_arcsec;
    std::optional<double> phase_deg;
    int order = 2;
  };
  std::array<Encoder, 3> encoder;  // by Axis
  Triple creep_arcsec{};           // by Axis: after a motion the axis creeps on in its direction by c (1 - exp(-t/tau))
  double creep_tau_s = 20.0;
};

struct RigTableBehaviour {
  Triple power_on_deg{};          // encoder reading at start, by Axis
  bool absolute_encoder = false;  // the zero is known from the start: homing does not move
  Triple limit_min_deg = {-3600.0, -3600.0, -3600.0};
  Triple limit_max_deg = {3600.0, 3600.0, 3600.0};
  Triple max_rate_degps = {100.0, 100.0, 100.0};
  Triple max_acceleration_degps2 = {200.0, 200.0, 200.0};
  double home_rate_degps = 10.0;
  double home_acceleration_degps2 = 10.0;
  double home_time_s = 2.0;  // shortest duration of homing
  double encoder_resolution_deg = 1e-4;
  double in_position_tolerance_deg = 0.002;
  InPositionFlag in_position = InPositionFlag::honest;
  double in_position_time_s = 1.0;  // for stale, late and flicker
};

enum class RigQuantisation { floor, round, off };  // off: real-valued pulses

// The faults of the rig: of the unit (by sample) and of the table (by time).
//
// Samples are numbered from the rig's first one (0), regardless of the unit's counter. Times are rig time in seconds;
// a fault takes effect at the first sample boundary at or after its time.
enum class RigFaultKind {
  // Faults of the unit. `sample` is the first one concerned; `axis` 0..2 is the sensor axis.
  lost_sample,        // `count` samples and their increments are lost; the unit's counter shows the gap unless
                      // `hidden`, when it runs on
  duplicated_sample,  // delivered twice with the same counter; `hidden`: the second time with the next counter
  gyro_glitch,        // + size [mrad] in the gyro increment of that sample
  velocity_knock,     // + size [m/s] in the accelerometer increment of that sample
  invalid_sample,     // `count` samples carry sample_flag_invalid; their data are correct
  imu_silent,         // nothing is delivered from time_s for duration_s (samples are lost, the counter shows the gap)
  imu_unplugged,      // from time_s on read() is a device error until open(), which succeeds
  // Faults of the table. `axis` is an Axis.
  table_moved,  // at time_s the axis moves by size [deg] at rate_degps and stays there; the encoder shows it unless
                // `hidden` (only the platform moved)
  too_fast,  // from time_s for duration_s (0: for good) moves of the axis have rate_factor and acceleration_factor times
             // the commanded values
  never_in_position,  // from time_s for duration_s (0: for good) in_position stays false
  stuck_axis,         // at time_s the axis stops abruptly; it accepts commands without moving until clear_fault()
  axis_fault,         // at time_s the drive trips: the axis brakes with its last acceleration; latched until
                      // clear_fault()
  emergency_stop,     // at time_s all axes stop within one sample; latched until the operator releases the button
                      // (Rig::release_emergency_stop; or after duration_s unless it is 0) and clear_fault() is called
  link_lost,          // from time_s for duration_s (0: for good) every call to the table is a device error
  // Faults of the chamber, from time_s for duration_s (0: for good).
  chamber_never_settles,  // its air oscillates by size [C] about the set point
  chamber_sensor_dead,    // it repeats its last reading
  chamber_door_open,
  chamber_alarm,
  chamber_overheats,  // its air is size [C] hotter than its sensor shows
  chamber_link_lost,  // every call to it is a device error
  chamber_stays_on    // it accepts the command to switch off, but stays on
};

template <>
inline constexpr auto enum_words<RigFaultKind> = std::to_array(
    {"lost_sample",         "duplicated_sample", "gyro_glitch",    "velocity_knock",    "invalid_sample",
     "imu_silent",          "imu_unplugged",     "table_moved",    "too_fast",          "never_in_position",
     "stuck_axis",          "axis_fault",        "emergency_stop", "link_lost",         "chamber_never_settles",
     "chamber_sensor_dead", "chamber_door_open", "chamber_alarm",  "chamber_overheats", "chamber_link_lost",
     "chamber_stays_on"});
bool concerns_unit(RigFaultKind kind);  // false: the table or the chamber

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
  int unit = 1;  // for faults of the unit: the number of the unit on the table, from 1
  // True while a fault with a duration is in force.
  bool in_force(double now_s) const { return now_s >= time_s && (duration_s == 0.0 || now_s < time_s + duration_s); }
};

// A lot of units, some of them faulty, for rehearsing a production line (docs/fleet.md). The unit on the rig follows from its serial number.
//
// The same serial number is the same unit: its truth is drawn from the lot's seed and the serial. Each start time is a new turn-on, with its own
// noise and its own bias step. Between turn-ons the biases follow a random walk with one step per day.
// The faults of a unit. All but unsettled are present at every turn-on.
enum class LotFault {
  none,
  gyro_bias,        // one N0 is off by 0.6 deg/h
  accel_nonlinear,  // accel_second_order of one axis, 80 ug/g^2
  g_sensitive,      // gyro_g_sensitivity of one gyro to a force along another axis, 0.08 deg/h/g
  noisy,            // six times the angle random walk of the gyros
  unsettled         // at about every second turn-on an accelerometer bias jumps by 500 ug during the run
};
template <>
inline constexpr auto enum_words<LotFault> = std::to_array({"none", "gyro_bias", "accel_nonlinear", "g_sensitive",
                                                            "noisy", "unsettled"});

struct RigLot {
  std::optional<std::uint64_t> seed;  // not set: the unit does not depend on its serial number
  double faulty = 0.0;                // fraction of faulty units, 0 to 1
  double between_h = 0.25;            // from the end of a run to the start of the next
  double turn_on_gyro_degph = 0.0;    // sigma of the bias step from turn-on to turn-on
  double turn_on_accel_ug = 0.0;
  double month_gyro_degph = 0.0;  // sigma of the bias change in 30 days
  double month_accel_ug = 0.0;
  // Set by rig_of_lot() for the unit at this turn-on.
  LotFault fault = LotFault::none;
  bool fault_shows = false;
};

struct RigConfig {
  std::uint64_t seed = 1;                   // for truth and table errors
  std::optional<std::uint64_t> noise_seed;  // default: seed
  std::optional<std::uint64_t> unit_seed;   // for the truth; default: seed
  std::string unit_serial;                  // reported by identify(); empty: not reported
  double start_utc_s = 1767225600.0;        // 2026-01-01T00:00:00Z
  double sample_period_s = 0.005;
  std::int64_t first_counter = 0;       // the unit's counter at the rig's first sample
  int quadrature_substeps = 1;          // in motion: number of parts of each piece of a sample, to check the quadrature
  double gyro_pulse_arcsec = 0.932920;  // nominal value of the diagonal of n
  double accel_pulse_mps = 0.0005;
  RigQuantisation quantisation = RigQuantisation::floor;
  bool random_truth = true;                     // false: parameters not set have the nominal values of Wang (2020)
  std::array<std::optional<double>, 24> truth;  // order of Table 1; units of the parameter file
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

// The names of truth[], in the order of Table 1.
extern const std::array<const char*, 24> rig_truth_keys;

inline RigConfig default_rig_config() { return {}; }
// Reads a configuration. Errors (kind input) name file, line, key, value and what was expected; an unknown key is an error.
// A missing key keeps the value of `base`.
Result<RigConfig> read_rig_config(const std::string& path, const RigConfig& base = {});
Result<RigConfig> parse_rig_config(const std::string& text, const std::string& file_name);
// Returns the rig for one of several units on the table, from 0. The first is the configured one. The others have their own truth, noise
// and faults, and report no serial number; site, table, effects and temperature are the same for all.
RigConfig rig_of_unit(const RigConfig& config, std::size_t unit);
// Returns the rig for the unit `serial` turned on at config.start_utc_s; `config` itself without lot.seed.
RigConfig rig_of_lot(RigConfig config, const std::string& serial);
// Checks that the values are consistent with each other, beyond the range of each key.
Status check(const RigConfig& config);

}  // namespace turncal
