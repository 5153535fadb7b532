// A pause lets the item that goes on come to its end, leaves the table at rest with its drives off, and costs nothing that was
// recorded; a stop asked for from outside is an interruption too; twice by the operator is an abort.
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/stop_signals.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/records/journal.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

struct PausedStation : RigStation {
  PausedStation() : RigStation(two_steps_text) {}
  bool drives_off() {
    return std::ranges::all_of(all_axes, [this](Axis axis) {
      const Result<AxisStatus> status = devices.table.status(axis);
      return status && !status->enabled;
    });
  }
};

TEST(Pause, WaitsForTheItemGoingOn) {
  const struct {
    double asked_s;
    RunState in;
    std::size_t dwells;
    double safe_s;
  } cases[] = {{0.5, RunState::homing, 0, 2.0},     {4.0, RunState::dwelling, 1, 7.0},
               {9.0, RunState::moving, 1, 17.0},    {16.8, RunState::settling, 1, 17.0},
               {20.0, RunState::dwelling, 2, 27.0}, {30.0, RunState::moving, 2, 37.0}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.asked_s);
    PausedStation s;
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (at.time_s >= c.asked_s) s.pause_requests = 1;
    };
    const RunOutcome outcome = ended(s.run(), RunState::interrupted);
    EXPECT_EQ(exit_code(outcome.error.kind), 75);
    EXPECT_TRUE(s.at_rest());
    EXPECT_TRUE(s.drives_off());
    EXPECT_TRUE(s.watcher.saw(RunEvent::stopped_verified));
    EXPECT_EQ(s.kept.dwells.size(), c.dwells);
    EXPECT_NEAR(s.clock.now_s(), c.safe_s, 0.3 + TableStop::stand_s) << "a poll or two of stopping and switching off";
    EXPECT_EQ(s.watcher.count(RunEvent::pause_wanted), 2) << "told at once, and done at the safe point";
    EXPECT_FALSE(s.watcher.saw(RunEvent::operator_stop));
    const TransitionRecord& told =
        *std::ranges::find(s.watcher.transitions, RunEvent::pause_wanted, &TransitionRecord::event);
    EXPECT_EQ(told.from, c.in);
    EXPECT_NEAR(told.at.time_s, c.asked_s, 0.6);
    if (c.in == RunState::dwelling) {
      EXPECT_NEAR(told.at.item_end_utc_s - s.clock.utc_s() + s.clock.now_s(), c.safe_s, 0.01);
      EXPECT_SAYS(told.detail, "after this dwell, at ");
    }
    // And it goes on, with all that was complete.
    s.watcher.on_tick = nullptr;
    s.pause_requests = 0;
    if (s.kept.dwells.empty()) {
      s.sink = MemorySink();
    } else {
      s.resume = ResumePoint{s.kept.dwells.back(), false};
    }
    s.station.resume_rest_s = 1.0;
    EXPECT_EQ(s.run().state, RunState::done);
    ASSERT_EQ(s.kept.dwells.size(), 3u);
  }
}

TEST(Pause, RestAfterAnInterruptionEndsAtOnce) {
  for (const double asked_s : {0.5, 10.0}) {  // while homing, and while resting
    PausedStation s;
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (at.time_s >= 9.0) s.stop_requests = 1;
    };
    ASSERT_EQ(s.run().state, RunState::aborted);
    s.stop_requests = 0;
    s.station.resume_rest_s = 600.0;
    s.resume = ResumePoint{s.kept.dwells.back(), false};
    s.watcher = Watcher();
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (at.time_s >= asked_s) s.pause_requests = 1;
    };
    const double began_s = s.clock.now_s();
    ended(s.run(), RunState::interrupted);
    EXPECT_LT(s.clock.now_s() - began_s, 13.0);
    EXPECT_TRUE(s.drives_off());
    EXPECT_EQ(s.watcher.transitions.back().from, RunState::stopping);
    EXPECT_FALSE(s.watcher.saw(RunEvent::rest_over));
    EXPECT_EQ(s.kept.dwells.size(), 1u);
  }
}

