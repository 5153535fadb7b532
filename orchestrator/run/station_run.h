// One run of the station: walks a sequence, moves the table, captures the IMU, and calibrates.
//
// The loop pumps the IMU (reading it is what makes time pass), polls the table, turns what it sees into events, looks the
// transition up in run_state_machine, and carries the action out. It never blocks for a motion. Every decision is in the
// transition table, the arrival rule in motion_watch, the rule for a dwell in dwell_monitor.
//
// - The loop does no I/O that can block but the table's and the units' own. Journal and recordings are written by the storage queue's thread.
//   What must be durable before something else happens is waited for in keep(), where the table is watched on, and a stop goes out, as
//   anywhere else. A disk that does not answer within the queue's limit is a fault: storage_failed.
// - The recording begins with the first item of the sequence; connecting, homing and the way to the start position are not
//   in it, and its counter starts at 0.
// - The table is polled every poll_moving_s (poll_idle_s in a dwell), and at the very sample at which a motion or settle time
//   can be over, so that a table that keeps to its profile gives the segments of planned_segments() to the sample.
// - Before any item every axis must stand where the plan says; one that does not is moved there first (roll, pitch, heading).
//   That serves the start, a table that drifted, and a run that goes on after an interruption.
// - Samples lost or flagged while the table turns are said in the log, and stay in the recording as they are. Once it has settled the
//   table goes back to where the move began, all of that recorded as rotate, and the move is made again, dwell.max_repeats times.
// - While the table's answer is awaited the units are read: a slow table costs no samples.
// - A run that goes on (StationJob::resume) begins after its last completed dwell: it homes (or, where no time has passed,
//   verifies that the encoders are homed and stand where they did), rests for resume.rest_s, goes back to where that dwell stood,
//   not recorded, settles inside a rotate segment that begins with a gap of one sample, and does what came after that dwell. A run that is taken up clears a fault that a drive
//   still shows (its watchdog stopped it when the last program died); what the drive says then decides. No other run does.
// - On any error: stop to all axes, drives off at rest, both verified by their status (turntable_drivers/table/table_stop.h); the
//   fastest stop when that fails or nothing can be read. The outcome names reason and place in one line.
//
// - A chamber is brought to its temperature when the table is homed, and the run rests until it has settled. It is polled with the table. Its faults
//   stop the table first, and then it goes off, told again until it is read back. So it goes at every end, before anything is calibrated.
//
// - A pause lets the item that goes on come to its end, and homing; then the table is stopped and its drives go off, both verified
//   as above. Once everything is recorded a pause changes nothing.
//
// Several units ride on one table: one motion, one journal, and for each a lane (unit_lane.h) with its own recording.
// - What befalls a unit (gone, silent, another one than asked for, its recording not writable, too slow) is that unit's alone as
//   long as another is left: it drops out, which is journalled and told, and the others go on. The last one fails the run. What
//   the table does concerns all.
// - Every living lane is read in every turn: the first that the run waits for with the time until the next poll, the others
//   without waiting. Silence is judged lane by lane.
// - A dwell is complete when it is in every living lane. A defect in one repeats it for all, at once; a lane whose own defects
//   have used up dwell.max_repeats drops out instead, and the attempt goes on for the others. A table that moved repeats the
//   dwell as long as one living lane has a repeat left.
// - Units whose samples come a few samples apart need no care: the settle time lies between a move and a dwell. One that has
//   fallen behind the others by more than half of it since the move began is waited for before the dwell, imu.timeout_s
//   at most: a counter that is short may not tell what was lost.
//
// One thread, but for the queue's; only the counts of StationHooks may be touched by others.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
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
  ImuSource& imu;  // of the first place; a run of several units is given each of them
  const Clock& clock;
  std::function<void(double seconds)> wait;  // lets time pass while the IMU cannot be read
  ChamberKeeper* chamber = nullptr;          // about the unit; null: none, or the run leaves it alone
};

