// One run of the station: walks a sequence, moves the table, captures the IMU, and calibrates.
//
// The loop pumps the IMU (reading it is what makes time pass), polls the table, turns what it sees into events, looks the
// transition up in run_state_machine, and carries the action out. It never blocks for a motion. Every decision is in the
// transition table, the arrival rule in arrival_monitor, the rule for a dwell in dwell_monitor.
//
// - The recording begins with the first item of the sequence; connecting, homing and the way to the start position are not
//   in it, and its counter starts at 0.
// - The table is polled every poll_moving_s (poll_idle_s in a dwell), and at the very sample at which a motion or settle time
//   can be over, so that a table that keeps to its profile gives the segments of planned_segments() to the sample.
// - Before any item every axis must stand where the plan says; one that does not is moved there first (roll, pitch, heading).
//   That serves the start, a table that drifted, and a run that goes on after an interruption.
// - Samples lost or flagged while the table turns stay as they are in the recording and are said in the log; the estimators
//   see the gap by the counter and deal with it (or refuse).
// - A run that goes on (StationJob::resume) begins behind its last completed dwell: it homes (or, where no time has passed,
//   verifies that the encoders are homed and stand where they did), rests for resume.rest_s, settles inside a rotate segment
//   that begins with a gap of one sample, and does what came behind that dwell.
// - On any error: stop to all axes, drives off at rest, both verified by their status; fastest stop when that fails; a lost link is tried again, for
//   the stop only. The outcome names reason and place in one line.
//
// - A pause lets the item that goes on come to its end, and homing; then the table is stopped and its drives go off, both verified
//   as above. Once everything is recorded a pause changes nothing.
//
// Not here: several units on one table. One thread; only the counts of StationHooks may be touched by others.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/recording_types.h"
#include "calib/status.h"
#include "imu_io/clock.h"
#include "imu_io/imu_source.h"
#include "orchestrator/arrival_monitor.h"
#include "orchestrator/dwell_monitor.h"
#include "orchestrator/run_journal.h"
#include "orchestrator/run_observer.h"
#include "orchestrator/run_sink.h"
#include "orchestrator/run_state_machine.h"
#include "orchestrator/station_config.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/turntable.h"

namespace turncal {

struct StationDevices {
  Turntable& table;
  ImuSource& imu;
  const Clock& clock;
  std::function<void(double seconds)> wait;  // lets time pass while the IMU cannot be read
};

// REQUIRES: plan == make_plan(sequence, plan_limits(station, period of the IMU)) and plan.ok().
struct StationJob {
  const Sequence& sequence;
  const Plan& plan;
  const StationConfig& station;
  std::string unit_serial;  // as asked for; a unit that tells another one is refused
  std::optional<ResumePoint> resume = std::nullopt;  // the sink then holds everything up to there
};

struct StationHooks {
  RunObserver* observer = nullptr;
  const std::atomic<int>* stop_requests = nullptr;  // counts the requests to stop now
  std::function<Status()> calibrate;                // after the recording is sealed; results must be durable on success
  RunJournal* journal = nullptr;
  const std::atomic<int>* pause_requests = nullptr;  // above 0: stop at the next safe point
  const std::atomic<int>* end_requests = nullptr;    // those of stop_requests that the operator did not make
};

struct RunOutcome {
  RunState state = RunState::failed;
  Error error{ErrorKind::internal, "the run did not end"};  // meaningful unless done
  std::int64_t recorded_samples = 0;    // periods, lost ones included
  int repeated_dwells = 0;
  std::uint64_t lost_samples = 0;       // by the unit's counter, from the first recorded sample on
  std::uint64_t duplicate_samples = 0;  // dropped
};

class StationRun {
 public:
  StationRun(StationDevices devices, StationJob job, RunSink& sink, StationHooks hooks);
  RunOutcome run();
  const RunOutcome& outcome() const { return outcome_; }  // so far

 private:
  using MaybeEvent = std::optional<RunEvent>;

  // One event, and those that its action raises.
  void handle(RunEvent event);
  MaybeEvent perform(RunAction action, RunEvent cause);
  // An event together with why: the first reason of a failing run is the one reported.
  RunEvent raise(RunEvent event, ErrorKind kind, const std::string& reason);
  // The table refused or failed. A driver that gave up because the operator asked for it, or is gone, is no fault of the table.
  RunEvent raise_table(RunEvent event, const Error& error, const std::string& before = "");

