// Cost of the joint estimate: a sample, and against the length of the recording (1, 2, 8 and 24 h of the fourteen steps).
//
//   bench_calib --benchmark_filter=joint
// joint_estimate: all iterations and the noise fit, from sufficient statistics. joint_candidates: with every column of the
// catalogue in the last pass. What makes the statistics while samples come in is measured by `compression`.
#include <benchmark/benchmark.h>

#include <map>
#include <string>

#include "calib/joint/joint_estimate.h"
#include "calib/model/effects.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

// The fourteen steps over and over, renumbered, until `hours` are full.
Sequence steps_for(double hours) {
  const std::string text = must_read_sequence("fourteen_step.seq").text;
  const std::size_t first = text.find("\nstep ") + 1;
  std::string repeated = text.substr(0, first);
  int number = 0;
  for (double filled_s = 0.0; filled_s < hours * 3600.0;) {
    for (std::size_t at = first; at < text.size() && filled_s < hours * 3600.0;) {
      std::size_t next = text.find("\nstep ", at);
      next = next == std::string::npos ? text.size() : next + 1;
      const std::string step = text.substr(at, next - at);
      repeated += "step " + std::to_string(++number) + step.substr(step.find(' ', 5));
      filled_s += 6342.0 / 14.0;  // about; the benchmark counts samples
      at = next;
    }
  }
  return must(parse_sequence(repeated, "repeated"));
}

const RigRecording& recording_of(int hours) {
  static std::map<int, RigRecording> made;
  auto at = made.find(hours);
  if (at == made.end()) {
    RigConfig config = default_rig_config();
    at = made.emplace(hours, record_on_rig(steps_for(hours), config)).first;
  }
  return at->second;
}

void estimate(benchmark::State& state, bool candidates) {
  const RigRecording& made = recording_of(int(state.range(0)));
  JointOptions options;
  if (candidates) options.candidates = catalogue_columns(made.recording.info);
  int iterations = 0;
  for (auto _ : state) {
    const JointResult result = joint_estimate(made.recording, options);
    if (!result.converged) state.SkipWithError(result.message.c_str());
    iterations = result.iterations;
    benchmark::DoNotOptimize(result.covariance.data());
  }
  const double samples = double(made.recording.samples);
  state.counters["samples"] = samples;
  state.counters["passes"] = iterations;
  state.counters["MB_of_statistics"] = double(made.recording.blocks.size() * sizeof(Block)) / 1e6;
  state.counters["a_sample"] =
      benchmark::Counter(samples, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
void joint_estimate_by_hours(benchmark::State& state) { estimate(state, false); }
void joint_candidates_by_hours(benchmark::State& state) { estimate(state, true); }
BENCHMARK(joint_estimate_by_hours)->Arg(1)->Arg(2)->Arg(8)->Arg(24)->Unit(benchmark::kMillisecond);
BENCHMARK(joint_candidates_by_hours)->Arg(1)->Arg(2)->Arg(8)->Arg(24)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace turncal