// REQUIRES: plan == make_plan(sequence, plan_limits(station, period of the IMU)) and plan.ok().
struct StationJob {
  const Sequence& sequence;
  const Plan& plan;
  const StationConfig& station;
  std::optional<ResumePoint> resume = std::nullopt;  // the sinks then hold everything up to there
  bool taken_up = false;  // somebody goes on with an interrupted run: a fault that a drive still shows is cleared
  std::optional<double> temperature_c = std::nullopt;  // of the chamber, where there is one
};

struct RunOutcome {
  RunState state = RunState::failed;
  Error error{ErrorKind::internal, "the run did not end"};  // meaningful unless done
  int repeated_dwells = 0;
  int repeated_moves = 0;           // of this session
  bool moved = false;               // the table was homed or sent somewhere
  std::optional<TableStatus> left;  // as every axis read when it was verified that it rests with its drives off
  bool stop_failed = false;         // could not be verified in its time: the table may move, its drives may be on
  bool storage_hangs =
      false;  // what was handed to the queue is not all done: journal and recordings must not be touched
  struct Unit : RecordingPoint {       // where its recording ends
    std::optional<Error> dropped_out;  // before the end
  };
  std::vector<Unit> units;  // as given
};

struct StationHooks {
  std::vector<RunObserver*> observers;              // called in the loop: they must not block
  const std::atomic<int>* stop_requests = nullptr;  // counts the requests to stop now
  // After the recording is sealed; results must be durable on success. RunOutcome, here and below: how far the run has come.
  std::function<Status(const RunOutcome&)> calibrate;
  RunJournal* journal = nullptr;
  const std::atomic<int>* pause_requests = nullptr;  // above 0: stop at the next safe point
  const std::atomic<int>* end_requests = nullptr;    // those of stop_requests that the operator did not make
  // Of the contents of the recordings, by unit, when nothing more comes: what the journal keeps before they are sealed.
  std::function<Result<std::vector<std::string>>(const RunOutcome&)> content_hashes = nullptr;
  // Asked after every completed dwell, again and again until it answers: which item comes next. next_item is the one that the plan
  // has there; a later one leaves out what lies between, items.size() ends the run, an earlier one repeats the dwell. Before it answers it
  // may put further steps behind those of sequence and plan. Samples are read and the table is watched between two calls.
  std::function<Result<std::optional<std::size_t>>(std::size_t next_item, const RunOutcome&)> go_on_with = nullptr;
  // Whether what is written beside the recordings is still where and as it was written; asked by the queue every second.
  std::function<Status()> check_kept = nullptr;
  // Writes journal and recordings, in the order of what happens. Null: within the loop, for simulated time. Journal and sinks outlive it.
  BackgroundQueue* storage = nullptr;
};

// Why something was given up: told to end from outside, or stopped by the operator.
Error asked_to_stop(bool ended);

class StationRun {
 public:
  StationRun(StationDevices devices, StationJob job, const std::vector<StationUnit>& units, StationHooks hooks);
  RunOutcome run();

 private:
  RunOutcome outcome() const;  // so far
  using MaybeEvent = std::optional<RunEvent>;

  // One event, and those that its action raises.
  void handle(RunEvent event);
  MaybeEvent take(RunEvent now);  // one; the event that its action raises
  MaybeEvent perform(RunAction action, RunEvent cause);
  // An event together with why: the first reason of a failing run is the one reported.
  RunEvent raise(RunEvent event, const Error& why);
  RunEvent raise(RunEvent event, const std::string& reason) { return raise(event, device_error(reason)); }
  MaybeEvent fault_of(const std::optional<std::string>& said);  // of the table; nothing was said: none
  // The table refused or failed. A driver that gave up because the operator asked for it, or is gone, is no fault of the table.
  RunEvent raise_table(RunEvent event, const Error& error, const std::string& before = "");
  MaybeEvent taken(const Status& command, const std::string& what);  // by the table; "homing: "
  // Of one unit: it drops out, or the run fails with it where no other is left.
  MaybeEvent fail(UnitLane& lane, RunEvent event, const Error& error);
  // A step of the recording, in every living lane, waited for; `event` where it fails.
  MaybeEvent in_every_lane(RunEvent event, const std::function<UnitLane::Write(UnitLane&)>& step);
  RunEvent not_stored() const;  // the event of a recording or a journal that cannot be written, as the state has it
  bool asked_to_stop_anew() const { return hooks_.stop_requests && hooks_.stop_requests->load() > stops_seen_; }
  bool in(StateSet states) const { return states.contains(state_); }
  template <class Holds>
  bool any_living(Holds holds) const {
    return std::ranges::any_of(lanes_, [&](const UnitLane& lane) { return lane.alive() && holds(lane); });
  }
  std::string named(const UnitLane& lane, const std::string& text) const;  // "unit SN2: ..." where there are several

