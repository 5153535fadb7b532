// One run of the station: walks a sequence, moves the table, captures the IMU, and calibrates.
//
// The loop pumps the IMU (reading it is what makes time pass), polls the table, turns what it sees into events, looks the
// transition up in run_state_machine, and carries the action out. It never blocks for a motion. Every decision is in the
// transition table, the arrival rule in motion_watch, the rule for a dwell in dwell_monitor.
//
// - The only I/O of the loop that can block is that of the table and the units. The storage queue's thread writes journal and recordings.
//   keep() waits for what must be durable before something else happens; meanwhile the table is watched, and a stop goes out, as
//   anywhere else. A disk that does not answer within the queue's limit is a fault: storage_failed.
// - The recording begins with the first item of the sequence; connecting, homing and the way to the start position are not
//   in it, and its counter starts at 0.
// - The table is polled every poll_moving_s (poll_idle_s in a dwell), and at the very sample at which a motion or settle time
//   can be over, so that a table that keeps to its profile gives the segments of planned_segments() to the sample.
// - Before any item every axis must stand where the plan says; one that does not is moved there first (roll, pitch, heading).
//   That serves the start, a table that drifted, and a run that goes on after an interruption.
// - Samples lost or flagged while the table turns are logged, and stay in the recording as they are. Once settled, the table goes back to
//   where the move began, all of which is recorded as rotate, and the move is repeated, up to dwell.max_repeats times.
// - While the loop waits for the table's answer the units are read, so that a slow table costs no samples.
// - A run that goes on (StationJob::resume) begins after its last completed dwell: it homes (or, where no time has passed,
//   verifies that the encoders are homed and stand where they did), rests for resume.rest_s, goes back to where that dwell stood,
//   not recorded, settles inside a rotate segment that begins with a gap of one sample, and does what came after that dwell. Only a run that is
//   taken up clears a fault that a drive still shows (its watchdog stopped it when the last program died); the drive is then read again.
// - On any error: stop to all axes, drives off at rest, both verified by their status (turntable_drivers/table/table_stop.h); the
//   fastest stop when that fails or nothing can be read. The outcome names reason and place in one line.
//
// - A chamber is brought to its temperature once the table is homed, and the run rests until it has settled. It is polled with the table.
//   On a chamber fault the table stops first; then the chamber goes off, as at every end, before anything is calibrated.
//
// - A pause lets the present item, or homing, come to its end; then the table is stopped and its drives go off, both verified
//   as above. Once everything is recorded a pause changes nothing.
//
// Several units ride on one table: one motion, one journal, and for each a lane (unit_lane.h) with its own recording.
// - A unit's failure (gone, silent, not the one asked for, its recording not writable, too slow) concerns that unit alone as
//   long as another is left: it drops out, which is journalled and reported, and the others go on. The last one fails the run.
//   Whatever the table does concerns all.
// - Every living lane is read in every turn of the loop. The run waits for the first, up to the next poll, and reads the others
//   without waiting. Silence is judged lane by lane.
// - A dwell is complete when it is complete in every living lane. A defect in one repeats it for all, at once; a lane whose own defects
//   have used up dwell.max_repeats drops out instead, and the attempt goes on for the others. A table that moved repeats the
//   dwell as long as one living lane has a repeat left.
// - Units whose samples come a few samples apart need no care: the settle time lies between a move and a dwell. A unit that has
//   fallen behind the others by more than half of it since the move began is waited for before the dwell, at most imu.timeout_s,
//   because a short counter may not tell what was lost.
//
// One thread, but for the queue's; only the counts of StationHooks may be touched by others.
#pragma once

#include <algorithm>
#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/clock.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/run/chamber_watch.h"
#include "orchestrator/run/motion_watch.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/run/run_state_machine.h"
#include "orchestrator/run/unit_lane.h"
#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/table/table_stop.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

struct StationDevices {
  Turntable& table;
  ImuSource& imu;  // of the first place; a run of several units has one source each
  const Clock& clock;
  std::function<void(double seconds)> wait;  // lets time pass while the IMU cannot be read
  ChamberKeeper* chamber = nullptr;          // around the unit; null: none, or the run leaves it alone
};

// REQUIRES: plan == make_plan(sequence, plan_limits(station, period of the IMU)) and plan.ok().
struct StationJob {
  const Sequence& sequence;
  const Plan& plan;
  const StationConfig& station;
  std::optional<ResumePoint> resume = std::nullopt;  // the sinks then hold everything up to that point
  bool taken_up = false;  // resumes an interrupted run: a fault that a drive still shows is cleared
  std::optional<double> temperature_c = std::nullopt;  // of the chamber, where there is one
};

