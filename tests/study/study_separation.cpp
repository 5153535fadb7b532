// Confounded effects told apart by extra legs (docs/design.md): seeded rig recordings of the fourteen steps with one effect, the estimator
// is never told; where the diagnosis has confounded effects, legs are designed, run on the same unit, and both recordings diagnosed.
//
//   study_separation EFFECT.COMPONENT VALUE SEED
// One line: effect seed, names and class before, time of the legs, verdict, names and class after, decided or not.
//
//   study_separation --settle SEED CASES
// Units drawn from a seed until so many are in doubt after the fourteen steps; each is settled as a station does it (docs/design.md), within
// ten minutes and in the same recording. A line a unit, and the sums.
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
  const Diagnosis before = diagnose(first.recording);
  std::printf("%s %llu %s %s", key.c_str(), static_cast<unsigned long long>(seed), to_string(before.verdict),
              class_of(before).c_str());
  std::fflush(stdout);
  const std::string truth = key.substr(0, key.find('.'));
  const auto in_class = std::find_if(before.effect_names.begin(), before.effect_names.end(), [&](const std::string& n) {
    const auto aliases = before.aliases.find(n);
    return aliases != before.aliases.end() && !aliases->second.empty();
  });
  if (in_class == before.effect_names.end()) {
    std::printf(" no class\n");
    return 0;
  }
  const Separation separation(first.recording, before, *in_class);
  const StationConfig station = default_station_config();
  DesignTask task;
  task.limits = plan_limits(station, must(rig_of(station)).sample_period_s);
  task.info = first.recording.info;
  task.rates_degps = {10.0, 20.0, 40.0};
  task.time_s = 600.0;
  task.tries = 600;
  task.start = walk_of(sequence);
  const ExtraLegs legs = must(find_extra_legs(separation, task, [](double) {}));
  for (std::size_t k = 0; k < legs.after.size(); ++k)
    std::fprintf(stderr, "  %s from %s: 2 ln L %.1f -> %.1f, correlation %.4f -> %.4f\n", legs.after[k].truth.c_str(),
                 legs.after[k].other.c_str(), legs.before[k].gain, legs.after[k].gain, legs.before[k].correlation,
                 legs.after[k].correlation);
  WalkHeader header;
  header.name = "extra";
  header.rate_degps = 10.0;
  const std::string text = sequence_text(legs.walk, header);
  const Sequence extra = must(parse_sequence(text, "extra.seq"));
  config.noise_seed = 200 + seed;
  const RigRecording second = record_on_rig(extra, config);
  const Diagnosis after = diagnose(join_recordings({&first.recording, &second.recording}));
  const bool decided = after.effect_names == std::vector<std::string>{truth} && class_of(after) == truth;
  std::printf(" %s %.0f s %s %s %s%s%s\n", legs.apart ? "apart" : "not apart", legs.time_s, to_string(after.verdict),
              class_of(after).c_str(), decided ? "decided" : "open", decided ? "" : ": ",
              decided ? "" : after.reason.c_str());
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
  const auto uniform = [&](double from, double to) {
    return from + (to - from) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
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
    const RigRecording first = record_on_rig(sequence, config);
    const JointResult base = joint_estimate(first.recording);
    const auto began = std::chrono::steady_clock::now();
    const std::optional<Settling> found = find_settling({.recording = first.recording,
                                                         .base = base,
                                                         .sequence = sequence,
                                                         .plan = make_plan(sequence, limits),
                                                         .limits = limits,
                                                         .left_s = 600.0});
    const double search_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    const auto name_of = [](const Diagnosis& d) { return std::string(to_string(d.verdict)) + " " + class_of(d); };
    const auto names_another = [&](const Diagnosis& d) {  // alone
      return d.verdict == Verdict::extended && !doubt_of(d) && d.effect_names != std::vector<std::string>{truth};
    };
    if (!found) {
      ++clear;
      const Diagnosis before = diagnose(first.recording);
      clear_wrong += names_another(before) ? 1 : 0;
      std::printf("%s %.1f: no doubt, %s\n", key.c_str(), value, name_of(before).c_str());
      std::fflush(stdout);
      continue;
    }
    ++doubts;
    std::string now = "not tried: " + found->why_not;
    if (found->sequence.empty()) {
      ++open;
    } else {
      longest_s = std::max(longest_s, found->added_s);
      Sequence both = sequence;
      append_steps(must(parse_sequence(found->sequence, "settling")), both);
      const Diagnosis after = diagnose(record_on_rig(both, config).recording);
      const bool decided = after.verdict == Verdict::extended && class_of(after) == truth;
      ++(decided ? right : names_another(after) ? wrong : open);
      now = (decided ? "decided: " : names_another(after) ? "WRONG: " : "open: ") + name_of(after);
    }
    std::printf("%s %.1f: in doubt %s; search %.0f s, legs %.0f s; %s\n", key.c_str(), value, found->doubt.c_str(),
                search_s, found->added_s, now.c_str());
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