  MaybeEvent asked();     // what is newly asked for from outside
  RunEvent raise_stop();  // by the operator, or from outside
  RunEvent pause();       // here and now
  bool pause_asked() const { return hooks_.pause_requests && hooks_.pause_requests->load() > 0; }

  void resume_at(const ResumePoint& resume);
  bool table_stands() const;              // every axis, by the last status read
  MaybeEvent kept(const Status& status);  // of the journal or the recording
  // Hands a write to the queue and waits until it is done. An event: it failed, or something else came first.
  MaybeEvent keep(std::function<Status()> write);
  MaybeEvent journalled(std::function<Status(RunJournal&)> write);  // likewise, where there is a journal
  MaybeEvent look_at_storage();                                     // it answers, and what was written is kept
  MaybeEvent look_around();  // while that is waited for: stop requests, units, the table, the disk

  MaybeEvent connect();
  MaybeEvent enable_and_home();
  MaybeEvent send_home();
  void homing_ends_in(double seconds);  // unless a person turns the table
  MaybeEvent begin_rest();
  MaybeEvent settle_again(bool in_place);
  MaybeEvent select_next();
  MaybeEvent leave_out();  // what need not be done any more
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
  // What a braking stop may take: twice the ramp of the plan's fastest move, and motion.stall_s.
  double brake_s() const;

  void receive_meanwhile();  // what the units send while the table's answer is awaited
  MaybeEvent pump();         // reads the IMU until the next poll is due
  UnitLane* lead();          // the lane that the run waits for; null: none is open
  MaybeEvent record_all();   // what the lanes have received; is the dwell complete?
  MaybeEvent record(UnitLane& lane);
  bool apart() const;                      // a unit's samples are so late that some may be from the move
  MaybeEvent receive_all(UnitLane& lane);  // that has arrived, without waiting for more
  MaybeEvent catch_up();                   // with the samples that have arrived, without waiting for more
  MaybeEvent poll();                       // reads the table and judges
  MaybeEvent read_table();                 // three tries; e-stop, faults and limits while live
  MaybeEvent judge(double now_s);
  MaybeEvent judge_dwell();
  std::vector<const FeltRate*> felt() const;  // of each unit that is alive
  MaybeEvent judge_move();
  MaybeEvent judge_motion();  // axes that turn although nothing sent them, or faster than they were
  MaybeEvent judge_defect(UnitLane& lane, const DwellMonitor::Defect& defect);
  MaybeEvent judge_homing(double now_s);
  MaybeEvent judge_stop(double now_s);
  MaybeEvent look_at_chamber();
  bool chamber_rests() const;  // off and read back, or none
  void leave_chamber();
  void schedule_poll(double now_s);
  void hold();  // from here on the axes stay where they were last seen, but for the one that is sent

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
  RunOutcome outcome_;  // so far, but for its state, its error and its units
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
  std::size_t asked_of_item_ = 0;  // whether it, or a later one, comes next
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
  std::optional<PendingWrite> check_;  // that goes on
  double next_check_s_ = 0.0;
  double next_poll_s_ = 0.0;
  double phase_deadline_s_ = 0.0;
  double rest_until_s_ = 0.0;
  double rest_began_s_ = 0.0;
  double chamber_until_s_ = 0.0;  // told to go off: then it counts as not verified
  bool unread_ = false;
  bool angles_known_ = false;  // all were read once
};

}  // namespace turncal
