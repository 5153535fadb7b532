// Confounded effects told apart by extra legs (docs/sequences.md): seeded rig recordings of the fourteen steps with one effect, the estimator
// is never told; where the diagnosis has confounded effects, legs are designed, run on the same unit, and both recordings diagnosed.
//
//   study_separation EFFECT.COMPONENT VALUE SEED
// One line: effect seed, names and class before, time of the legs, verdict, names and class after, decided or not.
//
//   study_separation --settle SEED CASES
// Units drawn from a seed until so many are in doubt after the fourteen steps; each is settled as a station does it (docs/sequences.md), within
// ten minutes, in rounds and in the same recording. A line a unit, and the sums.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/jobs/preflight.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

std::string class_of(const Diagnosis& d) {
  std::string text;
  for (const std::string& name : d.effect_names) {
    text += (text.empty() ? "" : "+") + name;
    if (const auto aliases = d.aliases.find(name); aliases != d.aliases.end())
      for (const std::string& alias : aliases->second) text += "|" + alias;
  }
  return text.empty() ? "-" : text;
}

int study(const std::string& key, double value, std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = seed;
  config.noise_seed = 100 + seed;
  double* const place = find_effect(config.effects, key);
  if (place == nullptr) {
    std::fprintf(stderr, "no effect %s\n", key.c_str());
    return 1;
  }
  *place = value;
  const Sequence sequence = must_read_sequence("fourteen_step.seq");
  const RigRecording first = record_on_rig(sequence, config);
  Diagnosis before = diagnose(first.recording);
  std::printf("%s %llu %s %s", key.c_str(), static_cast<unsigned long long>(seed), to_string(before.verdict),
              class_of(before).c_str());
  const std::string truth = key.substr(0, key.find('.'));
  const std::optional<Doubt> doubt = doubt_of(before);
  if (!doubt) {
    std::printf(" no class\n");
    return 0;
  }
  before.aliases[doubt->name] = doubt->others;
  const Separation separation(first.recording, before, doubt->name);
  const StationConfig station = default_station_config();
  DesignTask task;
  task.limits = plan_limits(station, must(rig_of(station)).sample_period_s);
  task.info = first.recording.info;
  task.rates_degps = {10.0, 20.0, 40.0};
  task.time_s = 600.0;
  task.tries = 600;
  task.start = walk_of(sequence);
  const ExtraLegs legs = must(find_extra_legs(&separation, task, [](double) {}));
  const std::string text = sequence_text(legs.walk, {.name = "extra", .comments = {}});
  const Sequence extra = must(parse_sequence(text, "extra.seq"));
  config.noise_seed = 200 + seed;
  const RigRecording second = record_on_rig(extra, config);
  const Diagnosis after = diagnose(join_recordings({&first.recording, &second.recording}));
  const bool decided = after.effect_names == std::vector<std::string>{truth} && class_of(after) == truth;
  std::printf(" %s %.0f s %s %s %s: %s\n", legs.apart ? "apart" : "not apart", legs.time_s, to_string(after.verdict),
              class_of(after).c_str(), decided ? "decided" : "open", after.reason.c_str());
  return 0;
}

// An effect that the fourteen steps confound with another, and the range of its size: about what they just show, and three times that.
struct Drawn {
  const char* key;
  double least, most;
};
constexpr Drawn confounded[] = {{"accel_second_order.", 10.0, 40.0},
                                {"accel_scale_asymmetry.", 10.0, 40.0},
                                {"accel_odd_quadratic.", 40.0, 150.0},
                                {"accel_third_order.", 40.0, 150.0}};

int settle(std::uint64_t seed, int cases) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double from, double to) { return from + (to - from) * double(random() >> 11) * 0x1p-53; };
  const Sequence sequence = must_read_sequence("fourteen_step.seq");
  const StationConfig station = default_station_config();
  const PlanLimits limits = plan_limits(station, default_rig_config().sample_period_s);
  int doubts = 0, right = 0, open = 0, wrong = 0, clear = 0, clear_wrong = 0;
  double longest_s = 0.0;
  while (doubts < cases && doubts + clear < 20 * cases) {
    RigConfig config = default_rig_config();
    config.seed = random() % 1000000;
    config.noise_seed = random() % 1000000;
    const Drawn& drawn = confounded[random() % std::size(confounded)];
    const std::string key = drawn.key + std::string(1, "xyz"[random() % 3]);
    const double value = uniform(drawn.least, drawn.most) * (random() % 2 == 0 ? 1.0 : -1.0);
    *find_effect(config.effects, key) = value;
    const std::string truth = key.substr(0, key.find('.'));
    Sequence whole = sequence;
    RigRecording made = record_on_rig(whole, config);
    double added_s = 0.0, search_s = 0.0;
    std::string doubts_text, why_not;
    for (double left_s = 600.0; left_s >= least_settling_s; left_s = 600.0 - added_s) {
      const auto began = std::chrono::steady_clock::now();
      const std::optional<Settling> found = find_settling({.recording = made.recording,
                                                           .base = joint_estimate(made.recording),
                                                           .sequence = whole,
                                                           .plan = make_plan(whole, limits),
                                                           .limits = limits,
                                                           .left_s = left_s});
      search_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      if (!found) break;
      doubts_text += (doubts_text.empty() ? "" : ", then ") + found->doubt;
      why_not = found->why_not;
      if (found->sequence.empty()) break;
      added_s += found->added_s;
      append_steps(must(parse_sequence(found->sequence, "settling")), whole);
      made = record_on_rig(whole, config);
    }
    const Diagnosis after = diagnose(made.recording);
    const bool decided = after.verdict == Verdict::extended && class_of(after) == truth;
    const bool another = after.verdict == Verdict::extended && !doubt_of(after) && !decided;  // alone
    const std::string name = std::string(to_string(after.verdict)) + " " + class_of(after);
    ++(doubts_text.empty() ? clear : doubts);
    longest_s = std::max(longest_s, added_s);
    if (doubts_text.empty())
      clear_wrong += another ? 1 : 0;
    else
      ++(decided ? right : another ? wrong : open);
    std::printf("%s %.1f, noise %llu: in doubt %s; search %.0f s, legs %.0f s; %s: %s; %s\n", key.c_str(), value,
                static_cast<unsigned long long>(*config.noise_seed), doubts_text.c_str(), search_s, added_s,
                decided   ? "decided"
                : another ? "WRONG"
                          : "open",
                name.c_str(), why_not.c_str());
    std::fflush(stdout);
  }
  std::printf("%d in doubt: %d decided, %d open, %d wrong; at most %.0f s; %d were not in doubt, %d of them wrong\n",
              doubts, right, open, wrong, longest_s, clear, clear_wrong);
  return 0;
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "study_separation EFFECT.COMPONENT VALUE SEED\nstudy_separation --settle SEED CASES\n");
    return 1;
  }
  if (std::string(argv[1]) == "--settle")
    return turncal::settle(std::strtoull(argv[2], nullptr, 10), std::atoi(argv[3]));
  return turncal::study(argv[1], std::atof(argv[2]), std::strtoull(argv[3], nullptr, 10));
}
