// An ImuSource for a unit on a line (byte_line.h: serial, TCP, UDP). It joins line, decoder and counter, and supervises them. A unit that
// answers requests with its last sample is polled in a thread of its own while the line is open; otherwise samples would be lost whenever
// the station is busy.
//
// The timeout of read() is in seconds of the unit (host seconds times speedup). One read() waits at most 20 ms of host time even if the
// timeout is longer. Thus the time when the line was last empty is known (counter_tracker.h), and a silent unit does not keep the
// station from checking for a stop.
// A second open() continues the unit's counter: a cable that was unplugged costs a gap, but keeps the numbering.
//
// read() returns an error of kind device, and the port is closed, when
//   the port was unplugged;
//   the unit's counter started again: the unit was switched off or reset, and its biases may have changed, or a short counter cannot
//   tell a reset from a loss (frame_decoder.h);
//   samples are persistently later than before by half a wrap of the counter (0.1 s without one): more samples were lost than the
//   counter can show;
//   after 10 s the sample rate differs from the description's by more than 0.2 %, or the clock is off by more than clock_max_ppm
//   plus three standard deviations.
// A unit that is silent or sends only invalid bytes gives 0 samples; the caller decides how long that may last.
// The last two of these errors are checked only if speedup is 1.
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

// Estimates the unit's clock against the host's from the times of arrival.
//
// A sample of unit time t (counter x period) arrives at host time a = offset + (1 + skew) t + delay, and delay >= 0, because line,
// adapter and host can only delay. The line  offset + (1 + skew) t  therefore lies below all points and touches the fastest. The
// estimate is the edge of their lower convex hull at the mean of t, which has the least sum of delays of all lines below the points
// (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999).
// It runs in bounded memory: it keeps the smallest delay of each second, and of these only the hull.
// A constant part of the delay is confounded with the offset. Not modelled: a variable skew (NTP slews by up to 500 ppm).

struct ArrivalEstimate {
  double offset_s = 0.0;  // host time of unit time 0, plus the smallest delay
  double skew = 0.0;      // host seconds per unit second, minus 1
  // Uncertainty of skew: the scatter of the smallest delays of the seconds, divided by the span. 0: not known yet (10 s).
  double skew_uncertainty = 0.0;
  double largest_delay_s = 0.0;  // of a sample relative to the fitted line, from 10 s on
  double span_s = 0.0;           // unit time covered by the fit
};

class ArrivalFit {
 public:
  ArrivalFit();
  void add(double unit_s, double host_s);  // unit_s must not decrease
  // Empty until two seconds with their smallest delay are known.
  std::optional<ArrivalEstimate> estimate() const;
  // Returns the smallest delay of the last 3 s relative to the line fitted before each, or 0 with too little data. It is large when
  // samples were lost unnoticed.
  double persistent_delay_s() const { return persistent_delay_s_; }
  void restart();

 private:
  struct Point {
    double unit_s;
    double late_s;  // host - unit
  };
  void close_block();

  std::vector<Point> hull_;  // from left to right, with increasing slope
  double sum_unit_s_ = 0.0;
  std::size_t blocks_ = 0;
  bool have_block_ = false;
  double block_start_s_ = 0.0;
  double first_unit_s_ = 0.0;
  Point block_{};
  std::vector<double> recent_;  // delays of the last blocks relative to the line fitted before each
  double persistent_delay_s_ = 0.0;
  std::optional<ArrivalEstimate> line_;  // fit of the last second, once it spans 10 s
  double square_sum_ = 0.0;              // of the delays of the seconds relative to the line fitted before each
  std::size_t squares_ = 0;
  double largest_delay_s_ = 0.0;
};

// ---- the unit ----

struct SerialImuSettings {
  std::string device;
  std::string unit_serial;       // set by the user for a unit that does not report it; may be empty
  bool simulated = false;        // a twin: recordings are marked as simulated
  double clock_max_ppm = 200.0;  // permitted difference between the unit's clock and the host's
  double speedup = 1.0;          // unit seconds per host second, for a twin that runs faster than real time
};

// Returns an error when the unit's clock differs from the host's by more than max_ppm at 3 sigma.
Status judge_clock(const ArrivalFit& fit, double max_ppm);

class SerialImu : public ImuSource {
 public:
  // The settings of the line are those of the frame description.
  SerialImu(const FrameDescription& frame, const SerialImuSettings& settings);

  Status open() override;
  Result<ImuIdentity> identify() override;
  void describe(RecordingInfo& info) const override;
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return decoder_.counters(); }
  void close() override;

  // Returns one line for the log: samples received and lost, errors of the line since open(), and the unit's clock against the host's.
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
  std::jthread requests_;  // polls at a fixed rate while the line is open
  FrameDecoder decoder_;
  ArrivalFit fit_;
  bool restarted_ = false;
  double empty_s_ = 0.0;  // the line was empty at this time or later
  bool backlog_ = false;  // a read returned so much that more may follow
  double backlog_s_ = 0.0;
  double line_checked_s_ = 0.0;
  std::optional<LineErrors> line_at_open_;
  LineErrors line_errors_;
  std::int64_t last_counter_ = 0;
};

// The keys imu.* of a station file: which unit is on which line (docs/imu-frames.md).
struct SerialImuConfig {
  FrameDescription frame;
  SerialImuSettings settings;
};

// An error in the frame description names its own file and line. Defects of the station file's keys are also remembered by `file`, as by
// all its getters.
Result<SerialImuConfig> read_serial_imu_config(KeyValueFile& file);

}  // namespace turncal
