// Confounded effects told apart by extra legs (docs/design.md): seeded rig recordings of the fourteen steps with one effect, the estimator
// is never told; where the diagnosis has confounded effects, legs are designed, run on the same unit, and both recordings diagnosed.
//
//   study_separation EFFECT.COMPONENT VALUE SEED
// One line: effect seed, names and class before, time of the legs, verdict, names and class after, decided or not.
#include <cstdio>
#include <cstdlib>

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

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "study_separation EFFECT.COMPONENT VALUE SEED\n");
    return 1;
  }
  return turncal::study(argv[1], std::atof(argv[2]), std::strtoull(argv[3], nullptr, 10));
}
