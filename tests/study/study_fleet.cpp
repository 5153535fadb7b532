// The acceptance study of the fleet's diagnosis (docs/fleet.md): fleets of rigs, every unit with parameters, table and noise of its own.
//
//   study_fleet SEED_FIRST SEED_COUNT [--units N] [--stations K] [--sequence NAME.seq] [--of STORE]
// --of: the units are those of a store of `turncal recalibrate`, dealt to stations and days anew for each seed, and effects are laid on their
// scores (s + Q x) and not on the rig: hundreds of fleets in the time of one.
// For each seed the same clean fleet, and three more with something in it, of which only those recordings are made anew that have it:
// Effects and their signs are drawn at random among all that one recording of the rig can see.
//   station   one effect at one station: as large as one sigma of one recording (a fifth of what it shows by itself)
//   units     a tenth of the units has one effect each, 1 to 10 times what one recording shows
//   drift     an effect at one station grows from one of the days 40 to 120 of 182 on, by a sigma in 3 to 20 days
// A line each: seed, scenario, effect and size, found at the right level (1/0), that effect or a rival named (1/0), other levels blamed, units
// listed; of a drift: error of the begin, its least sigma by Cramer and Rao (days), inside the interval that is given (1/0).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <numeric>
#include <random>

#include "calib/fleet/fleet_diagnosis.h"
#include "orchestrator/fleet/fleet_members.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

struct Study {
  std::size_t units = 200, stations = 4;
  std::vector<FleetMember> dealt;
  Sequence sequence;
};

constexpr double days = 182.0;

struct Drift {  // of the rig, not as it is found
  double begin_day = NAN, least_sigma = NAN;
};

