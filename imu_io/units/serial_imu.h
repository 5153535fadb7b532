// A unit on a line (byte_line.h: serial, TCP, UDP) as an ImuSource: line, decoder, counter and the watch over both. A unit that answers
// requests with its last sample is asked all the while that it is open, beside whoever reads: else the samples in between were gone while the
// station is busy.
//
// read()'s timeout is in seconds of the unit (of the host, times speedup). It waits for at most 20 ms of the host even if the timeout
// is longer: so it is known when the line was last empty (counter_tracker.h), and a silent unit does not keep the station from
// looking for a stop.
// After open() the unit's counter goes on where it was: a cable that was pulled and put back costs a gap, not the numbering.
//
// read() is an error of kind device, and the port is closed, when
//   the port was unplugged;
//   the unit's counter began anew: it was switched off or reset, and its biases may be others now; or a short counter cannot tell
//   a reset from a loss (frame_decoder.h);
//   samples come persistently later than before by half a wrap of the counter (0.1 s without one): more was lost than the
//   counter can tell;
//   after 10 s, samples come at another rate than the description says, by more than 0.2 %, or by more than clock_max_ppm and three
//   times what that is known to.
// A unit that is silent, or sends only rubbish, gives 0 samples: how long that may last is for the caller to say.
// The last two are not judged with speedup other than 1.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <thread>

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_decoder.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/lines/byte_line.h"
#include "imu_io/recordings/imu_source.h"
#include "imu_io/units/arrival_fit.h"

namespace turncal {

struct SerialImuSettings {
  std::string device;
  std::string unit_serial;       // of a unit that does not tell; may be empty
  bool simulated = false;        // a twin: recordings are marked
  double clock_max_ppm = 200.0;  // by how much the unit's clock may differ from the host's
  double speedup = 1.0;          // seconds of the unit a second of the host: for a twin that runs faster than time
};

// An error where the unit's clock is surely further off the host's than that.
Status judge_clock(const ArrivalFit& fit, double max_ppm);

class SerialImu : public ImuSource {
 public:
  // The line's settings are the frame's own.
  SerialImu(const FrameDescription& frame, const SerialImuSettings& settings);

  Status open() override;
  Result<ImuIdentity> identify() override;
  void describe(RecordingInfo& info) const override;
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return decoder_.counters(); }
  void close() override;

  // For the log, in one line: what came and what did not, the line's own errors since open(), and the unit's clock against the host's.
  std::string summary() const;
  std::optional<ArrivalEstimate> clock() const { return fit_.estimate(); }

 private:
  std::size_t read_decoded(std::span<ImuSample> out);
  Result<std::size_t> receive(double timeout_s);
  void count_line_errors(double now_s);
  Status judge_arrivals() const;
  Error lost(const std::string& why);

  FrameDescription frame_;
  SerialImuSettings settings_;
  ByteLine port_;
  std::jthread requests_;  // asks at a fixed pace: begun and ended with the line
  FrameDecoder decoder_;
  ArrivalFit fit_;
  bool restarted_ = false;
  double empty_s_ = 0.0;  // the line was empty then, or later
  bool backlog_ = false;  // so much was there at once that more may have come after it
  double backlog_s_ = 0.0;
  double line_checked_s_ = 0.0;
  std::optional<LineErrors> line_at_open_;
  LineErrors line_errors_;
  std::int64_t last_counter_ = 0;
};

// The keys imu.* of a station file, which say which unit is on which line (docs/imu-frames.md).
struct SerialImuConfig {
  FrameDescription frame;
  SerialImuSettings settings;
};

// An error of the frame description is returned with its own file and line; defects of the station file's keys also stay with
// `file`, as with all its getters.
Result<SerialImuConfig> read_serial_imu_config(KeyValueFile& file);

}  // namespace turncal