// asked for while stopping for the first: the fastest stop goes out.
TEST(Pause, FurtherRequestsEscalate) {
  struct Case {
    bool pause, first_ends, second, second_ends;
    int code;
  };
  for (const Case& c :
       {Case{true, false, false, false, 30}, Case{true, true, false, false, 75}, Case{false, true, false, false, 75},
        Case{true, false, true, false, 30}, Case{true, true, true, true, 75}, Case{false, true, true, false, 30}}) {
    SCOPED_TRACE(testing::Message() << c.pause << c.first_ends << c.second << c.second_ends);
    PausedStation s;
    s.watcher.on_tick = [&](const RunSnapshot& at) {
      if (c.pause && at.time_s >= 9.0) s.pause_requests = 1;
      if (at.time_s >= 10.0 && s.stop_requests == 0) {
        s.end_requests = c.first_ends ? 1 : 0;
        s.stop_requests = 1;
      }
      if (c.second && at.state == RunState::stopping && s.stop_requests == 1) {
        s.end_requests = s.end_requests + (c.second_ends ? 1 : 0);
        s.stop_requests = 2;
      }
    };
    const RunOutcome outcome = s.run();
    EXPECT_EQ(exit_code(outcome.error.kind), c.code) << outcome.error.message;
    EXPECT_LT(s.clock.now_s(), 12.0) << "not at the end of the move";
    EXPECT_TRUE(s.at_rest());
    EXPECT_TRUE(s.drives_off());
    EXPECT_EQ(std::ranges::count(s.watcher.transitions, RunAction::abort_table, &TransitionRecord::action), c.second);
  }
}

// --- The program, with signals raised at exact moments: when a line of the console says so.

class Console : public std::streambuf {
 public:
  std::string text;
  std::string when;  // in a line
  int signal = 0;
  std::string then;  // and once more at the first line with this
  int second = 0;

 protected:
  int_type overflow(int_type c) override {
    text += char(c);
    if (c == '\n') look();
    return c;
  }
  std::streamsize xsputn(const char* s, std::streamsize n) override {
    for (std::streamsize i = 0; i < n; ++i) overflow(static_cast<unsigned char>(s[i]));
    return n;
  }

 private:
  void look() {
    if (text.size() < 2) return;
    const std::string line = text.substr(text.rfind('\n', text.size() - 2) + 1);
    if (signal != 0 && line.find(when) != std::string::npos)
      ::raise(std::exchange(signal, 0));
    else if (signal == 0 && second != 0 && line.find(then) != std::string::npos)
      ::raise(std::exchange(second, 0));
  }
};

