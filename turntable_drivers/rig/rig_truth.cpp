#include "turntable_drivers/rig/rig_truth.h"

#include <algorithm>
#include <cmath>

#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {
namespace {

constexpr std::uint64_t truth_stream = 101;
constexpr std::uint64_t table_stream = 102;

double cut_normal(RandomStream& random) {
  for (;;) {
    const double value = random.normal();
    if (value > -2.5 && value < 2.5) return value;
  }
}

// Draws a magnitude between size/2 and size, of either sign.
double either_sign(RandomStream& random, double size) {
  const double value = random.uniform(-1.0, 1.0);
  return size * (value < 0.0 ? 0.5 * value - 0.5 : 0.5 * value + 0.5);
}

}  // namespace

std::array<double, 24> draw_truth(const RigConfig& config) {
  RandomStream random(config.unit_seed.value_or(config.seed), truth_stream);
  std::array<double, 24> truth{};
  const double nominal = config.gyro_pulse_arcsec;
  for (std::size_t i = 0; i < 24; ++i) {
    const bool is_n = i >= 6 && i < 15, is_a = i >= 15;
    const std::size_t cell = is_n ? i - 6 : i - 15;
    const bool diagonal = (is_n || is_a) && cell % 4 == 0;
    const bool below = is_a && (cell == 3 || cell == 6 || cell == 7);
    const double start = diagonal ? (is_n ? nominal : 1.0) : 0.0;
    const double drawn = cut_normal(random);
    double spread = 0.0;
    if (i < 3)
      spread = 0.08;
    else if (i < 6)
      spread = 4e-3;
    else if (is_n)
      spread = diagonal ? 3e-4 * nominal : 2e-3;
    else if (!below)
      spread = diagonal ? 0.03 : 7e-4;
    truth[i] = config.truth[i].value_or(config.random_truth ? start + spread * drawn : start);
  }
  return truth;
}

TableErrorsInForce draw_table_errors(const RigConfig& config) {
  RandomStream random(config.seed, table_stream);
  const RigTableErrors& set = config.table_errors;
  const double size = set.random_arcmin;
  const double on = size > 0.0 ? 1.0 : 0.0;
  TableErrorsInForce errors;
  const auto angle = [&](const std::optional<double>& given) {
    const double drawn = either_sign(random, size);
    return given.value_or(drawn);
  };
  errors.tilt_north_arcmin = angle(set.tilt_north_arcmin);
  errors.tilt_east_arcmin = angle(set.tilt_east_arcmin);
  errors.north_arcmin = angle(set.north_arcmin);
  errors.heading_pitch_arcmin = angle(set.heading_pitch_arcmin);
  errors.pitch_roll_arcmin = angle(set.pitch_roll_arcmin);
  for (std::size_t i = 0; i < 3; ++i) errors.mounting_arcmin[i] = angle(set.mounting_arcmin[i]);
  for (std::size_t i = 0; i < 3; ++i) {
    const double offset = 5.0 * on * random.uniform(-1.0, 1.0), scale = on * random.uniform(-1.0, 1.0);
    const double harmonic = 2.0 * on * random.uniform(), phase = on * random.uniform(0.0, 360.0);
    const RigTableErrors::Encoder& given = set.encoder[i];
    errors.encoder[i] = {given.offset_arcsec.value_or(offset), given.scale_ppm.value_or(scale),
                         given.harmonic_arcsec.value_or(harmonic), given.phase_deg.value_or(phase), given.order};
  }
  return errors;
}

GeometryAngles TableErrorsInForce::geometry_angles() const {
  constexpr double rad = pi / 180.0 / 60.0;
  GeometryAngles angles;
  angles.base = Eigen::Vector3d(tilt_north_arcmin, north_arcmin, tilt_east_arcmin) * rad;
  angles.heading_pitch = heading_pitch_arcmin * rad;
  angles.pitch_roll = pitch_roll_arcmin * rad;
  angles.mounting = Eigen::Vector3d(mounting_arcmin[0], mounting_arcmin[1], mounting_arcmin[2]) * rad;
  return angles;
}

std::vector<std::pair<std::string, double>> TableErrorsInForce::named() const {
  std::vector<std::pair<std::string, double>> list = {{"tilt_north_arcmin", tilt_north_arcmin},
                                                      {"tilt_east_arcmin", tilt_east_arcmin},
                                                      {"north_arcmin", north_arcmin},
                                                      {"heading_pitch_arcmin", heading_pitch_arcmin},
                                                      {"pitch_roll_arcmin", pitch_roll_arcmin},
                                                      {"mounting_x_arcmin", mounting_arcmin[0]},
                                                      {"mounting_y_arcmin", mounting_arcmin[1]},
                                                      {"mounting_z_arcmin", mounting_arcmin[2]}};
  for (Axis axis : all_axes) {
    const Encoder& e = encoder[index(axis)];
    const std::string name = std::string("encoder_") + to_string(axis);
    list.emplace_back(name + "_offset_arcsec", e.offset_arcsec);
    list.emplace_back(name + "_scale_ppm", e.scale_ppm);
    list.emplace_back(name + "_harmonic_arcsec", e.harmonic_arcsec);
    list.emplace_back(name + "_phase_deg", e.phase_deg);
  }
  return list;
}

}  // namespace turncal::rig_model

