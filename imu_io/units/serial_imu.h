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
#include <vector>

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_decoder.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/lines/byte_line.h"
#include "imu_io/recordings/imu_source.h"

namespace turncal {

// The unit's clock against the host's, from when samples arrived.
//
// A sample of unit time t (counter x period) arrives at host time a = offset + (1 + skew) t + delay with delay >= 0: the line, the
// adapter and the host only ever add. So the line  offset + (1 + skew) t  lies below all points and touches the fastest, and the
// best one is the edge of their lower convex hull over the mean of t (Moon, Skelly and Towsley, "Estimation and removal of clock
// skew from network delay measurements", INFOCOM 1999: it has the least sum of delays of all lines below the points).
// Streaming: the smallest delay of each second is kept, and of these the hull. Memory is bounded.
// What is constant in the delay cannot be told from offset. Not modelled: a skew that changes (NTP slews by up to 500 ppm).

struct ArrivalEstimate {
  double offset_s = 0.0;  // host time of unit time 0, less the smallest delay's worth
  double skew = 0.0;      // host seconds a unit second, less 1
  // What the fastest samples of each second scatter by, over the span: about how far off skew may be. 0: not known yet (10 s).
  double skew_uncertainty = 0.0;
  double largest_delay_s = 0.0;  // of a sample, beyond the fastest; counted from the first 10 s on
  double span_s = 0.0;           // unit time that was fitted
};

class ArrivalFit {
 public:
  ArrivalFit();
  void add(double unit_s, double host_s);  // unit_s must not go back
  // Empty before 2 s.
  std::optional<ArrivalEstimate> estimate() const;
  // By how much the samples of at least the last 3 s were later than the estimate of all before them, at the least; 0 when
  // there is too little to tell. A unit that lost time for good shows here.
  double persistent_delay_s() const { return persistent_delay_s_; }
  void restart();

 private:
  struct Point {
    double unit_s;
    double late_s;  // host - unit
  };
  void close_block();

  std::vector<Point> hull_;  // left to right, slopes rising
  double sum_unit_s_ = 0.0;
  std::size_t blocks_ = 0;
  bool have_block_ = false;
  double block_start_s_ = 0.0;
  double first_unit_s_ = 0.0;
  Point block_{};
  std::vector<double> recent_;  // delays of the last blocks, against the estimate before each
  double persistent_delay_s_ = 0.0;
  std::optional<ArrivalEstimate> line_;  // as of the last second, once it spans 10 s
  double square_sum_ = 0.0;              // of the seconds' delays, against the line before each
  std::size_t squares_ = 0;
  double largest_delay_s_ = 0.0;
};

// ---- the unit ----

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