class PausedRun : public testing::Test {
 protected:
  void SetUp() override {
    const std::string whole = file_text(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq");
    std::ofstream(folder_ / "four.seq") << whole.substr(0, whole.find("step 5"));
    std::ofstream(folder_ / "queue") << "SN1\nSN2\n";
  }
  int command(std::vector<std::string> arguments) {
    console_.text.clear();
    err_.str("");
    std::ostream out(&console_);
    CommandContext context{.out = out, .err = err_};
    StopSignals::forget();
    std::vector<const char*> argv = {"turncal"};
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    argv.push_back("--verbose");  // the console waits for transitions
    return run_command_line(int(argv.size()), argv.data(),
                            {{"Station", {add_run_command, add_resume_command, add_batch_command}}}, context);
  }
  int run(const std::string& name) {
    return command({"run", "--dry-run", "--no-diagnosis", "--unit", "SN1", "--sequence", folder_ / "four.seq", "--out",
                    folder_ / name});
  }
  int batch() {
    return command(
        {"batch", folder_ / "queue", "--dry-run", "--sequence", folder_ / "four.seq", "--out", folder_ / "units"});
  }
  void at(const std::string& when, int signal, const std::string& then = "", int second = 0) {
    console_.when = when;
    console_.signal = signal;
    console_.then = then;
    console_.second = second;
  }

  TemporaryFolder folder_;
  Console console_;
  std::ostringstream err_;
};

TEST_F(PausedRun, GoesOnToTheSameBytes) {
  ASSERT_EQ(run("reference"), 0) << err_.str();
  struct Case {
    const char* when;
    int signal;
    const char* then;
    int second;
    int code;
  };
  const char* const move = "selecting -> moving  move_next: pitch from 90 to -90";
  const Case cases[] = {
      {"connecting -> homing", SIGINT, "", 0, 75},
      {"homing -> selecting", SIGINT, "", 0, 75},
      {move, SIGINT, "", 0, 75},
      {"moving -> settling", SIGINT, "", 0, 75},
      {"selecting -> dwelling  dwell_next: dwell", SIGINT, "", 0, 75},
      {"selecting -> step_done", SIGINT, "", 0, 75},
      {move, SIGINT, "pause_wanted", SIGINT, 30},
      {move, SIGINT, "pause_wanted", SIGTERM, 75},
      {move, SIGTERM, "", 0, 75},
      {"selecting -> dwelling  dwell_next: dwell", SIGHUP, "", 0, 75},
      {move, SIGTERM, "moving -> stopping", SIGHUP, 75},
      {"parking -> calibrating", SIGINT, "", 0, 0},
      {"step_done -> parking", SIGINT, "", 0, 0},
  };
  int i = 0;
  for (const Case& c : cases) {
    SCOPED_TRACE(testing::Message() << c.when << ", signal " << c.signal << ' ' << c.second);
    const std::string name = "run" + std::to_string(++i);
    at(c.when, c.signal, c.then, c.second);
    ASSERT_EQ(run(name), c.code) << err_.str();
    ASSERT_EQ(console_.signal, 0) << "never came";
    ASSERT_EQ(console_.second, 0) << "never came";
    if (c.code != 0) {
      const std::string error = err_.str(), said = c.code == 75 ? error : console_.text;
      EXPECT_EQ(std::ranges::count(error, '\n'), 1) << error;
      EXPECT_SAYS(said, "turncal resume " + folder_ / name);
      const std::string log = file_text(folder_ / name + "/run.log");
      EXPECT_SAYS(log,
                  c.code == 75 ? "stopping -> interrupted  stopped_verified" : "stopping -> aborted  stopped_verified");
      const Result<std::string> journal = good(journal_as_text(folder_ / name + "/" + journal_name));
      EXPECT_SAYS(*journal, c.code == 75 ? "to = interrupted" : "to = aborted");
      at("", 0);
      ASSERT_EQ(command({"resume", folder_ / name, "--no-diagnosis"}), 0) << err_.str();
    }
    for (const char* file : {"parameters.conf", "recording.tcr", "truth.conf"}) {
      const std::string bytes = file_text(folder_ / name + "/" + file);
      EXPECT_FALSE(bytes.empty());
      EXPECT_EQ(bytes, file_text(folder_ / "reference/" + file)) << file;
    }
  }
}

TEST_F(PausedRun, BatchEndsAndGoesOnWithTheUnit) {
  at("selecting -> dwelling  dwell_next: dwell", SIGINT);
  EXPECT_EQ(batch(), 75);
  EXPECT_SAYS(err_.str(), "unit SN1: ");
  // While the results are made the unit is finished, and the next is not begun.
  at("parking -> calibrating", SIGINT);
  EXPECT_EQ(batch(), 75);
  EXPECT_SAYS(err_.str(), "after unit SN1");
  EXPECT_TRUE(std::filesystem::exists(folder_ / "units/SN1/parameters.conf"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "units/SN2"));
  at("", 0);
  EXPECT_EQ(batch(), 0) << err_.str();
  EXPECT_TRUE(std::filesystem::exists(folder_ / "units/SN2/parameters.conf"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "units/SN1.2"));
}

// Of a process of its own: does the condition hold at its end?
template <class Process>
void expect_in_a_process(Process process) {
  EXPECT_EXIT(::_exit(process() ? 7 : 1), testing::ExitedWithCode(7), "");
}

// What is left to be written down and said when the table is off is not cut short.
TEST(StopSignals, NoneEndsTheProgramAfterwards) {
  expect_in_a_process([] {
    {
      const StopSignals signals;
      ::raise(SIGTERM);
    }
    ::raise(SIGTERM);
    ::raise(SIGHUP);
    return StopSignals::ends() == 3;
  });
  expect_in_a_process([] {
    { const StopSignals signals; }
    ::raise(SIGTERM);
    const StopSignals next(FirstInterrupt::pauses);
    return StopSignals::any();
  });
}

TEST(StopSignals, WhatTheSystemHasEndedNobodyAborts) {
  expect_in_a_process([] {
    const StopSignals signals(FirstInterrupt::pauses);
    ::raise(SIGQUIT);
    ::raise(SIGINT);
    return StopSignals::requests() == 2 && StopSignals::ends() == 2;
  });
  expect_in_a_process([] {
    const StopSignals signals;
    ::raise(SIGINT);
    ::raise(SIGTERM);
    return StopSignals::requests() == 2 && StopSignals::ends() == 1;
  });
}

}  // namespace
}  // namespace turncal