// ---- a lot of units ----

namespace turncal {

namespace {

using rig_model::RandomStream;

enum Stream : std::uint64_t { fault_stream = 201, place_stream, turn_on_stream, walk_stream };
constexpr double day_s = 86400.0, month_days = 30.0;
constexpr double lot_made_utc_s = 1767225600.0;  // 2026-01-01: start of the random walk of the biases
constexpr std::int64_t longest_walk_days = 36525;
constexpr double g_ug = 1e6;

// Returns the FNV-1a hash (Fowler, Noll, Vo) of the serial in 64 bits, seeded by the lot.
std::uint64_t unit_seed(const RigLot& lot, const std::string& serial) {
  constexpr std::uint64_t prime = 0x100000001b3ULL, golden = 0x9E3779B97F4A7C15ULL;
  std::uint64_t hash = 0xcbf29ce484222325ULL ^ (*lot.seed * golden);
  for (const char c : serial) hash = (hash ^ static_cast<unsigned char>(c)) * prime;
  return hash;
}

void lay_on(LotFault fault, std::size_t axis, double when_s, RigConfig& config) {
  switch (fault) {
    case LotFault::none: break;
    case LotFault::gyro_bias: *config.truth[axis] += 0.6; break;
    case LotFault::accel_nonlinear: config.effects.accel_second_order[axis] = 80.0; break;
    case LotFault::g_sensitive: config.effects.gyro_g_sensitivity[3 * axis + (axis + 1) % 3] = 0.08; break;
    case LotFault::noisy: config.noise.gyro_random_walk_deg_per_rt_h *= 6.0; break;
    case LotFault::unsettled:
      config.outside.accel_bias_step.axis = int(axis);
      config.outside.accel_bias_step.time_s = when_s;
      config.outside.accel_bias_step.size = 500.0;
      break;
  }
}

// Draws the unit's fault, which is the same at every turn-on.
LotFault fault_of(const RigLot& lot, std::uint64_t seed) {
  RandomStream random(seed, fault_stream);
  if (random.uniform() >= lot.faulty) return LotFault::none;
  constexpr double kinds = 5.0;
  return static_cast<LotFault>(1 + int(kinds * random.uniform()));
}

}  // namespace

RigConfig rig_of_lot(RigConfig config, const std::string& serial) {
  if (!config.lot.seed) return config;
  RigLot& lot = config.lot;
  const std::uint64_t seed = unit_seed(lot, serial);
  const auto turn_on_seed = seed ^ (std::uint64_t(config.start_utc_s) * 0xD1B54A32D192ED03ULL);
  config.unit_seed = seed;
  config.noise_seed = turn_on_seed;
  const std::array<double, 24> drawn = rig_model::draw_truth(config);
  RandomStream turn_on(turn_on_seed, turn_on_stream);
  const auto days =
      std::min(longest_walk_days, std::int64_t(std::max(0.0, (config.start_utc_s - lot_made_utc_s) / day_s)));
  for (std::size_t i = 0; i < 6; ++i) {
    const bool gyro = i < 3;
    double walked = 0.0;
    RandomStream walk(seed, walk_stream + i);
    for (std::int64_t day = 0; day < days; ++day) walked += walk.normal();
    const double month = gyro ? lot.month_gyro_degph : lot.month_accel_ug / g_ug;
    const double step = gyro ? lot.turn_on_gyro_degph : lot.turn_on_accel_ug / g_ug;
    config.truth[i] = drawn[i] + step * turn_on.normal() + month / std::sqrt(month_days) * walked;
  }
  RandomStream place(seed, place_stream);
  const auto axis = std::size_t(3.0 * place.uniform());
  constexpr double earliest_s = 1500.0, latest_s = 4500.0;
  const bool now = turn_on.uniform() < 0.5;
  lot.fault = fault_of(lot, seed);
  lot.fault_shows = lot.fault != LotFault::none && (now || lot.fault != LotFault::unsettled);
  if (lot.fault_shows) lay_on(lot.fault, axis, turn_on.uniform(earliest_s, latest_s), config);
  return config;
}

}  // namespace turncal
