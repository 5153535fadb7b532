// The status page: what it serves, and that nothing can be written. In a browser: tests/system/live_page_test.py.
#include <new>

#include "imu_io/base/clock.h"
#include "orchestrator/watch/page_server.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/status_page.h"
#include "tests/orchestrator/program.h"

// After Eigen: a header of the system that it brings has a macro with the name of one of Eigen's parameters.
#include <httplib.h>

namespace turncal {
namespace {

class Page : public Program {
 protected:
  // A dry run slow enough to look at; returns its page's address.
  std::string start_run(const std::string& out, const std::string& pace, pid_t& pid) const {
    return start_page(dry_run(out, {"--pace", pace}, "SN-7"), pid);
  }
  std::string start_page(const Arguments& arguments, pid_t& pid) const {
    pid = start(arguments + "--listen 127.0.0.1:0");
    for (int i = 0; i < 1000; ++i) {
      const std::string said = file_text(folder_.string() + ".out");
      const std::size_t at = said.find("status page "), end = said.find('\n', at);
      if (at != std::string::npos && end != std::string::npos) return said.substr(at + 12, end - at - 12);
      ::usleep(10'000);
    }
    return "";
  }
};

TEST_F(Page, ServesStatusAndLetsNothingBeWritten) {
  pid_t pid = -1;
  const std::string url = start_run("out", "40", pid);
  ASSERT_FALSE(url.empty());
  httplib::Client client(url.substr(0, url.size() - 1));
  client.set_read_timeout(5);
  auto status = client.Get("/status.json");
  for (int i = 0; i < 500 && status && !says(status->body, "\"still_gyro_degps\":0."); ++i) {  // a second of a dwell
    ::usleep(10'000);
    status = client.Get("/status.json");
  }
  ASSERT_TRUE(status);
  EXPECT_EQ(status->status, 200);
  for (const char* text :
       {"\"unit\":\"SN-7\"", "\"simulated\":true", "\"step_count\":14", "\"eta_utc\":\"2026-01-01T00:1",
        "\"temperature_c\":2", "\"position_deg\":[", "\"rate_degps\":[", "\"still_gyro_degps\":", "\"lost_samples\":0",
        "\"transitions\":[\"2026"}) {
    EXPECT_SAYS(status->body, text);
  }
  const std::string heartbeat = "\"heartbeat_age_s\":";
  const std::size_t age = status->body.find(heartbeat);
  ASSERT_NE(age, std::string::npos);
  EXPECT_LT(std::stod(status->body.substr(age + heartbeat.size())), 1.0);
  const auto page = client.Get("/");
  ASSERT_TRUE(page);
  EXPECT_SAYS(page->body, "\"unit\":\"SN-7\"") << "the first status is in the page itself";
  EXPECT_SAYS_NOT(page->body, "INITIAL");
  const auto head = client.Head("/");  // of a monitor
  ASSERT_TRUE(head);
  EXPECT_EQ(head->status, 200);
  EXPECT_EQ(client.Head("/favicon.ico")->status, 404);
  for (const char* text :
       {"A step of one or two pulses is the resolution of the unit", "width=device-width", "break-inside:avoid"}) {
    EXPECT_SAYS(page->body, text);
  }
  for (const char* other : {"/run.log", "/../out/run.log", "/status.json/x", "/favicon.ico"}) {
    const auto answer = client.Get(other);
    ASSERT_TRUE(answer) << other;
    EXPECT_EQ(answer->status, 404) << other;
  }
  const auto posted = client.Post("/status.json", "{}", "application/json");
  const auto put = client.Put("/", "x", "text/plain");
  const auto deleted = client.Delete("/status.json");
  for (const auto* answer : {&posted, &put, &deleted}) {
    ASSERT_TRUE(*answer);
    EXPECT_EQ((*answer)->status, 404);
  }
  // The same port once more is refused, before anything is made.
  const std::string address = url.substr(7, url.size() - 8);
  expect_refused({"run", "--dry-run", "--unit", "SN8", "--out", "other", "--listen", address}, "cannot listen there");
  ::kill(pid, SIGTERM);
  EXPECT_EQ(finish(pid).code, 75);
  expect_refused({"run", "--dry-run", "--unit", "SN8", "--out", "other", "--listen", "here"}, "expected ADDRESS:PORT");
}

TEST_F(Page, OfACampaignSaysTheLegAndWhenTheLastOneEnds) {
  write("own.chamber",
        "format = 1\nname = own\nlink.kind = rig\nlimits.low_c = -40\nlimits.high_c = 85\nlimits.ramp_c_per_min = 3\n");
  write("own.station", station_head + "chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\n");
  write("own.campaign",
        "format = 1\nunit = SN1\nstation = own.station\nsequence = " + short_demo + "\ntemperatures_c = 10, 55, 25\n");
  const std::string plan = run("campaign own.campaign --plan --format json").out, key = "\"ends after, h\":";
  const std::size_t last = plan.rfind(key);
  ASSERT_NE(last, std::string::npos) << plan;
  const double hours = std::stod(plan.substr(last + key.size()));
  EXPECT_GT(hours, 0.8);
  const double begin_s = wall_utc_s();
  pid_t pid = -1;
  const std::string url = start_page("campaign own.campaign --out all --dry-run --no-diagnosis --pace 10", pid);
  ASSERT_FALSE(url.empty());
  httplib::Client client(url.substr(0, url.size() - 1));
  const auto status = client.Get("/status.json");
  ASSERT_TRUE(status);
  const std::string said = "; leg 1 of 3, the last one ends at about ";
  const std::size_t at = status->body.find(said);
  ASSERT_NE(at, std::string::npos) << status->body;
  const auto end_s = parse_utc(status->body.substr(at + said.size(), std::string_view("2026-01-01T00:00:00Z").size()));
  ASSERT_TRUE(end_s);
  EXPECT_NEAR(*end_s - begin_s, 3600.0 * hours, 60.0) << "what it takes to begin";
  ::kill(pid, SIGTERM);
  EXPECT_EQ(finish(pid).code, 75);
}

// Out of memory while it answers: the client loses its answer, the program nothing.
TEST(PageServer, AnExceptionEndsNothing) {
  std::atomic<int> asked{0};
  const auto pages = [&asked](std::string_view path) -> std::optional<PageText> {
    ++asked;
    if (path == "/throws") throw std::bad_alloc();
    if (path == "/odd") throw 7;
    return PageText{"text/plain", "here"};
  };
  Result<std::unique_ptr<PageServer>> server = good(PageServer::open("127.0.0.1:0", pages));
  const std::string url = (*server)->url();
  httplib::Client client(url.substr(0, url.size() - 1));
  client.set_read_timeout(5);
  for (const char* path : {"/throws", "/odd", "/throws"}) {
    EXPECT_FALSE(client.Get(path)) << path;
    const auto answer = client.Get("/");
    ASSERT_TRUE(answer) << path;
    EXPECT_EQ(answer->body, "here");
  }
  EXPECT_EQ(asked, 6);
}

TEST(PageServer, Addresses) {
  const auto host = [](const std::string& text) {
    const Result<PageAddress> address = parse_page_address(text);
    return address ? address->host + " " + std::to_string(address->port) : "refused";
  };
  EXPECT_EQ(host("127.0.0.1:8080"), "127.0.0.1 8080");
  EXPECT_EQ(host("[::1]:0"), "::1 0");
  EXPECT_EQ(host("localhost:65535"), "localhost 65535");
  for (const char* bad :
       {"", "8080", ":8080", "here", "here:", "here:65536", "here:-1", "::1:80", "[]:80", "[::1]", "[::1:80"}) {
    EXPECT_EQ(host(bad), "refused") << bad;
  }
}

LiveRun a_run() { return {.unit = "SN1", .station = "s", .sequence = "q", .folder = "out", .simulated = true}; }

bool says(const LiveStatus& status, const std::string& headline, const std::string& tone) {
  return status.json().starts_with("{\"headline\":\"" + headline + "\",\"tone\":\"" + tone + "\"");
}

// What stands in the coloured line is what is so, and green is for what needs nobody.
TEST(LiveStatus, HeadlineIsTheStateAsItIs) {
  LiveRun run = a_run();
  RunSnapshot at;
  at.step_place = 3;
  at.step_count = 14;
  at.state = RunState::moving;
  at.axis = Axis::pitch;
  at.target_deg = 90.0;
  at.utc_s = 1767225600.0;
  at.eta_s = 100.0;
  at.end_utc_s = at.utc_s + 50.0;  // twins at twice the speed
  {
    LiveStatus status(run, monotonic_s);
    status.on_progress(at);
    EXPECT_TRUE(says(status, "Running: step 3/14, moving", "good")) << status.json();
    EXPECT_SAYS(status.json(), "\"eta_utc\":\"2026-01-01T00:00:50Z\"");
    at.state = RunState::resting;
    status.on_progress(at);
    EXPECT_TRUE(says(status, "Running: step 3/14, resting after the interruption", "good")) << status.json();
    at.state = RunState::moving;
    at.units = {{"SN1", 10, 0, ""}, {"SN2", 5, 0, "silent"}};
    status.on_progress(at);
    EXPECT_TRUE(says(status, "Running: step 3/14, moving; dropped out: SN2", "attention")) << status.json();
    status.end("Done: SN1 pass, SN2 dropped out", Tone::good);
    EXPECT_TRUE(says(status, "Done: SN1 pass, SN2 dropped out; dropped out: SN2", "attention")) << status.json();
  }
  run.by_hand = true;
  at.units.clear();
  LiveStatus status(run, monotonic_s);
  status.on_progress(at);
  EXPECT_TRUE(says(status, "Waits for the operator: step 3/14, turn pitch to 90.00 deg", "attention")) << status.json();
  EXPECT_SAYS(status.json(), "\"eta_utc\":\"\"") << "nobody knows how long a person takes";
  EXPECT_SAYS(status.json(), "\"verification\":[]");
  status.end("Paused: step 3; resume with: turncal resume out", Tone::attention, {"pass: heading 0.0054 deg"});
  EXPECT_TRUE(says(status, "Paused: step 3; resume with: turncal resume out", "attention")) << status.json();
  EXPECT_SAYS(status.json(), "\"verification\":[\"pass: heading 0.0054 deg\"]");
}

TEST(LiveStatus, SaysWhatAPauseWaitsFor) {
  LiveStatus status(a_run(), [] { return 0.0; });
  EXPECT_SAYS(status.json(), "\"pause\":\"\"");
  TransitionRecord record;
  record.from = record.to = record.at.state = RunState::dwelling;
  record.event = RunEvent::pause_wanted;
  record.at.item_end_utc_s = 1767225600.0 + 3661.0;
  record.detail = format_pause(record.at);
  status.on_transition(record);
  EXPECT_SAYS(status.json(), "\"pause\":\"pause asked for: after this dwell, at 01:01:01Z\"") << "a page has no Ctrl-C";
  EXPECT_SAYS(status.json(), "\"last_error\":\"\"") << "a pause is no error";
}

TEST(LiveStatus, TextsAreSafeInsideThePage) {
  LiveRun run = a_run();
  run.unit = "</script><b>\"\\";
  LiveStatus status(run, monotonic_s);
  const std::string json = status.json();
  EXPECT_SAYS_NOT(json, "</script>");
  EXPECT_SAYS(json, "\\u003c/script>\\u003cb>");
  EXPECT_SAYS(json, "\\\"\\\\");
}

// One second of a dwell is one point, in deg/s and m/s^2.
TEST(LiveStatus, TheDwellSecondBySecond) {
  LiveStatus status(a_run(), monotonic_s);
  RecordingInfo info;
  info.sample_period_s = 0.5;
  info.gyro_increment = IncrementKind::physical;
  info.accel_increment = IncrementKind::physical;
  EXPECT_TRUE(status.start(info) && status.begin_segment({.kind = SegmentKind::still}));
  std::vector<ImuSample> samples(6);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].gyro[0] = i < 4 ? 0.0 : 0.01;  // rad in half a second
    samples[i].accel[1] = 4.9;
  }
  EXPECT_TRUE(status.add(samples));
  const std::string json = status.json();
  EXPECT_SAYS(json, "\"dwell\":[[0,0,1.1459");  // 0.02 rad/s
  EXPECT_SAYS(json, "\"temperature_c\":null");
  EXPECT_SAYS(json, "\"still_gyro_degps\":0.66159");  // 1.1459 / sqrt 3
  EXPECT_TRUE(status.begin_segment({.kind = SegmentKind::align}));
  EXPECT_SAYS(status.json(), "\"dwell\":[[],[],[],[],[],[]]");
}

}  // namespace
}  // namespace turncal
