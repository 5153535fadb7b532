// For tests and benchmarks: a unit whose pulses tell their counter, as many of them as time has passed.
#pragma once

#include <unistd.h>

#include <algorithm>

#include "imu_io/base/clock.h"
#include "imu_io/units/frame_streamer.h"

namespace turncal::test {

class CountingSource : public ImuSource {
 public:
  explicit CountingSource(const FrameDescription& frame) : frame_(frame) {}
  Status open() override { return {}; }
  Result<ImuIdentity> identify() override { return ImuIdentity{}; }
  void describe(RecordingInfo& info) const override { frame_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    const auto n = std::min(out.size(), std::size_t(timeout_s / frame_.sample_period_s + 0.5));
    for (std::size_t i = 0; i < n; ++i) out[i] = sample(next_++);
    return n;
  }
  ImuLinkCounters counters() const override { return {}; }
  void close() override {}
  static ImuSample sample(std::int64_t counter) {
    ImuSample result;
    result.counter = counter;
    const auto n = double(counter);
    result.gyro = {n, -n, 3.0 * n};
    result.accel = {2.0 * n, 1.0, -n};
    result.temperature_c = 25.0F;
    return result;
  }

 private:
  FrameDescription frame_;
  std::int64_t next_ = 0;
};

// Pumps every 2 ms until `stop` is set or seconds have passed.
inline Status run(FrameStreamer& streamer, double seconds, const std::atomic<bool>& stop) {
  for (const Deadline deadline(seconds); !stop && !deadline.passed(); ::usleep(2000))
    if (const auto passed = streamer.pump(monotonic_s()); !passed) return passed.error();
  return {};
}

}  // namespace turncal::test
