// What must hold whatever happens, over random sequences of events, shrunk to the shortest that fails (rapidcheck).
//
// First the transition table alone, then the real run on the rig: faults of table, unit, disk and operator, kills in between,
// and the run taken up again until it is done.
#include <rapidcheck.h>

#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

constexpr const char* ten_thousand = "max_success=10000 seed=20260101";

// rapidcheck takes its settings from the environment only.
template <class Testable>
void check_ten_thousand(const char* what, Testable testable) {
  ::setenv("RC_PARAMS", ten_thousand, 0);  // another seed may be given from outside
  EXPECT_TRUE(rc::check(what, testable)) << what;
}

TEST(RunProperties, TransitionTable) {
  check_ten_thousand("the table never leaves two moves outstanding, a stop unverified, or a result not durable", [] {
    constexpr int event_count = int(enum_words<RunEvent>.size());
    const auto events =
        *rc::gen::container<std::vector<int>>(rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, event_count * 12)));
    RunState state = RunState::idle;
    bool move_outstanding = false, stop_outstanding = false, sealed = false, results_durable = false;
    for (const int drawn : events) {
      const auto event = static_cast<RunEvent>(drawn % event_count);
      const int bits = drawn / event_count;
      constexpr RunGuard causes[] = {RunGuard::by_error, RunGuard::by_operator, RunGuard::by_interruption};
      const GuardSet guards = guards_of((bits & 1) != 0, (bits & 2) != 0, causes[bits / 4 % 3]);
      const Transition t = next(state, event, guards);
      if (is_final(state)) {
        RC_ASSERT(t.to == state);
        RC_ASSERT(t.action == RunAction::none);
      }
      if (t.outcome == Transition::Outcome::ignored) {
        RC_ASSERT(t.to == state);
        continue;
      }
      switch (t.action) {
        case RunAction::issue_move:
          RC_ASSERT(!move_outstanding);
          RC_ASSERT(!stop_outstanding);
          move_outstanding = true;
          break;
        case RunAction::close_move: move_outstanding = false; break;
        case RunAction::begin_dwell:
        case RunAction::enable_and_home: RC_ASSERT(!move_outstanding); break;
        case RunAction::stop_table:
        case RunAction::abort_table: stop_outstanding = true; break;
        case RunAction::calibrate:
          RC_ASSERT(!stop_outstanding || event == RunEvent::stopped_verified);
          sealed = true;
          break;
        default: break;
      }
      if (event == RunEvent::stopped_verified) stop_outstanding = move_outstanding = false;
      if (state == RunState::calibrating && event == RunEvent::calibration_ok) results_durable = true;
      // With the drives on, the only ways out are a verified stop, or one that could not be verified in its time.
      if (is_final(t.to) && (live_states.contains(state) || state == RunState::stopping)) {
        RC_ASSERT(state == RunState::stopping || (state == RunState::parking && event == RunEvent::deadline));
        RC_ASSERT(event == RunEvent::stopped_verified || event == RunEvent::deadline);
      }
      if (t.to == RunState::done && state != RunState::done) RC_ASSERT(sealed && results_durable);
      // A pause leaves a move, a dwell and homing alone, and never ends a run without a stop.
      if (event == RunEvent::pause_wanted && t.outcome == Transition::Outcome::taken)
        RC_ASSERT(t.to == state || (t.action == RunAction::stop_table && !move_outstanding));
      state = t.to;
    }
  });
}

// --- The run itself ---

struct Killed {};

const char* const tiny_text =
    "format = 1\nname = tiny\nrate_degps = 40\nacceleration_degps2 = 80\n"
    "step 1\n  initial H 0 P 0 R 0\n  align 200\n  rotate P +20\n  dwell 200\n  rotate R -20\n  dwell 200\n"
    "step 2\n  initial H 10 P 0 R 0\n  align 200\n  dwell 200\n";

struct Disturbance {
  int kind =
      0;  // of RigFault, then: operator stops, journal fails, sink fails, killed at a journal record, paused, ended
  int moment = 0;  // in tenths of a second, or calls
  int axis = 0;
};
std::ostream& operator<<(std::ostream& out, const Disturbance& d) {
  constexpr int faults = int(RigFaultKind::link_lost) + 1;
  const char* const others[] = {"operator stops", "journal fails", "disk fails", "killed", "paused", "ended"};
  return out << (d.kind < faults ? to_string(static_cast<RigFaultKind>(d.kind)) : others[d.kind - faults]) << " at "
             << d.moment << " axis " << d.axis;
}
constexpr int fault_kinds = int(RigFaultKind::link_lost) + 1;
constexpr int disturbance_kinds = fault_kinds + 6;

