// What the operator sees: the live line's content and rate, and plain lines where there is no terminal.
#include "orchestrator/watch/progress.h"

#include <sys/socket.h>
#include <sys/un.h>
#include "tests/test.h"

#include "imu_io/base/console.h"
#include "imu_io/lines/unit_end.h"

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
  EXPECT_EQ(format_progress(moving()), " 11%, 1:23:45 left  step 2/14  moving  34%  roll 123.46 -> 360.00 deg");
}

TEST(Progress, DwellSaysItsKindAndRepeat) {
  RunSnapshot s = moving();
  s.state = RunState::dwelling;
  s.dwell_kind = SegmentKind::align;
  s.axis.reset();
  EXPECT_EQ(format_progress(s), " 11%, 1:23:45 left  step 2/14  align  34%  H 0.00 P 0.00 R 123.46 deg");
  s.dwell_kind = SegmentKind::still;
  s.repeats = 1;
  EXPECT_SAYS(format_progress(s), "dwell (repeat 1)");
}

TEST(Progress, TerminalLineIsRedrawnTenTimesASecondAtMost) {
  std::ostringstream out;
  double wall_s = 50.0;
  ProgressPrinter progress(out, 41, false, [&] { return wall_s; });
  TransitionRecord record;
  record.at = moving();
  int calls = 0;
  for (; wall_s < 52.0; wall_s += 0.001, ++calls) {
    progress.on_progress(moving());
    progress.on_transition(record);
  }
  const std::string text = out.str();
  const auto redraws = std::ranges::count(text, '\r');
  EXPECT_GE(redraws, 18);
  EXPECT_LE(redraws, 20);
  EXPECT_SAYS(text, "\r 11%, 1:23:45 left  step 2/14  moving  3\x1b[K") << "cut to 40 columns";
  EXPECT_EQ(text.find('\n'), std::string::npos) << "the live line never scrolls";
  progress.clear();
  EXPECT_TRUE(out.str().ends_with("\x1b[2K\r"));
}

TEST(Progress, TerminalSaysAtOnceWhatAPauseWaitsFor) {
  std::ostringstream out;
  const LinePrefix marked(out, "[dry run] ");
  ProgressPrinter progress(out, 80, false, [] { return 0.0; });
  progress.on_progress(moving());
  out.str("");
  TransitionRecord record;
  record.at = moving();
  record.event = RunEvent::pause_wanted;
  record.detail = format_pause(record.at);
  progress.on_transition(record);
  EXPECT_EQ(out.str(), "\x1b[2K\r[dry run] pause asked for: after this move; Ctrl-C again stops now\n");
  for (const auto& [state, text] :
       {std::pair{RunState::homing, "after homing"}, std::pair{RunState::settling, "after settling"},
        std::pair{RunState::parking, "everything is recorded, the run finishes"}}) {
    record.at.state = state;
    EXPECT_SAYS(format_pause(record.at), text);
  }
}

TEST(Progress, TransitionsAreAddedOnATerminalWhereAskedFor) {
  for (const bool verbose : {false, true}) {
    std::ostringstream out;
    ProgressPrinter progress(out, 80, verbose, [] { return 0.0; });
    TransitionRecord record;
    record.at = moving();
    record.from = record.to = RunState::moving;
    record.event = RunEvent::arrived;
    progress.on_progress(moving());
    progress.on_transition(record);
    EXPECT_EQ(out.str().find("\x1b[2K\r2026-01-01T00:12:34Z     754.500 s  ") != std::string::npos, verbose);
  }
}

TEST(Progress, ColoursAreForTerminalsOfThoseWhoWantThem) {
  Result<Pty> pty = good(Pty::create());
  const int terminal = ::open(pty->device().c_str(), O_RDWR | O_NOCTTY);
  const int file = ::open("/dev/null", O_RDWR);
  ::setenv("TERM", "xterm", 1);
  ::unsetenv("NO_COLOR");
  const auto shown = [](int descriptor) {
    std::ostringstream out;
    allow_colour(out, descriptor);
    return in_tone(out, Tone::bad, "fail");
  };
  EXPECT_EQ(shown(terminal), "\x1b[31mfail\x1b[0m");
  EXPECT_EQ(shown(file), "fail");
  ::setenv("TERM", "dumb", 1);
  EXPECT_EQ(shown(terminal), "fail");
  ::setenv("TERM", "xterm", 1);
  ::setenv("NO_COLOR", "1", 1);
  EXPECT_EQ(shown(terminal), "fail");
  ::unsetenv("NO_COLOR");
  ::close(terminal);
  ::close(file);
}

