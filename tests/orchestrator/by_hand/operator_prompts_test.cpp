// What the operator of a table turned by hand is told is left.
#include "orchestrator/devices/operator_prompts.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <sstream>

#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

class StoppedClock : public Clock {
 public:
  double now_s() const override { return 0.0; }
  double utc_s() const override { return 1767225600.0; }
};

TransitionRecord record_of(RunState from, RunEvent event, double time_s, double eta_s) {
  TransitionRecord record;
  record.from = from;
  record.event = event;
  record.at.time_s = time_s;
  record.at.utc_s = 1767225600.0 + time_s;
  record.at.eta_s = eta_s;
  record.at.step_place = record.at.step_count = 1;
  record.at.moves_left = 5;
  return record;
}

// What is said when the next turn is asked for.
std::string left_after(const std::vector<TransitionRecord>& records) {
  const StoppedClock clock;
  std::ostringstream out;
  int input[2];
  if (::pipe(input) != 0) return "no pipe";
  ManualTurntable table(ManualSettings{}, clock, input[0], out, [] { return std::optional<std::array<double, 3>>(); });
  OperatorPrompts prompts(table, 60.0);
  for (const TransitionRecord& record : records) prompts.on_transition(record);
  // The reason stands above whatever question comes next.
  const bool asked = table.connect().ok() && table.enable().ok() && table.home().ok();
  ::close(input[0]);
  ::close(input[1]);
  return asked ? out.str() : "not asked: " + out.str();
}

// After a resume the first settling belongs to no turn: it used to be counted as one that had taken since the beginning of time, and
// more than 17 hours were said of ten minutes.
TEST(OperatorPrompts, SettlingWithoutATurnIsNoTurn) {
  const TransitionRecord settled = record_of(RunState::settling, RunEvent::settled, 12000.0, 600.0);
  const TransitionRecord next = record_of(RunState::selecting, RunEvent::move_next, 12001.0, 600.0);
  // Ten minutes of plan and five turns of a minute.
  EXPECT_SAYS(left_after({settled, next}), "Turns left: 5; until about " + local_time(next.at.utc_s + 900.0));
  // A dwell that is repeated settles once more after the same turn.
  const TransitionRecord turned = record_of(RunState::settling, RunEvent::settled, 12041.0, 590.0);
  const TransitionRecord repeated = record_of(RunState::settling, RunEvent::settled, 12141.0, 590.0);
  const TransitionRecord another = record_of(RunState::selecting, RunEvent::move_next, 12142.0, 590.0);
  // The turn took 40 s, 10 of them planned: 30 s beyond the plan, five times.
  EXPECT_SAYS(left_after({settled, next, turned, repeated, another}),
              "until about " + local_time(another.at.utc_s + 740.0));
}

}  // namespace
}  // namespace turncal