RigFault fault_of(const Disturbance& d, double period_s) {
  RigFault fault{.kind = static_cast<RigFaultKind>(d.kind), .time_s = 0.1 * d.moment};
  fault.sample = std::int64_t(fault.time_s / period_s);
  fault.duration_s = 0.5;
  fault.axis = d.axis;
  fault.count = 3;
  fault.size = fault.kind == RigFaultKind::gyro_glitch ? 10.0 : 0.5;
  return fault;
}

struct Tally {
  int sessions = 0, kills = 0, pauses = 0;
};

// Runs and takes up again until done; what went wrong, or "".
std::string run_with(const std::vector<Disturbance>& disturbances, Tally& tally) {
  RigConfig config = default_rig_config();
  config.sample_period_s = 0.02;
  config.table.home_time_s = 0.1;
  for (const Disturbance& d : disturbances)
    if (d.kind < fault_kinds) config.faults.push_back(fault_of(d, config.sample_period_s));
  if (const Status status = check(config); !status) return status.error().message;
  RigStation s(tiny_text, config);
  TestJournal& journal = s.kept;
  int calls = 0, kill_at = -1, fail_at = -1;
  journal.on_call = [&] {
    if (++calls == kill_at) throw Killed{};
    return calls == fail_at ? Status(device_error("journal: disk full (on demand)")) : Status();
  };
  FrontTable table(s.devices.table);
  bool two_moves = false, unrecorded = false;
  table.on_sent = [&](Axis axis, double target_deg) {
    for (Axis other : all_axes) two_moves = two_moves || s.rig.axis(other).moving;
    Move kept{axis, NAN, 0.0, 0.0};
    if (!journal.commands.empty()) kept = journal.commands.back().move.value_or(kept);
    unrecorded = unrecorded || kept.axis != axis || kept.target_deg != target_deg;
  };
  const auto stops = [&table] { return table.stops + table.aborts; };
  s.station.motion.settle_s = 0.1;
  s.station.motion.stall_s = 0.3;
  s.station.motion.deadline_margin_s = 1.0;
  s.station.imu_timeout_s = 0.3;
  s.station.resume_rest_s = 0.2;
  s.station.dwell.max_gyro_std_degps = s.station.dwell.max_gyro_peak_degps =
      1.0;  // windows of a few samples say little
  s.station.dwell.max_accel_std_mps2 = s.station.dwell.max_accel_peak_mps2 = 1.0;
  s.station.dwell.stillness_window_s = 0.1;
  int stops_told = 0;
  bool late_stop = false;
  journal.on_transition = [&](const TransitionRecord& record) {
    if (record.action != RunAction::stop_table && record.action != RunAction::abort_table) return;
    late_stop = late_stop || stops() <= stops_told;
    stops_told = stops();
  };
  bool results_durable = false;
  s.calibrate = [&](const RunOutcome&) -> Status {
    if (!s.sink.finished || !journal.sealed) return Error{ErrorKind::internal, "calibrated before it was sealed"};
    results_durable = true;
    return {};
  };
  s.watcher.on_tick = [&](const RunSnapshot&) {
    for (const Disturbance& d : disturbances) {
      if (s.clock.now_s() < 0.1 * d.moment) continue;
      if (d.kind == fault_kinds) s.stop_requests = 1;
      if (d.kind == fault_kinds + 4) s.pause_requests = 1;
      if (d.kind == fault_kinds + 5) s.end_requests = s.stop_requests = 1;
    }
  };
  for (const Disturbance& d : disturbances) {
    if (d.kind == fault_kinds + 1) fail_at = 1 + d.moment / 3;
    if (d.kind == fault_kinds + 2) s.sink.fail_at_call = 1 + d.moment / 3;
    if (d.kind == fault_kinds + 3) kill_at = 1 + d.moment / 3;
  }
  for (int session = 1;; ++session) {
    if (session > 12) return "not done after 12 sessions";
    const std::vector<CompletedDwell> before = journal.dwells;
    const std::size_t transitions_before = s.watcher.transitions.size();
    const int connected_before = s.watcher.count(RunEvent::connected);
    std::optional<RunOutcome> outcome;
    try {
      outcome = s.run_on(table);
    } catch (const Killed&) {
      ++tally.kills;
    }
    ++tally.sessions;
    if (two_moves) return "a move was commanded while another was under way";
    if (late_stop) return "a stop waited for the journal";
    if (unrecorded) return "a move was commanded that the journal does not know";
    if (!std::equal(before.begin(), before.end(), journal.dwells.begin())) return "a completed dwell was taken back";
    std::set<std::size_t> items;
    for (const CompletedDwell& dwell : journal.dwells) {
      if (!items.insert(dwell.item).second) return "a completed dwell was done again";
      const bool recorded = std::ranges::any_of(s.sink.segments, [&](const Segment& segment) {
        return segment.end_sample == dwell.units[0].next_sample &&
               segment.kind == s.plan.items[dwell.item].dwell_kind &&
               segment.end_sample - segment.start_sample == s.plan.items[dwell.item].samples;
      });
      if (!recorded) return "a completed dwell is not in the recording";
    }
    if (outcome) {
      const bool verified = outcome->error.message.find("COULD NOT BE VERIFIED") == std::string::npos;
      // A table that slips by itself while the link cannot be opened is out of anybody's hands.
      const bool had_table = s.watcher.count(RunEvent::connected) > connected_before;
      for (Axis axis : all_axes) {
        if (!verified || !had_table) break;
        if (!s.at_rest()) return "over, and the table turns: " + outcome->error.message;
        const Result<AxisStatus> status = table.status(axis);
        if (status && status->enabled) return "over, and a drive is on: " + outcome->error.message;
      }
      const bool paused = outcome->state == RunState::interrupted && s.stop_requests == 0;
      if (outcome->state == RunState::interrupted && !verified) return "interrupted, and the table may turn";
      if (paused && s.pause_requests == 0) return "interrupted, and nobody asked for it";
      // The dwell that was going on when the pause was asked for is kept, unless it was bad.
      const auto session_events = std::span(s.watcher.transitions).subspan(transitions_before);
      const auto told = std::ranges::find_if(session_events, [](const TransitionRecord& record) {
        return record.event == RunEvent::pause_wanted && record.from == RunState::dwelling;
      });
      const bool was_bad = std::ranges::find(told, session_events.end(), RunEvent::dwell_bad,
                                             &TransitionRecord::event) != session_events.end();
      if (paused && told != session_events.end() && journal.dwells.size() == before.size() && !was_bad)
        return "paused, and the dwell that went on is lost";
      tally.pauses += paused ? 1 : 0;
      if (outcome->error.kind == ErrorKind::internal && outcome->state != RunState::done) return outcome->error.message;
      if (outcome->state == RunState::done) {
        std::size_t dwells = 0;
        for (const PlannedItem& item : s.plan.items) dwells += item.kind == SequenceItem::Kind::dwell ? 1 : 0;
        if (!results_durable || !s.sink.finished) return "done, and the results are not durable";
        if (items.size() != dwells) return "done, and a dwell is missing";
        return "";
      }
    }
    // Somebody comes, clears the faults and starts it again. A sealed recording needs no devices (run_job.cpp).
    if (s.sink.finished) return "";
    kill_at = fail_at = s.sink.fail_at_call = -1;
    s.stop_requests = s.pause_requests = s.end_requests = 0;
    s.watcher.on_tick = nullptr;
    s.rig.release_emergency_stop();
    s.rig.clear_faults();
    s.devices.devices().wait(1.0);
    if (journal.dwells.empty()) {
      s.sink = MemorySink();
    } else {
      s.resume = ResumePoint{journal.dwells.back(), false};
    }
  }
}

TEST(RunProperties, WhateverHappensOnTheRig) {
  Tally tally;
  check_ten_thousand("a run is stopped, kept and finished whatever happens", [&tally] {
    // The size grows the list only: whole ranges for what is in it.
    const auto up_to = [](int end) { return rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, end)); };
    const auto one = rc::gen::build<Disturbance>(rc::gen::set(&Disturbance::kind, up_to(disturbance_kinds)),
                                                 rc::gen::set(&Disturbance::moment, up_to(300)),
                                                 rc::gen::set(&Disturbance::axis, up_to(3)));
    const auto disturbances = *rc::gen::resize(6, rc::gen::container<std::vector<Disturbance>>(one));
    const std::string wrong = run_with(disturbances, tally);
    if (!wrong.empty()) RC_FAIL(wrong);
  });
  std::printf("%d sessions, %d of them killed, %d paused\n", tally.sessions, tally.kills, tally.pauses);
  EXPECT_GT(tally.sessions, 15'000) << "hardly anything was disturbed";
  EXPECT_GT(tally.kills, 300);
  EXPECT_GT(tally.pauses, 300);
}

}  // namespace
}  // namespace turncal
