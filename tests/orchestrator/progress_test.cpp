// What the operator sees: the live line's content and rate, and plain lines where there is no terminal.
#include "orchestrator/watch/progress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "imu_io/base/line_prefix.h"
#include "orchestrator/watch/run_log.h"

namespace turncal {
namespace {

RunSnapshot moving() {
  RunSnapshot s;
  s.time_s = 754.5;
  s.utc_s = 1767225600.0 + 754.5;
  s.state = RunState::moving;
  s.step = 2;
  s.step_place = 2;
  s.step_count = 14;
  s.axis = Axis::roll;
  s.target_deg = 360.0;
  s.position_deg[Axis::roll] = 123.4567;
  s.phase_fraction = 0.343;
  s.run_fraction = 0.11;
  s.eta_s = 5025.0;
  return s;
}

TEST(Progress, LineSaysStepPhaseAngleTargetAndEta) {
  EXPECT_EQ(format_progress(moving()), "step 2/14  moving  roll 123.46 -> 360.00 deg  34%  run  11%  ETA 1:23:45");
}

TEST(Progress, DwellSaysItsKindAndRepeat) {
  RunSnapshot s = moving();
  s.state = RunState::dwelling;
  s.dwell_kind = SegmentKind::align;
  s.axis.reset();
  EXPECT_EQ(format_progress(s), "step 2/14  align  H 0.00 P 0.00 R 123.46 deg  34%  run  11%  ETA 1:23:45");
  s.dwell_kind = SegmentKind::still;
  s.repeats = 1;
  EXPECT_NE(format_progress(s).find("dwell (repeat 1)"), std::string::npos);
}

TEST(Progress, TerminalLineIsRedrawnTenTimesASecondAtMost) {
  std::ostringstream out;
  double wall_s = 50.0;
  ProgressPrinter progress(out, 41, [&] { return wall_s; });
  TransitionRecord record;
  record.at = moving();
  int calls = 0;
  for (; wall_s < 52.0; wall_s += 0.001, ++calls) {
    progress.on_progress(moving());
    progress.on_transition(record);
  }
  const std::string text = out.str();
  const auto redraws = std::count(text.begin(), text.end(), '\r');
  EXPECT_GE(redraws, 18);
  EXPECT_LE(redraws, 20);
  EXPECT_NE(text.find("\rstep 2/14  moving  roll 123.46 -> 360.00\x1b[K"), std::string::npos) << "cut to 40 columns";
  EXPECT_EQ(text.find('\n'), std::string::npos) << "the live line never scrolls";
  progress.clear();
  EXPECT_TRUE(out.str().ends_with("\x1b[2K\r"));
}

TEST(Progress, TerminalSaysAtOnceWhatAPauseWaitsFor) {
  std::ostringstream out;
  const LinePrefix marked(out, "[dry run] ");
  ProgressPrinter progress(out, 80, [] { return 0.0; });
  progress.on_progress(moving());
  out.str("");
  TransitionRecord record;
  record.at = moving();
  record.event = RunEvent::pause_wanted;
  record.detail = format_pause(record.at);
  progress.on_transition(record);
  EXPECT_EQ(out.str(), "\x1b[2K\r[dry run] pause asked for: after this move; Ctrl-C again stops now\n");
  for (const auto& [state, text] :
       {std::pair{RunState::homing, "after homing;"}, std::pair{RunState::settling, "after settling;"},
        std::pair{RunState::parking, "everything is recorded, the run finishes"}}) {
    record.at.state = state;
    EXPECT_NE(format_pause(record.at).find(text), std::string::npos) << format_pause(record.at);
  }
}

TEST(Progress, ElsewhereOnePlainLineATransition) {
  std::ostringstream out;
  const LinePrefix marked(out, "[dry run] ");
  ProgressPrinter progress(out, 0, [] { return 0.0; });
  TransitionRecord record;
  record.at = moving();
  record.from = RunState::moving;
  record.to = RunState::settling;
  record.event = RunEvent::arrived;
  for (int i = 0; i < 100; ++i) progress.on_progress(moving());
  progress.on_transition(record);
  EXPECT_EQ(
      out.str(),
      "[dry run] 2026-01-01T00:12:34Z     754.500 s  step 2/14  moving -> settling  arrived: roll at 123.4567 deg\n");
}

TEST(Progress, Durations) {
  EXPECT_EQ(format_duration(0.0), "0:00:00");
  EXPECT_EQ(format_duration(59.6), "0:01:00");
  EXPECT_EQ(format_duration(6342.0), "1:45:42");
  EXPECT_EQ(format_duration(-3.0), "0:00:00");
}

}  // namespace
}  // namespace turncal