struct RunOutcome {
  RunState state = RunState::failed;
  Error error{ErrorKind::internal, "the run did not end"};  // meaningful unless done
  int repeated_dwells = 0;
  int repeated_moves = 0;              // of this session
  bool moved = false;                  // the table was homed or sent somewhere
  std::optional<TableStatus> left;     // last reading of every axis, verified at rest with its drive off
  bool stop_failed = false;            // not verified in time: the table may move, its drives may be on
  bool storage_hangs = false;          // the queue is not empty: journal and recordings must not be touched
  struct Unit : RecordingPoint {       // where its recording ends
    std::optional<Error> dropped_out;  // before the end
  };
  std::vector<Unit> units;  // as given
};

struct StationHooks {
  std::vector<RunObserver*> observers;              // called in the loop: they must not block
  const std::atomic<int>* stop_requests = nullptr;  // counts the requests to stop now
  // Called after the recording is sealed; results must be durable on success. RunOutcome, here and below: how far the run has come.
  std::function<Status(const RunOutcome&)> calibrate;
  RunJournal* journal = nullptr;
  const std::atomic<int>* pause_requests = nullptr;  // when above 0, the run stops at the next safe point
  const std::atomic<int>* end_requests = nullptr;    // those of stop_requests that the operator did not make
  // Returns hashes of the recordings' contents, by unit, once they are complete; the journal keeps them before the recordings are sealed.
  std::function<Result<std::vector<std::string>>(const RunOutcome&)> content_hashes = nullptr;
  // Called after every completed dwell until it answers: which item comes next. next_item is the plan's. A later one skips
  // what lies between, items.size() ends the run, an earlier one repeats the dwell. Before it answers it may append steps to
  // sequence and plan. Between two calls samples are read and the table is watched.
  std::function<Result<std::optional<std::size_t>>(std::size_t next_item, const RunOutcome&)> go_on_with = nullptr;
  // Checks that the files written beside the recordings are still in place and unchanged; the queue calls it every second.
  std::function<Status()> check_kept = nullptr;
  // Writes journal and recordings, in order. Null: within the loop, for simulated time. Journal and sinks outlive it.
  BackgroundQueue* storage = nullptr;
};

// Returns why something was given up: ended from outside, or stopped by the operator.
Error asked_to_stop(bool ended);

class StationRun {
 public:
  StationRun(StationDevices devices, StationJob job, const std::vector<StationUnit>& units, StationHooks hooks);
  RunOutcome run();

 private:
  RunOutcome outcome() const;  // so far
  using MaybeEvent = std::optional<RunEvent>;

  // Handles one event, and the events that its actions raise.
  void handle(RunEvent event);
  MaybeEvent take(RunEvent now);  // handles one; returns the event that its action raises
  MaybeEvent perform(RunAction action, RunEvent cause);
  // Raises an event with its reason. A failing run reports its first reason.
  RunEvent raise(RunEvent event, const Error& why);
  RunEvent raise(RunEvent event, const std::string& reason) { return raise(event, device_error(reason)); }
  MaybeEvent fault_of(const std::optional<std::string>& said);  // table_fault with that text; none without one
  // The table refused or failed. A driver that gave up because the operator asked it to, or is gone, is no fault of the table.
  RunEvent raise_table(RunEvent event, const Error& error, const std::string& before = "");
  MaybeEvent taken(const Status& command, const std::string& what);  // error from the table; `what`: "homing: "
  // Fails one unit: it drops out, or the run fails with it when no other is left.
  MaybeEvent fail(UnitLane& lane, RunEvent event, const Error& error);
  // Takes a step of the recording in every living lane and waits for it; returns `event` where it fails.
  MaybeEvent in_every_lane(RunEvent event, const std::function<UnitLane::Write(UnitLane&)>& step);
  RunEvent not_stored() const;  // the event for a failed write, depending on the state
  bool asked_to_stop_anew() const { return hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_; }
  bool in(StateSet states) const { return states.contains(state_); }
  template <class Holds>
  bool any_living(Holds holds) const {
    return std::ranges::any_of(lanes_, [&](const UnitLane& lane) { return lane.alive() && holds(lane); });
  }
  std::string named(const UnitLane& lane, const std::string& text) const;  // "unit SN2: ..." where there are several

  MaybeEvent asked();     // requests newly come from outside
  RunEvent raise_stop();  // by the operator, or from outside
  RunEvent pause();       // here and now
  bool pause_asked() const { return hooks_.pause_requests && hooks_.pause_requests->load() > 0; }

  void resume_at(const ResumePoint& resume);
  bool table_stands() const;              // every axis, by the last status read
  MaybeEvent kept(const Status& status);  // of journal or recording
  // Hands a write to the queue and waits for it. Returns an event when it failed, or when something else came first.
  MaybeEvent keep(std::function<Status()> write);
  MaybeEvent journalled(std::function<Status(RunJournal&)> write);  // likewise, where there is a journal
  MaybeEvent look_at_storage();                                     // it answers, and what was written is still there
  MaybeEvent look_around();  // while keep() waits: stop requests, units, table, disk