TEST(Progress, SystemdWatchesWhileTheTableMayMove) {
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = "@turncal-test-" + std::to_string(::getpid());
  name.copy(address.sun_path, name.size());
  address.sun_path[0] = '\0';
  ASSERT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&address),
                   static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())),
            0);
  const auto heard = [socket] {
    std::array<char, 512> text{};
    const ssize_t got = ::recv(socket, text.data(), text.size(), 0);
    return std::string(text.data(), got > 0 ? std::size_t(got) : 0);
  };
  ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
  {
    ServiceWatch service;
    EXPECT_EQ(heard(), "") << "nothing moves yet";
    service.on_progress(moving());
    service.on_progress(moving());
    EXPECT_EQ(heard(), "WATCHDOG_USEC=30000000");
    EXPECT_EQ(heard(), "WATCHDOG=1\nSTATUS=" + format_progress(moving()));
    EXPECT_EQ(heard(), "") << "once a second at most";
    TransitionRecord record;
    record.to = RunState::calibrating;
    service.on_transition(record);
    EXPECT_EQ(heard(), "WATCHDOG_USEC=0");
    EXPECT_EQ(heard(), "STATUS=calibrating");
    RunSnapshot calibrating = moving();
    calibrating.state = RunState::calibrating;
    service.on_progress(calibrating);
    EXPECT_EQ(heard(), "") << "an estimate takes as long as it takes";
  }
  EXPECT_EQ(heard(), "");
  {
    ServiceWatch service;
    service.on_progress(moving());
    heard();
    heard();
  }
  EXPECT_EQ(heard(), "WATCHDOG_USEC=0") << "a run that ended by an exception";
  ::unsetenv("NOTIFY_SOCKET");
  ServiceWatch nobody;
  nobody.on_progress(moving());
  EXPECT_EQ(heard(), "");
  ::close(socket);
}

// --- The civil clock against the monotonic one.

std::vector<double> steps_of(const std::vector<std::pair<double, double>>& times, double speed_up = 1.0) {
  std::vector<double> steps;
  ClockWatch watch(speed_up, [&steps](double by_s, const RunSnapshot&) { steps.push_back(by_s); });
  for (const auto& [time_s, utc_s] : times) {
    RunSnapshot at;
    at.time_s = time_s;
    at.utc_s = utc_s;
    watch.on_progress(at);
  }
  for (double& step : steps) step = std::round(step * 1e6) / 1e6;
  return steps;
}

TEST(ClockWatch, AStepIsToldOnceAndWithItsSign) {
  using Steps = std::vector<double>;
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {0.1, 1000.1}, {7200.0, 8200.0}}), Steps{});
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {0.1, 4600.1}, {0.2, 4600.2}}), Steps{3600.0});
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {10.0, 1008.0}, {11.0, 1009.0}, {12.0, 1009.0}}), (Steps{-2.0, -1.0}));
  // The station's time may run faster.
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {50.0, 1001.0}, {5000.0, 1100.0}}, 50.0), Steps{});
  EXPECT_EQ(steps_of({{0.0, 1000.0}, {50.0, 1011.0}}, 50.0).size(), 1U);
}

TEST(ClockWatch, ASlowCorrectionIsNone) {
  std::vector<std::pair<double, double>> slewed;  // 500 ppm for two hours: 3.6 s in all
  for (int i = 0; i < 72000; ++i) slewed.emplace_back(0.1 * i, 1000.0 + 0.1 * i * 1.0005);
  EXPECT_TRUE(steps_of(slewed).empty());
}

}  // namespace
}  // namespace turncal
