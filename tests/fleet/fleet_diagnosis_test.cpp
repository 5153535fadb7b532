#include "calib/fleet/fleet_diagnosis.h"

#include <gtest/gtest.h>

#include "tests/fleet/drawn_fleet.h"

namespace turncal {
namespace {

constexpr std::size_t units = 200, stations = 4;
constexpr std::uint64_t seeds = 20;

FleetDiagnosis diagnose(std::uint64_t seed, const std::function<DrawnEffects(const DrawnUnit&)>& add) {
  return diagnose_fleet(drawn_fleet(seed, units, stations, add), {});
}

TEST(FleetDiagnosis, FindsNothingInACleanFleet) {
  int found = 0, outstanding = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const FleetDiagnosis d = diagnose(seed, [](const DrawnUnit&) { return DrawnEffects{}; });
    found += !d.effects.empty();
    outstanding += static_cast<int>(d.units.size());
    for (const FleetEffect& e : d.effects)
      std::printf("seed %d: %s %s z %.1f\n", (int)seed, e.component.c_str(), e.level.c_str(), e.z);
  }
  EXPECT_LE(found, 1);
  EXPECT_LE(outstanding, 2);
}

// A fifth of what one unit can show: one sigma.
TEST(FleetDiagnosis, FindsAStationEffectOfAFifthOfWhatOneUnitShows) {
  const std::string keys[] = {"accel_second_order.x", "gyro_g_sensitivity.yx", "accel_size_effect.x_rx",
                              "gyro_magnetic.zy"};
  int right = 0, blamed = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const std::string key = keys[seed % 4];
    const FleetDiagnosis d = diagnose(100 + seed, [&](const DrawnUnit& u) {
      return u.station == "S3" ? DrawnEffects{{key, sigma_of(key)}} : DrawnEffects{};
    });
    bool here = false;
    for (const ComponentSummary& c : d.components)
      if (c.component == key)
        std::printf("  %s S3 %.2f scatter %.2f of one\n", key.c_str(), c.levels[0][2].z, c.unit_scatter / c.one_unit);
    for (const FleetEffect& e : d.effects) {
      here = here || e.level == "S3";
      blamed += e.level != "S3";
      std::printf("seed %d: %s: %s %s %s z %.1f, %zu rivals\n", (int)seed, key.c_str(), e.component.c_str(),
                  e.level.c_str(), to_string(e.shape), e.z, e.rivals.size());
    }
    right += here;
  }
  EXPECT_GE(right, 19);
  EXPECT_LE(blamed, 1);
}

TEST(FleetDiagnosis, DoesNotBlameAStationForItsUnits) {
  int blamed = 0;
  std::size_t listed = 0, meant = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const FleetDiagnosis d = diagnose(200 + seed, [&](const DrawnUnit& u) {
      const UnitStatistics& one = statistics_of_one();
      if (std::uniform_real_distribution<>()(u.random) > 0.1) return DrawnEffects{};
      int k = 0;
      do k = std::uniform_int_distribution<>(0, static_cast<int>(one.columns.size()) - 1)(u.random);
      while (one.Q(k, k) == 0.0F);
      ++meant;
      const double size = std::exp(std::uniform_real_distribution<>(std::log(5.0), std::log(50.0))(u.random));
      return DrawnEffects{
          {one.columns[static_cast<std::size_t>(k)], size * sigma_of(one.columns[static_cast<std::size_t>(k)])}};
    });
    blamed += !d.effects.empty();
    for (const FleetEffect& e : d.effects)
      std::printf("seed %d: %s %s %s z %.1f\n", (int)seed, e.component.c_str(), e.level.c_str(), to_string(e.shape),
                  e.z);
    listed += d.units.size();
  }
  EXPECT_LE(blamed, 1);
  std::printf("%zu listed of %zu\n", listed, meant);
}

TEST(FleetDiagnosis, DatesTheDriftOfAStation) {
  int dated = 0;
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const std::string key = "accel_second_order.x";
    const FleetDiagnosis d = diagnose(300 + seed, [&](const DrawnUnit& u) {
      return u.station == "S2" ? DrawnEffects{{key, sigma_of(key) * std::max(0.0, u.day - 80.0) / 10.0}}
                               : DrawnEffects{};
    });
    for (const FleetEffect& e : d.effects) {
      if (e.level != "S2" || e.shape != FleetShape::ramp) continue;
      dated += e.begin_low <= 80.0 && e.begin_high >= 80.0;
      sum += std::abs(e.begin_day - 80.0);
      std::printf("seed %d: %s from %.1f (%.1f to %.1f), %zu effects\n", (int)seed, e.component.c_str(), e.begin_day,
                  e.begin_low, e.begin_high, d.effects.size());
      break;
    }
  }
  EXPECT_GE(dated, 17);
  EXPECT_LE(sum / seeds, 7.0);
}

}  // namespace
}  // namespace turncal
