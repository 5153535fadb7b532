// The unit's side of a serial line: sends the samples of any ImuSource (the rig) as frames, paced by the clock.
//
// pump(now) sends what a unit running `speedup` times faster than the clock would have sent by `now`, and advances the source by as much.
// As on a real line, bytes that nobody reads in time are lost while time goes on.
// A unit that answers requests sends its last sample for each of them: the same bytes until there is a new sample.
// In time means within patience_s of the host. A line's buffer that lasts half a second at the unit's own rate lasts only a fiftieth of
// that at 50 times the rate, so a faster twin needs more patience. It catches up on the time that it waited.
// Errors (kind input): source and frame differ (period, increments, pulse weight), or a sample does not fit the frame.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "imu_io/frames/frame_encoder.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/recordings/imu_source.h"

namespace turncal {

class FrameStreamer {
 public:
  // source and line must outlive the streamer.
  FrameStreamer(ImuSource& source, const FrameDescription& frame, UnitEnd& line, double speedup,
                double patience_s = 0.05);
  // Opens the source. Unit time 0 is at now_s of the monotonic clock.
  Status start(double now_s);
  // Returns the number of sample periods that have passed.
  Result<std::size_t> pump(double now_s);
  std::uint64_t frames_sent() const { return frames_sent_; }  // to the kernel, or discarded without a listener
  std::uint64_t batches_dropped() const { return batches_dropped_; }

 private:
  Status encode(std::span<const ImuSample> samples);
  void send(std::size_t samples);  // sends the samples encoded last
  Status answer_requests();

  ImuSource& source_;
  FrameDescription frame_;
  FrameEncoder encoder_;
  UnitEnd& line_;
  double speedup_;
  double patience_s_;
  double start_s_ = 0.0;
  std::uint64_t steps_ = 0;  // sample periods that have passed
  std::vector<ImuSample> samples_;
  std::vector<std::byte> bytes_;                // the samples encoded last
  std::vector<std::byte> asked_;                // bytes received that do not make a complete request yet
  std::atomic<std::uint64_t> frames_sent_ = 0;  // read by waiting callers from another thread
  std::uint64_t batches_dropped_ = 0;
  bool listener_reads_ = true;
};

}  // namespace turncal