  MaybeEvent connect();
  MaybeEvent enable_and_home();
  MaybeEvent send_home();
  void homing_ends_in(double seconds);  // unless a person turns the table
  MaybeEvent begin_rest();
  MaybeEvent settle_again(bool in_place);
  MaybeEvent select_next();
  MaybeEvent leave_out();  // skips items that are not needed any more
  MaybeEvent issue_move();
  MaybeEvent close_move();
  MaybeEvent begin_dwell();
  MaybeEvent close_dwell();
  MaybeEvent discard_dwell();
  MaybeEvent discard_move();
  void forget_repeats();
  MaybeEvent finish_step();
  MaybeEvent calibrate();
  MaybeEvent stop_table();
  // Returns the time allowed for a braking stop: twice the ramp of the plan's fastest move, plus motion.stall_s.
  double brake_s() const;

  void receive_meanwhile();  // reads the units while the table's answer is awaited
  MaybeEvent pump();         // reads the IMU until the next poll is due
  UnitLane* lead();          // the lane that the run waits for; null: none is open
  MaybeEvent record_all();   // records what the lanes have received; is the dwell complete?
  MaybeEvent record(UnitLane& lane);
  bool apart() const;                      // a unit is so late that its next samples may still belong to the move
  MaybeEvent receive_all(UnitLane& lane);  // all that has arrived, without waiting for more
  MaybeEvent catch_up();                   // with the samples that have arrived, without waiting for more
  MaybeEvent poll();                       // reads the table and judges
  MaybeEvent read_table();                 // three tries; e-stop, faults and limits while live
  MaybeEvent judge(double now_s);
  MaybeEvent judge_dwell();
  std::vector<const FeltRate*> felt() const;  // of each unit that is alive
  MaybeEvent judge_move();
  MaybeEvent judge_motion();  // axes that turn although not sent, or faster than sent
  MaybeEvent judge_defect(UnitLane& lane, const DwellMonitor::Defect& defect);
  MaybeEvent judge_homing(double now_s);
  MaybeEvent judge_stop(double now_s);
  MaybeEvent look_at_chamber();
  bool chamber_rests() const;  // off and read back, or none
  void leave_chamber();
  void schedule_poll(double now_s);
  void hold();  // from now on the axes stay where they were last seen, except the one that is sent

  void begin_segment(SegmentKind kind);
  MaybeEvent end_segment(SegmentKind kind);
  std::optional<Axis> displaced_axis() const;  // first of roll, pitch, heading that is not where it should be
  bool out_of_tolerance(Axis axis, double from_deg) const;
  std::string place() const;
  RunSnapshot snapshot() const;
  void tell_progress();

  BackgroundQueue in_the_loop_{BackgroundQueue::By::caller};
  BackgroundQueue& storage_;
  StationDevices devices_;
  StationJob job_;
  StationHooks hooks_;
  std::vector<UnitLane> lanes_;

  RunState state_ = RunState::idle;
  RunOutcome outcome_;  // so far, without state, error and units
  std::optional<Error> first_error_;
  std::string detail_;  // of the event to be handled next
  ErrorKind raised_kind_ = ErrorKind::internal;
  RunGuard stop_cause_ = RunGuard::by_error;
  bool pause_told_ = false;
  bool home_sent_ = false;
  std::optional<HomingWatch> homing_;
  bool fault_left_ = false;
  bool enabled_ = false;
  int stops_seen_ = 0;

  std::size_t item_ = 0;           // the next item of the plan, or the one going on
  std::size_t step_ = 0;           // index into sequence.steps
  std::size_t asked_of_item_ = 0;  // item for which go_on_with has answered
  bool item_running_ = false;      // plan.items[item_] is going on (not: a move back to where the table should stand)
  std::optional<Move> pending_move_;
  AxisTriple commanded_deg_;
  AxisTriple held_deg_;  // where the axes stood when the present move, rest or settling began
  ArrivalMonitor arrival_;
  SpeedWatch speed_;
  double asked_s_ = 0.0, answered_s_ = 0.0;  // around the last reading of the table
  TableStop stop_;
  AxisTriple dwell_start_deg_;
  int repeats_ = 0;               // of the present dwell or move
  UnitLane* bad_lane_ = nullptr;  // whose defect repeats it; null: the table moved

  bool recording_ = false;
  bool unit_awaited_ = false;   // settled, but for a unit that is behind
  double await_until_s_ = 0.0;  // then it goes on without; a bad dwell is repeated
  bool rest_due_ = false;       // the run goes on after an interruption in which time passed

  TableStatus status_{};
  double started_s_ = 0.0;
  std::optional<PendingWrite> check_;  // the check under way
  double next_check_s_ = 0.0;
  double next_poll_s_ = 0.0;
  double phase_deadline_s_ = 0.0;
  double rest_until_s_ = 0.0;
  double rest_began_s_ = 0.0;
  double chamber_until_s_ = 0.0;  // deadline for the chamber to read off
  bool unread_ = false;
  bool angles_known_ = false;  // all axes were read at least once
};

}  // namespace turncal
