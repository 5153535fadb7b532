// One unit of a run: its source, its recording, and everything that is counted for it alone. The motion, the table and the
// state machine are StationRun's, which may have several lanes on one table.
//
// - Samples are received as soon as the source gives them, and wait here until they are taken, so that no line overflows because of another
//   unit. Repeated samples are dropped on reception; two samples of one counter that differ are a defect of the present item.
// - A dwell takes exactly the planned number of samples in every lane, counted from where the lane stood when it began. Units
//   whose samples come at slightly different times complete it at different times; further samples wait for the next segment.
// - A lane that drops out is closed and does nothing any more. Its recording keeps its partial name.
// - Samples are handed to the queue as they are taken, without waiting; the next call reports that they could not be written.
//   The other steps of a recording are returned as writes, which the run has done and waits for.
//
// Counters here are those of the recording (0: its first sample) unless they are said to be the unit's own. One thread.
#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/statistics/data_screen.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/base/clock.h"
#include "imu_io/recordings/imu_source.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/run/dwell_monitor.h"
#include "orchestrator/run/motion_watch.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

struct StationUnit {
  ImuSource& imu;
  std::vector<RunSink*> sinks;  // called in this order; the first keeps the recording
  std::string serial;           // requested; a unit that reports another one is refused
};

class UnitLane {
 public:
  using Write = std::function<Status()>;  // refers to the sinks alone, not to the lane
  explicit UnitLane(StationUnit unit) : unit_(std::move(unit)) {}

  const std::string& serial() const { return unit_.serial; }
  bool alive() const { return !failure_; }
  const std::optional<Error>& failure() const { return failure_; }
  void drop(Error why);
  void close();

  // Resumes after a completed dwell. no_time_passed: the unit's next sample is the recording's next.
  void resume_at(const RecordingPoint& left, bool no_time_passed);
  void expect_gap() { gap_due_ = true; }  // the next recorded sample is the first after an interruption
  RecordingPoint point() const;           // without `written`, which the sink knows once everything so far is written
  std::uint64_t lost_samples() const { return lost_samples_; }
  std::int64_t next_sample() const { return next_sample_; }
  std::int64_t came_in_segment() const { return next_sample_ - came_before_; }  // in sample periods

  // Opens the source. Returns how the unit describes itself.
  Result<std::string> connect(const StationConfig& station, bool table_simulated, const Clock& clock);
  Write begin_recording(bool resumed) const;  // or goes on with it
  bool is_open() const { return open_; }
  double sample_period_s() const { return info_.sample_period_s; }

  // Reads up to `count` samples and returns how many came, repeated ones included. An error: the unit is gone, and the lane is closed.
  Result<std::size_t> receive(std::size_t count, double timeout_s);
  // Receives what has arrived, without waiting, while the run is busy with the table. An error is kept for trouble().
  void receive_meanwhile(double now_s);
  const std::optional<Error>& trouble() const { return trouble_; }
  std::optional<double> temperature_c() const {  // the unit's own thermometer, last reading
    const double c = have_last_sample_ ? last_sample_.temperature_c : std::numeric_limits<double>::quiet_NaN();
    return std::isfinite(c) ? std::optional(c) : std::nullopt;
  }
  bool tells_temperature() const { return info_.has_temperature; }
  void heard(double now_s) { last_sample_s_ = now_s; }
  double last_sample_s() const { return last_sample_s_; }

  struct Recorded {
    std::optional<DwellMonitor::Defect> defect;  // while dwelling
    bool gap = false;                            // samples are missing among these
    bool flagged = false;  // flagged as bad by the unit, contradictory samples, or an impossible value
    std::string what = "the unit flagged its data as bad";  // of flagged
  };
  // Moves waiting samples into the open segment, in a dwell no more than it needs; outside a segment they are dropped. An error: the
  // recording cannot be written.
  Result<Recorded> record(bool dwelling, BackgroundQueue& storage);

  // Begins a segment at the present sample. The recording gets it with its first sample, so a segment without samples (units slightly apart,
  // a defect in another one's first sample) is not written.
  void begin_segment(const Segment& segment);
  void leave_segment() { segment_.reset(); }  // what comes from now on is not recorded
  Write end_segment(SegmentKind kind, const AxisTriple& angles_deg);
  void begin_dwell(std::int64_t samples) { dwell_->start(next_sample_, samples); }
  bool dwell_complete() const { return dwell_->complete(); }
  std::int64_t dwell_remaining() const { return dwell_->remaining(); }
  // Counts the samples that wait to be taken, too: they came while the table's answer was awaited.
  bool dwell_received() const { return std::int64_t(waiting_.size()) >= dwell_remaining(); }
  // Returns why samples may be missing: "; 812 bad frames came: ..."; empty without bad frames and repeated samples.
  std::string came_instead() const;
  Write sync() const { return stored(&RunSink::sync); }
  Write finish() const { return stored(&RunSink::finish); }
  Write fits() const {
    return [sinks = unit_.sinks]() -> Status {
      for (const RunSink* sink : sinks) TRY(sink->unit_fits());
      return {};
    };
  }
  const RunSink& recording() const { return *unit_.sinks.front(); }

  FeltRate& felt() { return *felt_; }  // REQUIRES connect()
  const FeltRate& felt() const { return *felt_; }

  int repeats = 0;           // of the present dwell, caused by this unit or the table
  bool motion_lost = false;  // samples lost or flagged in the present move

 private:
  // The first failed write; its status stands in for every later write. Shared with the storage queue's thread.
  struct Stored {
    std::atomic<bool> failed{false};
    Status status;  // written before `failed`
  };
  Write stored(std::function<Status(RunSink&)> write) const;  // by each sink

  StationUnit unit_;
  std::shared_ptr<Stored> stored_ = std::make_shared<Stored>();
  std::optional<Error> failure_;
  std::optional<Error> trouble_;
  RecordingInfo info_;
  std::optional<DwellMonitor> dwell_;
  std::optional<SpikeFinder> spikes_;
  std::optional<FeltRate> felt_;
  std::vector<ImuSample> waiting_;  // counters are the unit's own
  bool open_ = false;
  std::optional<Segment> segment_;  // the open one
  bool segment_written_ = false;
  bool gap_due_ = false;
  std::optional<std::int64_t> last_received_;  // the unit's own
  ImuSample last_sample_{};                    // with that counter, as it came
  bool have_last_sample_ = false;              // false after a run was taken up
  std::optional<std::int64_t> conflict_;       // counter of two samples that differ, not yet reported
  std::optional<std::int64_t> first_counter_;  // the unit's own, of the recording's first sample
  std::int64_t next_sample_ = 0;
  std::optional<std::uint32_t> resumed_written_;  // hash that the recording must have
  std::int64_t came_before_ = 0;                  // samples recorded or waiting when the segment began
  std::uint64_t lost_samples_ = 0;                // by the unit's counter, from the first recorded sample on
  std::uint64_t duplicate_samples_ = 0;           // dropped
  double last_sample_s_ = 0.0;
};

}  // namespace turncal