  MaybeEvent asked();                                   // what is newly asked for from outside
  RunEvent raise_stop();                                // by the operator, or from outside
  RunEvent pause();                                     // here and now
  bool pause_asked() const { return hooks_.pause_requests && hooks_.pause_requests->load() > 0; }

  void take_up(const ResumePoint& resume);
  bool at_rest() const;                                 // every axis, by the last status read
  bool stands_as_left() const;                          // homed, and where the completed dwell was
  MaybeEvent keep(const Status& status);                // of the journal or the recording

  MaybeEvent connect();
  MaybeEvent enable_and_home();
  MaybeEvent send_home();
  MaybeEvent begin_rest();
  MaybeEvent settle_recorded();
  MaybeEvent select_next();
  MaybeEvent issue_move();
  MaybeEvent close_move();
  MaybeEvent begin_dwell();
  MaybeEvent close_dwell();
  MaybeEvent discard_dwell();
  MaybeEvent finish_step();
  MaybeEvent calibrate();
  MaybeEvent stop_table();
  MaybeEvent abort_table();

  MaybeEvent pump();                                    // reads the IMU until the next poll is due
  MaybeEvent take(std::span<ImuSample> samples);        // new samples, counters not yet rebased
  MaybeEvent catch_up();                                // with the samples that have arrived, without waiting for more
  MaybeEvent check_motion_data(std::span<const ImuSample> samples, bool gap);
  MaybeEvent poll();                                    // reads the table and judges
  MaybeEvent read_table();                              // three tries; e-stop, faults and limits while live
  MaybeEvent judge(double now_s);
  MaybeEvent judge_dwell();
  MaybeEvent judge_homing(double now_s);
  MaybeEvent judge_stop(double now_s);
  void try_to_reconnect(double now_s);
  void schedule_poll(double now_s);

  MaybeEvent begin_segment(SegmentKind kind);
  MaybeEvent end_segment(SegmentKind kind);
  std::optional<Axis> displaced_axis() const;           // first of roll, pitch, heading that is not where it should be
  bool out_of_tolerance(Axis axis, double from_deg) const;
  std::string place() const;
  RunSnapshot snapshot() const;
  void tell_progress();

  StationDevices devices_;
  StationJob job_;
  RunSink& sink_;
  StationHooks hooks_;

  RunState state_ = RunState::idle;
  RunOutcome outcome_;
  std::optional<Error> first_error_;
  std::string detail_;             // of the event to be handled next
  ErrorKind raised_kind_ = ErrorKind::internal;
  StopCause stop_cause_ = StopCause::error;
  bool pause_told_ = false;
  bool abort_sent_ = false;
  bool drives_off_sent_ = false;
  bool home_sent_ = false;
  bool enabled_ = false;
  int stops_seen_ = 0;

  std::size_t item_ = 0;           // the next item of the plan, or the one going on
  std::size_t step_ = 0;           // index into sequence.steps
  bool item_running_ = false;      // plan.items[item_] is going on (not: a move back to where the table should stand)
  std::optional<Move> pending_move_;
  AxisTriple commanded_deg_;
  ArrivalMonitor arrival_;
  std::optional<DwellMonitor> dwell_;
  AxisTriple dwell_start_deg_;
  int repeats_ = 0;

  RecordingInfo info_;
  std::vector<ImuSample> buffer_;
  bool imu_open_ = false;
  bool recording_ = false;
  bool segment_open_ = false;
  bool motion_loss_told_ = false;              // once a move is enough
  std::optional<std::int64_t> last_counter_;   // the unit's own
  std::optional<std::int64_t> first_counter_;  // the unit's own, of the recording's first sample
  std::int64_t next_sample_ = 0;               // in the recording
  bool gap_due_ = false;                       // the next recorded sample is the first after an interruption
  double last_sample_s_ = 0.0;

  TableStatus status_{};
  double started_s_ = 0.0;
  double next_poll_s_ = 0.0;
  double phase_deadline_s_ = 0.0;
  double rest_until_s_ = 0.0;
  double reconnect_at_s_ = 0.0;
  double reconnect_wait_s_ = 0.5;
  bool link_down_ = false;
};

}  // namespace turncal
