#include "calib/fleet/fleet_diagnosis.h"

#include "tests/fleet/drawn_fleet.h"
#include "tests/test.h"

namespace turncal {
namespace {

constexpr std::size_t units = 200, stations = 4;
constexpr std::uint64_t seeds = 20;

FleetDiagnosis diagnose(std::uint64_t seed, const std::function<DrawnEffects(const DrawnUnit&)>& add) {
  return diagnose_fleet(drawn_fleet(seed, units, stations, add), {});
}

std::string drawn_column(std::mt19937_64& random) {
  const UnitStatistics& one = statistics_of_one();
  for (;;) {
    const auto k = std::uniform_int_distribution<Eigen::Index>(0, one.Q.rows() - 1)(random);
    if (one.Q(k, k) > 0.0F) return one.columns[static_cast<std::size_t>(k)];
  }
}

TEST(FleetDiagnosis, FindsNothingInACleanFleet) {
  int found = 0, outstanding = 0, unexplained = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const FleetDiagnosis d = diagnose(seed, [](const DrawnUnit&) { return DrawnEffects{}; });
    found += !d.effects.empty();
    unexplained += !d.explained();
    outstanding += static_cast<int>(d.units.size());
  }
  EXPECT_LE(found, 1);
  EXPECT_LE(outstanding, 2);
  EXPECT_LE(unexplained, 2);
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
    for (const FleetEffect& e : d.effects) {
      here = here || e.level == "S3";
      blamed += e.level != "S3";
    }
    right += here;
  }
  EXPECT_GE(right, 19);
  EXPECT_LE(blamed, 1);
}

TEST(FleetDiagnosis, DoesNotBlameAStationForItsUnits) {
  int blamed = 0;
  std::size_t listed = 0, meant = 0;
  for (std::uint64_t seed = 1; seed <= 4 * seeds; ++seed) {
    const FleetDiagnosis d = diagnose(200 + seed, [&](const DrawnUnit& u) {
      if (std::uniform_real_distribution<>()(u.random) > 0.1) return DrawnEffects{};
      const std::string key = drawn_column(u.random);
      ++meant;
      const double size = std::exp(std::uniform_real_distribution<>(std::log(5.0), std::log(50.0))(u.random));
      return DrawnEffects{{key, size * sigma_of(key)}};
    });
    blamed += !d.effects.empty();
    listed += d.units.size();
  }
  EXPECT_LE(blamed, 4);
  EXPECT_GE(listed, meant * 9 / 10);
}

// What no single component shows: a hundredth of the catalogue's directions with half a sigma each, at one station.
TEST(FleetDiagnosis, SaysThatSomethingIsLeft) {
  int said = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const UnitStatistics& one = statistics_of_one();
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    DrawnEffects everywhere;
    for (const std::string& key : one.columns)
      if (sigma_of(key) < 1e30) everywhere.emplace_back(key, 0.08 * normal(random) * sigma_of(key));
    const FleetDiagnosis d =
        diagnose(400 + seed, [&](const DrawnUnit& u) { return u.station == "S1" ? everywhere : DrawnEffects{}; });
    said += !d.explained() || !d.effects.empty();
  }
  EXPECT_GE(said, 4);
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
      break;
    }
  }
  EXPECT_GE(dated, 17);
  EXPECT_LE(sum / seeds, 7.0);
}

// Its last recordings stand out by themselves, and what is left of it without them is no ramp.
TEST(FleetDiagnosis, DatesASteepDrift) {
  int dated = 0, to_a_week = 0, blamed = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    std::mt19937_64 random(seed);
    const std::string key = drawn_column(random);
    const double begin = std::uniform_real_distribution<>(40.0, 120.0)(random);
    const double days_a_sigma = std::uniform_real_distribution<>(2.0, 6.0)(random);
    const FleetDiagnosis d = diagnose(500 + seed, [&](const DrawnUnit& u) {
      return u.station == "S2" ? DrawnEffects{{key, sigma_of(key) * std::max(0.0, u.day - begin) / days_a_sigma}}
                               : DrawnEffects{};
    });
    bool first = true;
    for (const FleetEffect& e : d.effects) {
      blamed += e.level != "S2";
      if (e.level != "S2" || e.shape == FleetShape::constant || !first) continue;
      first = false;
      dated += e.begin_low <= begin && e.begin_high >= begin;
      to_a_week += std::abs(e.begin_day - begin) <= 7.0;
    }
  }
  EXPECT_EQ(blamed, 0);
  EXPECT_GE(dated, 18);
  EXPECT_GE(to_a_week, 18);
}

}  // namespace
}  // namespace turncal
