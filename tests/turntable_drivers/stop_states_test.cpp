// A stop goes out within 100 ms of the request, whatever driver and line are doing at that moment: each state is brought about, the stop
// is asked for in the middle of it, and the time is taken at the twin, when the stop of the last axis has come in. Where nothing can
// come in any more, the driver must give up as fast. docs/safety.md lists the states.

#include "tests/imu_io/loopback.h"
#include "tests/turntable_drivers/served_twin.h"
#include "tests/turntable_drivers/stop_request.h"

namespace turncal {
namespace {

// From the request to the stop of the last axis. `disturb` makes the line what it is, `is_stop` knows the stop of the last axis.
template <class Table, class Sentence>
double stop_takes_s(Table& s, const std::function<bool(const Sentence&)>& is_stop,
                    const std::function<void(const Sentence&, AnswerPlan&)>& how, const std::function<void()>& work) {
  std::atomic<double> stop_s{0.0};
  s.station.disturb([&](const Sentence& sentence, AnswerPlan& plan) {
    if (is_stop(sentence) && stop_s == 0.0) stop_s = monotonic_s();
    if (how) how(sentence, plan);
  });
  Request request(s.stop_requests);
  while (s.stop_requests == 0) work();
  static_cast<void>(s.driver.stop_all().ok());
  for (const Deadline patience(1.0); stop_s == 0.0 && !patience.passed();)
    ::usleep(1000);  // not every stop is answered
  s.station.disturb(nullptr);
  EXPECT_GT(stop_s, 0.0) << "no stop came in";
  s.station.pass(2.0);
  EXPECT_EQ(s.station.fastest_axis_degps(), 0.0);
  return stop_s - request.made_at_s();
}

// ---- Modbus ----

bool is_stop_of_roll(const ModbusRequest& request) {
  return request.unit == 3 && request.address == 0x202 && request.values == std::vector<std::uint16_t>{1};
}

struct ModbusState {
  const char* name;
  const char* map = "";
  Disturbance how{};
  bool commands = false;  // not readings, but moves are what is going on
};
void PrintTo(const ModbusState& state, std::ostream* out) { *out << state.name; }

std::vector<ModbusState> modbus_states() {
  const auto of_readings = [](const std::function<void(const ModbusRequest&, AnswerPlan&)>& how) -> Disturbance {
    return [how](const ModbusRequest& request, AnswerPlan& plan) {
      if (is_read(request)) how(request, plan);
    };
  };
  return {
      {"polling", "", {}},
      {"waiting_for_a_reply", "", of_readings([](auto&, AnswerPlan& plan) { plan.pieces.clear(); })},
      {"dead_line", "", [](auto&, AnswerPlan& plan) { plan.pieces.clear(); }},
      {"in_mid_reply", "link.byte_timeout_s = 0.3\nlink.response_timeout_s = 0.5\n",
       of_readings([](auto&, AnswerPlan& plan) { plan.pieces[0].bytes.resize(5); })},
      {"waiting_for_a_late_reply", "link.response_timeout_s = 0.03\nlink.quiet_s = 0.5\n",
       of_readings([](auto&, AnswerPlan& plan) { plan.pieces[0].delay_s = 0.05; })},
      {"draining", "link.quiet_s = 2\n",
       of_readings([](auto&, AnswerPlan& plan) { plan.pieces[0].bytes.resize(4, 0x55); })},
      {"chatter", "link.quiet_s = 2\n",
       of_readings([](auto&, AnswerPlan& plan) { plan.pieces[0].bytes.insert(plan.pieces[0].bytes.end(), 40, 0x55); })},
      {"drive_busy", "", of_readings([](const ModbusRequest& request, AnswerPlan& plan) {
         const bool tcp = plan.pieces[0].bytes.size() != 5u + 2u * unsigned(request.count);
         plan.pieces[0].bytes = exception_reply(request, 6, tcp);
       })},
      {"slow_drive", "", [](auto&, AnswerPlan& plan) { plan.pieces[0].delay_s = 0.02; }},
      {"frame_gap", "link.gap_s = 0.05\n", {}},
      {"write_list_with_waits",
       "write.move = 0x210 s32 position + u32 rate + u32 acceleration, wait 0.05, wait 0.05, wait 0.05, wait 0.05, "
       "wait 0.05, wait 0.05, 0x216 u16 1\n",
       {},
       true},
      {"stop_with_a_pulse", "write.stop = 0x202 u16 1, wait 0.05, 0x202 u16 0\n", {}},
  };
}

class ModbusStopStates : public testing::TestWithParam<std::tuple<bool, ModbusState>> {};

TEST_P(ModbusStopStates, GoesOutWithin100Ms) {
  const auto& [tcp, state] = GetParam();
  expect_in_time([&, tcp = tcp, &state = state] {
    FaultStation s(tcp, state.map);
    s.set_off(3.0);
    double target_deg = 10.0;
    const auto work = [&] {
      if (state.commands) {
        static_cast<void>(s.driver.move_absolute(Axis::heading, target_deg, 10.0, 10.0).ok());
        s.station.pass(5.0);
        target_deg = 10.0 - target_deg;
      } else {
        static_cast<void>(s.driver.status(Axis::heading).ok());
      }
    };
    return stop_takes_s<FaultStation, ModbusRequest>(s, is_stop_of_roll, state.how, work);
  });
}
INSTANTIATE_TEST_SUITE_P(All, ModbusStopStates, testing::Combine(testing::Bool(), testing::ValuesIn(modbus_states())),
                         [](const auto& which) {
                           return std::string(std::get<0>(which.param) ? "tcp_" : "rtu_") +
                                  std::get<1>(which.param).name;
                         });

// ---- ASCII ----

struct TextState {
  const char* name;
  const char* dialect;
  const char* last_stop;
  std::function<void(Dialect&)> prepare{};
  std::function<void(const std::string&, AnswerPlan&)> how{};
};
void PrintTo(const TextState& state, std::ostream* out) { *out << state.name; }

std::vector<TextState> text_states() {
  const auto silent = [](auto&, AnswerPlan& plan) { plan.pieces.clear(); };
  const auto cut = [](auto&, AnswerPlan& plan) {
    if (!plan.pieces.empty()) plan.pieces[0].bytes.resize(plan.pieces[0].bytes.size() / 2);
  };
  return {
      {"polling", "newport_esp30x", "03ST;"},
      {"dead_line_dollar", "three_axis_dollar", "MNSTP,1", {}, silent},
      {"dead_line_newport", "newport_esp30x", "03ST;", {}, silent},
      {"dead_line_prompt", "own_prompt", "C STO", {}, silent},
      {"dead_line_acutronic", "acutronic_acl", ":MODE:OFF 3", {}, silent},
      {"dead_line_pi", "pi_gcs2", "HLT 3", {}, silent},
      {"in_mid_answer", "three_axis_dollar", "MNSTP,1", {}, cut},
      {"waiting_for_a_late_answer", "newport_esp30x", "03ST;",
       [](Dialect& dialect) { dialect.link.reply_timeout_s = 0.03; },
       [](auto&, AnswerPlan& plan) {
         if (!plan.pieces.empty()) plan.pieces[0].delay_s = 0.05;
       }},
      {"draining", "three_axis_dollar", "MNSTP,1", [](Dialect& dialect) { dialect.link.quiet_s = 2.0; },
       [](auto&, AnswerPlan& plan) {
         plan.pieces.push_back({{'x'}, 0.0});
       }},
      {"between_sentences", "newport_esp30x", "03ST;", [](Dialect& dialect) { dialect.link.gap_s = 0.05; }},
      {"over_tcp_dead", "pi_gcs2", "HLT 3", [](Dialect& dialect) { dialect.link.tcp = true; }, silent},
  };
}

class TextStopStates : public testing::TestWithParam<TextState> {};

TEST_P(TextStopStates, GoesOutWithin100Ms) {
  const TextState& state = GetParam();
  expect_in_time([&] {
    Dialect dialect = shipped_dialect(state.dialect, std::string(state.dialect) == "acutronic_acl");
    dialect.link.reply_timeout_s = 0.15;
    dialect.link.quiet_s = 0.06;
    if (state.prepare) state.prepare(dialect);
    TextTable s(dialect);
    s.set_off(2.0);
    return stop_takes_s<TextTable, std::string>(
        s, [&](const std::string& body) { return body == state.last_stop; }, state.how,
        [&] { static_cast<void>(s.driver.status(Axis::heading).ok()); });
  });
}
INSTANTIATE_TEST_SUITE_P(All, TextStopStates, testing::ValuesIn(text_states()),
                         [](const auto& which) { return std::string(which.param.name); });

// ---- nobody there: the driver gives up as fast ----

// A port that takes no connection and refuses none: its queue is full.
struct BlackHole {
  BlackHole() {
    EXPECT_EQ(::listen(listener.descriptor, 0), 0);
    sockaddr_in to = test::loopback(listener.port);
    for (int& client : queue) {
      client = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
      ::connect(client, reinterpret_cast<sockaddr*>(&to), sizeof to);
    }
    address = "127.0.0.1:" + std::to_string(listener.port);
  }
  ~BlackHole() {
    for (const int client : queue) ::close(client);
  }
  test::Socket listener{SOCK_STREAM};
  std::array<int, 4> queue{};
  std::string address;
};

template <class Description>
void expect_connecting_is_given_up(Description described, const std::string& address) {
  described.link.address = address;
  expect_in_time([&] {
    const RealClock clock;
    std::atomic<int> requests{0};
    DescribedTurntable driver(described, clock, &requests);
    Request request(requests);
    const Status connected = driver.connect();
    const double ended_s = monotonic_s();
    EXPECT_TRUE(fails(connected, ErrorKind::aborted));
    return ended_s - request.made_at_s();
  });
}

TEST(StopStates, ConnectingToABlackHoleIsGivenUp) {
  const BlackHole hole;
  expect_connecting_is_given_up(map_of(plain_map_text("tcp")), hole.address);
  expect_connecting_is_given_up(shipped_dialect("pi_gcs2", true), hole.address);
}

// Nobody asked: the connection is given up at its own deadline.
TEST(StopStates, ABlackHoleIsADeviceErrorAtTheDeadline) {
  const BlackHole hole;
  RegisterMap map = map_of(plain_map_text("tcp"));
  map.link.address = hole.address;
  map.link.reply_timeout_s = 0.2;
  const RealClock clock;
  DescribedTurntable driver(map, clock);
  const double began_s = monotonic_s();
  const Status connected = driver.connect();
  EXPECT_GE(monotonic_s() - began_s, 0.2);
  EXPECT_LT(monotonic_s() - began_s, 2.0);
  EXPECT_ERROR(connected, hole.address + ": cannot open: Connection timed out");
}

TEST(StopStates, ConnectingToASilentDriveIsGivenUp) {
  const Result<Pty> line = good(Pty::create());
  expect_connecting_is_given_up(map_of(plain_map_text("rtu")), line->device());
}

// Somebody else talks on the line, and never pauses for quiet_s. Given up after twice that, so that the stop can go out.
AnswerPlan chatter(const std::string& word) {
  AnswerPlan plan;
  for (int i = 0; i < 50; ++i) plan.pieces.push_back({{word.begin(), word.end()}, i > 0 ? 0.05 : 0.0});
  return plan;
}

template <class Table>
double lost_after_s(Table& s) {
  const double began_s = monotonic_s();
  Result<AxisStatus> status = s.driver.status(Axis::heading);
  while (status.ok() || status.error().message.find("link lost") == std::string::npos)
    status = s.driver.status(Axis::heading);
  EXPECT_TRUE(fails(status, "does not fall silent"));
  return monotonic_s() - began_s;
}

TEST(StopStates, ChatterIsALostLinkSoon) {
  for (const bool tcp : {true, false}) {
    FaultStation s(tcp, "link.quiet_s = 0.2\n");
    s.make_ready();
    s.station.disturb([](const ModbusRequest&, AnswerPlan& plan) { plan = chatter("UUU"); });
    EXPECT_LT(lost_after_s(s), 1.5) << tcp;
    s.station.disturb(nullptr);
  }
  Dialect dialect = shipped_dialect("pi_gcs2");
  dialect.link.reply_timeout_s = 1.0;
  dialect.link.quiet_s = 0.2;
  TextTable s(dialect);
  s.make_ready();
  s.station.disturb([](const std::string&, AnswerPlan& plan) { plan = chatter("*"); });
  EXPECT_LT(lost_after_s(s), 1.9) << "1.4 s: an answer is awaited once";
  s.station.disturb(nullptr);
}

// The adapter was pulled: a stop cannot go out, and says so at once.
TEST(StopStates, PulledAdapterIsSaidAtOnce) {
  expect_in_time([&] {
    FaultStation s(false);
    s.set_off(0.0);
    s.station.disturb([](const ModbusRequest&, AnswerPlan& plan) { plan.hang_up = true; });
    while (s.driver.status(Axis::roll).ok()) {
    }
    ++s.stop_requests;
    const double asked_s = monotonic_s();
    EXPECT_FALSE(s.driver.stop_all().ok());
    EXPECT_FALSE(s.driver.abort_all().ok());
    return monotonic_s() - asked_s;
  });
}

// A line into which nothing goes any more, not even the stop: whoever asks again is not kept waiting.
TEST(StopStates, BlockedLineIsGivenUp) {
  expect_in_time([&] {
    std::atomic<bool> blocked{true};
    TextTable s(shipped_dialect("newport_esp30x"));
    s.station.disturb([&](const std::string&, AnswerPlan&) {
      while (blocked) ::usleep(1000);  // the twin does not read
    });
    while (s.driver.stop_all().ok()) {  // until the kernel's buffer is full
    }
    Request request(s.stop_requests);
    while (s.stop_requests == 0) static_cast<void>(s.driver.stop_all().ok());
    const double took_s = monotonic_s() - request.made_at_s();
    blocked = false;
    return took_s;
  });
}

// The first stop waits for answers that do not come: the second request is not kept waiting.
TEST(StopStates, SecondRequestDuringTheFirstStop) {
  expect_in_time([&] {
    FaultStation s(true);
    s.set_off(0.0);
    std::atomic<double> abort_s{0.0};
    s.station.disturb([&](const ModbusRequest& request, AnswerPlan& plan) {
      if (request.address == 0x203 && request.unit == 3 && abort_s == 0.0) abort_s = monotonic_s();
      plan.pieces.clear();
    });
    ++s.stop_requests;
    Request second(s.stop_requests);
    EXPECT_FALSE(s.driver.stop_all().ok());
    static_cast<void>(s.driver.abort_all().ok());
    s.station.disturb(nullptr);
    EXPECT_GT(abort_s, 0.0);
    return abort_s - second.made_at_s();
  });
}

}  // namespace
}  // namespace turncal