FleetMember made(const Study& study, std::uint64_t seed, std::size_t i, const std::string& effect, double value) {
  RigConfig config = default_rig_config();
  config.seed = 100000 * seed + i;
  config.noise_seed = 900000000 + 100000 * seed + i;
  if (!effect.empty()) *find_effect(config.effects, effect) = value;
  FleetMember m;
  m.unit = "U" + std::to_string(10000 + i);
  m.level = {"S" + std::to_string(1 + i % study.stations)};
  m.day = days * double(i) / double(study.units);
  if (study.dealt.empty()) {
    const RigRecording recorded = record_on_rig(study.sequence, config);
    m.statistics = unit_statistics(recorded.recording, joint_estimate(recorded.recording));
    return m;
  }
  std::vector<std::size_t> order(study.dealt.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::mt19937_64 random(seed);
  std::shuffle(order.begin(), order.end(), random);
  m.statistics = study.dealt[order[i]].statistics;
  const auto& columns = m.statistics.columns;
  if (const auto at = std::ranges::find(columns, effect); at != columns.end()) {
    const auto k = at - columns.begin();
    m.statistics.s += m.statistics.Q.col(k).cast<double>() * value;
    m.statistics.value -= m.statistics.moves.col(k).cast<double>() * value;
  }
  return m;
}

// Components of the rig that one recording can see, with the sigma they have there.
std::vector<std::pair<std::string, double>> seen(const UnitStatistics& u) {
  std::vector<std::pair<std::string, double>> all;
  RigConfig config = default_rig_config();
  for (std::size_t k = 0; k < u.columns.size(); ++k) {
    const auto at = Eigen::Index(k);
    if (u.Q(at, at) > 0.0F && find_effect(config.effects, u.columns[k]))
      all.emplace_back(u.columns[k], 1.0 / std::sqrt(double(u.Q(at, at))));
  }
  return all;
}

void judge(std::uint64_t seed, const char* scenario, const std::string& key, double value, const FleetDiagnosis& d,
           const std::string& level, const Drift& drift = {}) {
  const std::string name = key.substr(0, key.find('.'));
  bool here = false, named = false;
  int blamed = 0;
  double begin = NAN;
  bool inside = false;
  for (const FleetEffect& e : d.effects) {
    if (e.level != level || level.empty()) {
      ++blamed;
      continue;
    }
    here = true;
    named = named || e.component.starts_with(name) || std::ranges::find(e.rivals, name) != e.rivals.end();
    if (e.shape == FleetShape::constant || std::isfinite(begin)) continue;
    begin = e.begin_day - drift.begin_day;
    inside = e.begin_low <= drift.begin_day && drift.begin_day <= e.begin_high;
  }
  std::printf("%llu %s %s %.4g %d %d %d %zu %.1f %.1f %d\n", static_cast<unsigned long long>(seed), scenario,
              key.empty() ? "-" : key.c_str(), value, here, named, blamed, d.units.size(), begin, drift.least_sigma,
              inside);
  for (const FleetEffect& e : d.effects)
    std::printf("#   %s %s %s %.3g +- %.2g, z %.1f\n", e.level.empty() ? "all" : e.level.c_str(), e.component.c_str(),
                to_string(e.shape), e.value, e.sigma, e.z);
  std::fflush(stdout);
}

void run(const Study& study, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<FleetMember> clean;
  for (std::size_t i = 0; i < study.units; ++i) clean.push_back(made(study, seed, i, "", 0.0));
  judge(seed, "clean", "", 0.0, diagnose_fleet(clean, {}), "");

  const auto effects = seen(clean.front().statistics);
  const auto between = [&](double a, double b) { return std::uniform_real_distribution<>(a, b)(random); };
  const auto draw = [&] {
    auto effect = effects[std::uniform_int_distribution<std::size_t>(0, effects.size() - 1)(random)];
    if (between(0.0, 1.0) < 0.5) effect.second = -effect.second;
    return effect;
  };
  const auto draw_station = [&] { return std::uniform_int_distribution<std::size_t>(0, study.stations - 1)(random); };
  {
    const auto [key, sigma] = draw();
    const std::size_t station = draw_station();
    std::vector<FleetMember> fleet = clean;
    for (std::size_t i = station; i < study.units; i += study.stations) fleet[i] = made(study, seed, i, key, sigma);
    judge(seed, "station", key, sigma, diagnose_fleet(fleet, {}), "S" + std::to_string(station + 1));
  }
  {
    std::vector<FleetMember> fleet = clean;
    for (std::size_t i = 0; i < study.units; ++i) {
      if (between(0.0, 1.0) > 0.1) continue;
      const auto [key, sigma] = draw();
      fleet[i] = made(study, seed, i, key, sigma * 5.0 * std::exp(between(0.0, std::log(10.0))));
    }
    judge(seed, "units", "", 0.0, diagnose_fleet(fleet, {}), "");
  }
  {
    const auto [key, sigma] = draw();
    const std::size_t station = draw_station();
    Drift drift{between(40.0, 120.0), NAN};
    const double sigma_days = std::exp(between(std::log(3.0), std::log(20.0)));
    std::vector<FleetMember> fleet = clean;
    int after = 0;
    for (std::size_t i = station; i < study.units; i += study.stations)
      if (fleet[i].day > drift.begin_day) {
        fleet[i] = made(study, seed, i, key, sigma * (fleet[i].day - drift.begin_day) / sigma_days);
        ++after;
      }
    drift.least_sigma = 2.0 * sigma_days / std::sqrt(after);  // docs/fleet.md
    judge(seed, "drift", key, sigma / sigma_days, diagnose_fleet(fleet, {}), "S" + std::to_string(station + 1), drift);
  }
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  Study study;
  std::string name = "forty_minutes.seq", store;
  bool good = argc >= 3 && argc % 2 == 1;
  for (int k = 3; good && k < argc; k += 2) {
    if (std::strcmp(argv[k], "--units") == 0)
      study.units = std::strtoull(argv[k + 1], nullptr, 10);
    else if (std::strcmp(argv[k], "--stations") == 0)
      study.stations = std::strtoull(argv[k + 1], nullptr, 10);
    else if (std::strcmp(argv[k], "--sequence") == 0)
      name = argv[k + 1];
    else if (std::strcmp(argv[k], "--of") == 0)
      store = argv[k + 1];
    else
      good = false;
  }
  if (!good) {
    std::fprintf(
        stderr,
        "usage: study_fleet SEED_FIRST SEED_COUNT [--units N] [--stations K] [--sequence NAME.seq] [--of STORE]\n");
    return 1;
  }
  study.sequence = must_read_sequence(name);
  if (!store.empty()) {
    Result<FleetSource> source = read_fleet(store, {});
    if (!source) {
      std::fprintf(stderr, "%s\n", source.error().message.c_str());
      return 1;
    }
    study.dealt = std::move(source->members);
    study.units = study.dealt.size();
  }
  const auto first = std::uint64_t(std::strtoll(argv[1], nullptr, 10));
  for (std::uint64_t k = 0; k < std::uint64_t(std::strtoll(argv[2], nullptr, 10)); ++k) run(study, first + k);
  return 0;
}
