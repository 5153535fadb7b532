// Compression from memory, evaluation of blocks, and the closed form on the fourteen steps.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>

#include "calib/closed_form/closed_form.h"
#include "calib/statistics/block_motion.h"
#include "tests/calib/compress.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

// 6342 s of the rig with noise, made once.
const RigRecording& fourteen_steps() {
  static const RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), default_rig_config());
  return made;
}

// What a unit at 10 deg/s delivers, whole pulses.
std::vector<ImuSample> turning_samples() {
  std::vector<ImuSample> samples(200000);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    ImuSample& s = samples[i];
    const double angle = double(i) * 0.005 * 10.0 * std::numbers::pi / 180.0;
    s.counter = std::int64_t(i);
    s.gyro = {193.0, double(i % 3) - 1.0, double(i % 2)};
    s.accel = {double(i % 2), std::round(98.0 * std::cos(angle)), std::round(98.0 * std::sin(angle))};
    s.temperature_c = 25.0F;
  }
  return samples;
}

void compression(benchmark::State& state, SegmentKind kind) {
  static const std::vector<ImuSample> samples = turning_samples();
  std::vector<ImuSample> still;
  if (kind == SegmentKind::still) {
    still = samples;
    for (ImuSample& s : still) s.gyro[0] = 1.0;
  }
  const std::span<const ImuSample> input = still.empty() ? samples : still;
  Segment segment;
  segment.kind = kind;
  segment.end_sample = std::int64_t(input.size());
  RecordingInfo info;
  info.has_temperature = true;
  for (auto _ : state) {
    const CompressedRecording recording = compress(info, {segment}, input);
    benchmark::DoNotOptimize(recording.blocks.data());
  }
  state.SetItemsProcessed(state.iterations() * std::int64_t(input.size()));
  state.counters["a_sample"] = benchmark::Counter(
      double(input.size()), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK_CAPTURE(compression, static_seconds, SegmentKind::still)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(compression, rotations, SegmentKind::rotate)->Unit(benchmark::kMillisecond);

void closed_form(benchmark::State& state) {
  const RigRecording& made = fourteen_steps();
  int passes = 0;
  for (auto _ : state) {
    const auto result = closed_form_calibrate(made.recording, start_parameters(made.recording.info));
    passes = result.ok() ? result->passes : 0;
  }
  state.counters["passes"] = passes;
  state.counters["blocks"] = double(made.recording.blocks.size());
}
BENCHMARK(closed_form)->Unit(benchmark::kMillisecond);

void block_evaluation(benchmark::State& state) {
  const RigRecording& made = fourteen_steps();
  const SensorModel model = sensor_model(made.truth, made.recording.info);
  for (auto _ : state)
    for (const Block& block : made.recording.blocks) benchmark::DoNotOptimize(evaluate(block, model, 0.005));
  state.SetItemsProcessed(state.iterations() * std::int64_t(made.recording.blocks.size()));
}
BENCHMARK(block_evaluation)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace turncal
