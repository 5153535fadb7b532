// Cost of one sample of the rig. Targets on one core: 500 ns at rest, 1500 ns in motion, everything on.
#include <vector>

#include <benchmark/benchmark.h>

#include "turntable_drivers/rig/rig.h"

namespace {

using namespace turncal;

constexpr std::size_t batch = 2000;

void per_sample(benchmark::State& state) {
  state.counters["s/sample"] =
      benchmark::Counter(double(state.iterations()) * batch, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void rest(benchmark::State& state) {
  Rig rig(default_rig_config());
  std::vector<ImuSample> samples(batch);
  for (auto _ : state) rig.advance(samples);
  per_sample(state);
}
BENCHMARK(rest);

RigConfig every_effect() {
  RigConfig config = default_rig_config();
  for (const std::string& key : rig_effect_keys()) *find_effect(config.effects, key) = 1e-3;
  return config;
}

void rest_every_effect(benchmark::State& state) {
  Rig rig(every_effect());
  std::vector<ImuSample> samples(batch);
  for (auto _ : state) rig.advance(samples);
  per_sample(state);
}
BENCHMARK(rest_every_effect);

// Rotations of 20 000 deg last longer than any run of the benchmark needs: every sample is one in motion.
void motion(benchmark::State& state, const RigConfig& config, std::initializer_list<Axis> axes) {
  Rig rig(config);
  std::vector<ImuSample> samples(batch);
  double target_deg = 1e9;
  for (Axis axis : axes) rig.command_move(axis, target_deg, 10.0, 10.0);
  for (auto _ : state) rig.advance(samples);
  per_sample(state);
}
BENCHMARK_CAPTURE(motion, one_axis, default_rig_config(), {Axis::pitch});
BENCHMARK_CAPTURE(motion, three_axes, default_rig_config(), {Axis::heading, Axis::pitch, Axis::roll});
BENCHMARK_CAPTURE(motion, one_axis_every_effect, every_effect(), {Axis::pitch});

// The fourteen steps in numbers: 1 268 400 samples, of which about 100 000 turn.
void whole_run(benchmark::State& state) {
  std::vector<ImuSample> samples(1000);
  for (auto _ : state) {
    Rig rig(default_rig_config());
    double target_deg = 0.0;
    for (std::int64_t done = 0; done < 1268400; done += 1000) {
      if (done % 24000 == 0) {
        target_deg = target_deg == 0.0 ? 90.0 : 0.0;
        rig.command_move(Axis::pitch, target_deg, 10.0, 10.0);
      }
      rig.advance(samples);
    }
  }
}
BENCHMARK(whole_run)->Unit(benchmark::kMillisecond);

}  // namespace
