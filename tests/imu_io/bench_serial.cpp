// Capture from a serial line, through a pseudo-terminal: the CPU time of the reader's thread as a share of one core, at 200 Hz with
// the station's own frame, and 2 kHz of 46-byte frames (921600 baud carry 92160 bytes a second, this is 92000) for 10 s without a
// loss. The sender is a thread of its own and is not counted. A pseudo-terminal has no interrupts of a UART: those are not in it.
#include <benchmark/benchmark.h>
#include <time.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/units/serial_imu.h"
#include "tests/imu_io/counting_source.h"

namespace turncal {
namespace {

template <class T>
T must(Result<T> result) {
  if (result) return std::move(*result);
  std::fprintf(stderr, "%s\n", result.error().message.c_str());
  std::abort();
}
void must(const Status& status) {
  if (status) return;
  std::fprintf(stderr, "%s\n", status.error().message.c_str());
  std::abort();
}

double thread_cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

// The station's frame at another period and length.
FrameDescription frame_of(double period_s, int length) {
  std::string text(builtin_frame_text("laser_gyro"));
  const auto set = [&](const std::string& key, const std::string& value) {
    const std::size_t at = text.find("\n" + key + " = ") + 1;
    text.replace(at, text.find('\n', at) - at, key + " = " + value);
  };
  set("sample_period_s", std::to_string(period_s));
  set("length", std::to_string(length));
  set("check.offset", std::to_string(length - 2));
  set("line.baud", "921600");
  return must(parse_frame_description(text, "bench"));
}

void capture(benchmark::State& state, double rate_hz, int length, double seconds) {
  for (auto _ : state) {
    const FrameDescription frame = frame_of(1.0 / rate_hz, length);
    Pty pty = must(Pty::create());
    test::CountingSource unit(frame);
    FrameStreamer streamer(unit, frame, pty, 1.0);
    SerialImuSettings settings;
    settings.device = pty.device();
    SerialImu imu(frame, settings);
    must(imu.open());
    must(streamer.start(monotonic_s()));
    const std::atomic<bool> stop = false;
    std::thread sender([&] { must(test::run(streamer, seconds, stop)); });
    std::array<ImuSample, 256> block;
    std::uint64_t received = 0;
    const double cpu = thread_cpu_s();
    const double began = monotonic_s();
    const Deadline end(seconds + 0.3);
    while (!end.passed()) received += must(imu.read(block, 0.1));
    const double used = thread_cpu_s() - cpu;
    const double took = monotonic_s() - began;
    sender.join();
    state.counters["core_%"] = 100.0 * used / took;
    state.counters["us_a_sample"] = 1e6 * used / double(received);
    state.counters["sent"] = double(streamer.frames_sent());
    state.counters["missing"] = double(streamer.frames_sent()) - double(received);
    const ImuLinkCounters counters = imu.counters();
    state.counters["bad"] = double(counters.bad_frames + counters.lost_samples + counters.duplicates);
    if (received != streamer.frames_sent() || streamer.batches_dropped() != 0) state.SkipWithError("samples were lost");
  }
}

void capture_200_hz(benchmark::State& state) { capture(state, 200.0, 36, 10.0); }
BENCHMARK(capture_200_hz)->Iterations(1)->Unit(benchmark::kSecond);
void capture_2_khz_at_921600_baud(benchmark::State& state) { capture(state, 2000.0, 46, 10.0); }
BENCHMARK(capture_2_khz_at_921600_baud)->Iterations(1)->Unit(benchmark::kSecond);

// Decoding alone, from memory.
void decode(benchmark::State& state) {
  const FrameDescription frame = must(find_frame("laser_gyro"));
  FrameEncoder encoder(frame);
  test::CountingSource unit(frame);
  std::array<ImuSample, 128> samples;
  std::vector<std::byte> bytes(samples.size() * encoder.length());
  FrameDecoder decoder(frame);
  std::uint64_t decoded = 0;
  for (auto _ : state) {
    state.PauseTiming();
    must(unit.read(samples, 1.0));
    for (std::size_t i = 0; i < samples.size(); ++i)
      must(encoder.encode(samples[i], std::span(bytes).subspan(i * encoder.length(), encoder.length())));
    state.ResumeTiming();
    const auto room = decoder.space();
    std::ranges::copy(bytes, room.begin());
    decoder.added(bytes.size(), {0.0, 1e6});
    ImuSample sample;
    while (decoder.next(sample) == FrameDecoder::Next::sample) ++decoded;
  }
  state.SetItemsProcessed(std::int64_t(decoded));
  state.SetBytesProcessed(std::int64_t(decoded * encoder.length()));
}
BENCHMARK(decode);

}  // namespace
}  // namespace turncal
