// What reading and writing a recording costs: text read, import, export, binary open and read, also a sample.
//
// The recording is made here (1 268 400 samples, as many as the fourteen steps take; pulses and temperature), in a
// temporary folder. The disk's sync is part of import and export, as it is for the user.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

constexpr std::int64_t sample_count = 1268400;

void require(const Status& status) {
  if (status) return;
  std::fprintf(stderr, "%s\n", status.error().message.c_str());
  std::abort();
}

struct Files {
  std::string folder = (std::filesystem::temp_directory_path() / "turncal_bench_recording").string();
  std::string binary = folder + "/recording.tcr";
  std::string text = folder + "/text";

  Files() {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    RecordingInfo info;
    info.latitude_deg = 29.53;
    info.gravity_mps2 = 9.7914;
    info.unit_serial = "BENCH";
    info.accel_pulse_mps = 0.0005;
    info.has_temperature = true;
    auto writer = RecordingWriter::create(binary, info);
    require(writer ? Status() : Status(writer.error()));
    std::vector<ImuSample> samples(static_cast<std::size_t>(sample_count));
    for (std::int64_t i = 0; i < sample_count; ++i) {
      ImuSample& sample = samples[std::size_t(i)];
      sample.counter = i;
      sample.gyro = {double(i % 3 - 1), double(i % 50000), -double(i % 7)};
      sample.accel = {double(i % 5 - 2), 96.0, double(i % 2)};
      sample.temperature_c = float(24.0 + double(i / 230) / 1000.0);
    }
    require(writer->add(samples));
    require(writer->finish());
    auto source = RecordingSource::open(binary);
    require(export_text(**source, text));
  }
  ~Files() { std::filesystem::remove_all(folder); }
};

Files& files() {
  static Files made;
  return made;
}

void report(benchmark::State& state) {
  state.counters["a_sample"] = benchmark::Counter(
      double(sample_count), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void read_recording(benchmark::State& state, const std::string& path) {
  for (auto _ : state) {
    auto source = RecordingSource::open(path);
    require(source ? Status() : Status(source.error()));
    double sum = 0.0;
    require((*source)->read([&](std::span<const ImuSample> samples) {
      for (const ImuSample& sample : samples) sum += sample.accel[1];
      return Status();
    }));
    benchmark::DoNotOptimize(sum);
  }
  report(state);
}

void open_binary(benchmark::State& state) {
  for (auto _ : state) {
    auto source = RecordingSource::open(files().binary);
    require(source ? Status() : Status(source.error()));
    benchmark::DoNotOptimize(source);
  }
  report(state);
}

void open_and_read_binary(benchmark::State& state) { read_recording(state, files().binary); }
void open_and_read_text(benchmark::State& state) { read_recording(state, files().text); }

void import_text(benchmark::State& state) {
  for (auto _ : state) {
    auto source = RecordingSource::open(files().text);
    require(source ? Status() : Status(source.error()));
    require(import_binary(**source, files().folder + "/imported.tcr"));
  }
  report(state);
}

void export_to_text(benchmark::State& state) {
  for (auto _ : state) {
    auto source = RecordingSource::open(files().binary);
    require(source ? Status() : Status(source.error()));
    require(export_text(**source, files().folder + "/exported"));
  }
  report(state);
}

BENCHMARK(open_binary)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(open_and_read_binary)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(open_and_read_text)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(import_text)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(export_to_text)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace turncal
