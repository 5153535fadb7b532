// The unit's side of a serial line: takes samples of any ImuSource (the rig) and sends them as frames, paced by the clock.
//
// pump(now) sends what a unit that runs `speedup` times faster than the clock would have sent by `now`; the source's time
// passes by as much. As on a real line, what nobody listens to or does not read in time is lost, while time goes on.
// Of a unit that answers requests every one that has come is answered with the last sample: the same bytes until the next one.
// In time: within patience_s of the host. A line's buffer that lasts half a second at a unit's pace lasts a fiftieth of that at 50 times
// the pace, so a faster twin needs more patience; what its time fell behind meanwhile it catches up.
// Errors: kind input where source and frame do not fit (period, increments, pulse weight), or a sample does not fit the frame.
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
  // Opens the source; unit time 0 is at now_s of the monotonic clock.
  Status start(double now_s);
  // How many samples' time has passed.
  Result<std::size_t> pump(double now_s);
  std::uint64_t frames_sent() const { return frames_sent_; }  // to the kernel, or to nobody
  std::uint64_t batches_dropped() const { return batches_dropped_; }

 private:
  Status encode(std::span<const ImuSample> samples);
  void send(std::size_t samples);  // what was encoded last
  Status answer_requests();

  ImuSource& source_;
  FrameDescription frame_;
  FrameEncoder encoder_;
  UnitEnd& line_;
  double speedup_;
  double patience_s_;
  double start_s_ = 0.0;
  std::uint64_t steps_ = 0;  // periods that have passed
  std::vector<ImuSample> samples_;
  std::vector<std::byte> bytes_;                // of what was encoded last
  std::vector<std::byte> asked_;                // what has come and is no whole request yet
  std::atomic<std::uint64_t> frames_sent_ = 0;  // read by who waits for them, from another thread
  std::uint64_t batches_dropped_ = 0;
  bool listener_reads_ = true;
};

}  // namespace turncal
