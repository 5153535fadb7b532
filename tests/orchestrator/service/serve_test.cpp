// The page of several stations: what it shows of each, and what an operator can do by it.
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/service/service_page.h"
#include "orchestrator/service/station_view.h"
#include "tests/orchestrator/program.h"

// After Eigen: a header of the system that it brings has a macro with the name of one of Eigen's parameters.
#include <httplib.h>

namespace turncal {
namespace {

// Of "secret", by `openssl passwd -6`.
constexpr const char* hash_of_secret =
    "$6$turncaltest$Ca3hHOX/8w81m.o69BWfLBp6laKsAnyBM.2euUeTvSVC1lnGTC5ljBbWVMKUnvJPVZsjRyAF80Zn8AABDxDyW1";

class Serve : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    station_ = {"east", path("queue"), path("runs"), path("mounted")};
    std::filesystem::create_directories(path("runs"));
  }
  StationView look() const { return look_at(station_, *parse_utc("2026-01-02T00:00:00Z")); }
  // Looks until that is so, or for half a minute; what was seen last.
  StationView look_until(const std::function<bool(const StationView&)>& so, int ms = 50) const {
    StationView view = look();
    for (int i = 0; i < 30'000 / ms && !so(view); ++i, view = look())
      std::this_thread::sleep_for(std::chrono::milliseconds(ms));
    return view;
  }
  StationView wait_for(StationState state) const {
    StationView view = look_until([state](const StationView& now) { return now.state == state; });
    EXPECT_EQ(to_string(view.state), to_string(state)) << view.headline;
    return view;
  }
  pid_t start_batch(const std::string& pace) const {
    return start({"batch", path("queue"), "--dry-run", "--out", path("runs"), "--sequence",
                  std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq", "--pace", pace});
  }
  // Of a test that has failed nothing is waited for.
  ProgramResult finish_batch(pid_t batch) const {
    if (HasFailure()) ::kill(batch, SIGKILL);
    return finish(batch);
  }
  std::string write_operators(const std::string& text) const {
    const std::string file = write("operators", text);
    std::filesystem::permissions(file, std::filesystem::perms(0600));
    return file;
  }

  ServedStation station_;
};

// A page of the station "east"; who posts gets the code of the answer.
struct Served {
  Served(const ServedStation& station, const std::string& operators, const std::string& database = "",
         double now_s = 1.7e9) {
    auto opened =
        ServicePage::open("127.0.0.1:0", {.stations = {station}, .password_file = operators, .database = database},
                          [=] { return now_s; });
    EXPECT_TRUE(opened) << opened.error().message;
    page = std::move(*opened);
    client.emplace(page->url().substr(0, page->url().size() - 1));
  }
  int post(const std::string& name, const std::string& password, const std::string& body, bool marked = true) {
    client->set_basic_auth(name, password);
    const httplib::Headers headers = marked ? httplib::Headers{{"X-Turncal", "1"}} : httplib::Headers{};
    const auto answer = client->Post("/act", headers, body, "text/plain");
    return answer ? answer->status : -1;
  }
  int post_of_ana(const std::string& password, const std::string& action) {
    return post("ana", password, "station = east\naction = " + action + "\n");
  }
  std::unique_ptr<ServicePage> page;
  std::optional<httplib::Client> client;
};

TEST_F(Serve, SaysWhatTheQueueIsAt) {
  write("queue", "SN1\nSN2\nSN3\nSN4\nSN5\n");
  write("queue.state",
        "pass 2026-01-01T00:00:00Z SN1\nhold 2026-01-01T02:00:00Z SN2 # unexplained\npass 2026-01-01T04:10:00Z SN3\n");
  const StationView view = look();
  EXPECT_EQ(view.state, StationState::stopped);
  EXPECT_EQ(view.tone, Tone::bad);
  EXPECT_EQ(view.done, 3U);
  EXPECT_EQ(view.passed, 2U);
  EXPECT_EQ(view.waiting, (std::vector<std::string>{"SN4", "SN5"}));
  EXPECT_EQ(view.for_a_person, (std::vector<std::string>{"start the batch", "unit SN2: hold: unexplained"}));
  EXPECT_EQ(view.outcomes.front().unit, "SN3");
  ASSERT_TRUE(view.unit_s);
  EXPECT_EQ(*view.unit_s, 7800.0);     // of 7200 and 7800 s
  EXPECT_FALSE(view.queue_end_utc_s);  // nobody works on it

  // Units of a run have one time, and the last one recorded comes first, whatever a clock said.
  write("queue.state",
        "pass 2027-01-01T00:00:00Z SN9\npass 2026-01-01T00:00:00Z SN1\npass 2026-01-01T00:00:00Z SN3\n"
        "pass 2026-01-01T02:00:00Z SN5\npass 2026-01-01T02:00:00Z SN6\npass 2026-01-01T04:00:00Z SN8\n"
        "pass 2026-01-01T04:00:00Z SN7\n");
  EXPECT_EQ(look().unit_s, 3600.0) << "two hours for two";
  EXPECT_EQ(look().outcomes.front().unit, "SN7");

  write("queue", "SN1\nSN3\n");
  EXPECT_EQ(look().state, StationState::idle);
  EXPECT_EQ(look().tone, Tone::good);
  write("queue.state", "nonsense\n");
  EXPECT_EQ(look().state, StationState::unreadable);
  EXPECT_SAYS(look().headline, "queue.state:1");
  std::filesystem::remove(path("queue"));
  EXPECT_EQ(look().state, StationState::unreadable);
}

TEST_F(Serve, FollowsABatchAndPausesIt) {
  write("queue", "SN1\nSN2\n");
  const pid_t batch = start_batch("30");
  StationView view = wait_for(StationState::running);
  EXPECT_EQ(view.units, std::vector<std::string>{"SN1"});
  EXPECT_EQ(view.waiting, std::vector<std::string>{"SN2"});
  EXPECT_EQ(view.process, batch);
  // Homed, and on its way.
  view = look_until([](const StationView& now) { return now.phase.find("step") != std::string::npos; });
  ASSERT_TRUE(view.fraction);
  EXPECT_GE(*view.fraction, 0.0);
  EXPECT_LT(*view.fraction, 1.0);
  EXPECT_SAYS(view.phase, "step");

  EXPECT_OK(act(station_, {"pause", ""}, "ana", *parse_utc("2026-01-02T00:00:00Z")));
  // A second one would be a second Ctrl-C, which stops now.
  look_until([](const StationView& now) { return now.pausing || now.state != StationState::running; }, 5);
  EXPECT_FALSE(act(station_, {"pause", ""}, "eve", 0.0));
  EXPECT_EQ(finish_batch(batch).code, 75);
  EXPECT_EQ(file_text(path("queue.actions")), "2026-01-02T00:00:00Z ana pause\n");
  view = look();
  EXPECT_EQ(view.state, StationState::stopped);
  EXPECT_EQ(view.tone, Tone::attention);
  EXPECT_EQ(view.headline.rfind("unit SN1 is paused", 0), 0U) << view.headline;
  EXPECT_TRUE(view.simulated);
  EXPECT_EQ(view.for_a_person.front(), "start the batch again: it continues with unit SN1");
  EXPECT_FALSE(act(station_, {"stop", ""}, "ana", 0.0));  // nobody is there to be stopped, and nothing is written down
  EXPECT_EQ(file_text(path("queue.actions")), "2026-01-02T00:00:00Z ana pause\n");
}

TEST_F(Serve, AProgramThatEndedLeavesATableOfWhichNothingIsKnown) {
  write("queue", "SN1\n");
  const pid_t batch = start_batch("30");
  look_until([](const StationView& now) { return now.phase.find(" deg at ") != std::string::npos; }, 5);
  ::kill(batch, SIGKILL);
  finish(batch);
  const StationView view = look();
  EXPECT_SAYS(view.headline, "unit SN1 was left unfinished by a program that ended: ");
  EXPECT_SAYS(view.for_a_person.front(), "go to the table before anything else: its state is unknown");
  write("queue", "");
  EXPECT_EQ(look().for_a_person, std::vector<std::string>{view.for_a_person.front()}) << "a removed unit is there, too";
  EXPECT_SAYS(run({"resume", "runs/SN1"}).err, view.for_a_person.front());
  EXPECT_EQ(look().table_warning, "");
}

TEST_F(Serve, SaysWhatStoppedAUnit) {
  for (const std::string kind : {"emergency_stop", "imu_unplugged", "link_lost"}) {
    write("queue", kind + "\n");
    write("f.rig", "fault.1.kind = " + kind + "\nfault.1.time_s = 30\n");
    const std::string said = run({"batch", "queue", "--dry-run", "--out", "runs", "--rig", "f.rig"}).err;
    const std::string why = look().headline.substr(("unit " + kind + " was left unfinished: ").size());
    EXPECT_SAYS(said, "unit " + kind + ": " + why + "\n") << "the same reason";
    EXPECT_SAYS(join(look().for_a_person), why + ": put it right, then start the batch again");
  }
}

TEST_F(Serve, TellsABatchThatItsUnitIsMounted) {
  write("queue", "SN.1\n");
  write("queue.state",
        "pass 2026-01-01T00:00:00Z A\npass 2026-01-01T02:00:00Z B\npass 2026-01-01T02:00:00Z C\n"
        "pass 2026-01-01T04:00:00Z D\npass 2026-01-01T04:00:00Z E\n");
  write("mounted", "SN.1\n");  // of a time before: nobody has said so now
  write("live.station",
        live_station("station.name = live\ntable.address = 127.0.0.1:1\nhook.mount = rm -f " + path("mounted") +
                     "; until grep -qsxFe \"$TURNCAL_UNIT\" " + path("mounted") + "; do sleep 0.1; done\n"));
  const pid_t batch = start({"batch", path("queue"), "--station", path("live.station"), "--out", path("runs")});
  const StationView view = wait_for(StationState::mounting);
  look_until([this](const StationView&) { return !std::filesystem::exists(path("mounted")); });
  EXPECT_EQ(view.headline, "waiting for unit SN.1 to be mounted");
  EXPECT_EQ(view.for_a_person.front(), "mount unit SN.1");
  EXPECT_EQ(format_utc(view.queue_end_utc_s.value_or(0.0)), "2026-01-02T02:00:00Z") << "runs of two take it";
  EXPECT_EQ(view.tone, Tone::attention);
  EXPECT_FALSE(act(station_, {"mounted", "SN2"}, "ana", 0.0));  // not that one
  // Whatever becomes of the queue, the page shows the unit that is waited for.
  write("queue", "SN0\nSN.1\n");
  EXPECT_EQ(look().headline, "waiting for unit SN.1 to be mounted");
  EXPECT_FALSE(act(station_, {"mounted", "SN0"}, "ana", 0.0));
  write("queue", "SN.1\n");
  EXPECT_OK(act(station_, {"mounted", "SN.1"}, "ana", 0.0));
  const ProgramResult result = finish_batch(batch);
  EXPECT_EQ(result.code, 50) << result.err;  // it went on, to devices that are not there
  EXPECT_FALSE(std::filesystem::exists(path("queue.mounting")));
}

TEST_F(Serve, NobodyButAnOperatorChangesAnything) {
  write("queue", "SN1\n");
  Served s(station_, write_operators(std::string("ana:") + hash_of_secret + "\n"));
  bool known = false;
  const auto post = [&](const std::string& name, const std::string& password, bool marked, const std::string& body) {
    // One password in half a second, but for who is known by it.
    if (!known) std::this_thread::sleep_for(std::chrono::milliseconds(600));
    return s.post(name, password, body, marked);
  };
  const std::string add = "station = east\naction = add\nunit = SN%202\n";
  EXPECT_EQ(post("ana", "secret", false, add), 403);  // a form of another page
  EXPECT_EQ(post("ana", "wrong", true, add), 401);
  EXPECT_EQ(post("eve", "secret", true, add), 401);
  EXPECT_EQ(post("ana", "secret", true, "station = west\naction = add\nunit = X\n"), 404);
  known = true;
  EXPECT_EQ(post("ana", "secret", true, "nonsense"), 400);
  EXPECT_EQ(post("ana", "secret", true, std::string(5000, 'x')), 413);
  EXPECT_EQ(post("ana", "secret", true, "station = east\naction = remove\nunit = SN9\n"), 409);
  EXPECT_SAYS(file_text(path("queue.actions")), "ana not done: remove SN9\n");
  EXPECT_EQ(file_text(path("queue")), "SN1\n");
  EXPECT_EQ(post("ana", "secret", true, add), 200);
  EXPECT_EQ(file_text(path("queue")), "SN1\nSN 2\n");
  const auto status = s.client->Get("/status.json");
  ASSERT_TRUE(status);
  EXPECT_SAYS(status->body, "\"SN 2\"");
  EXPECT_EQ(s.client->Get("/queue")->status, 404);
  EXPECT_EQ(Served(station_, {}).post("ana", "secret", add), 404) << "without operators";
}

TEST_F(Serve, ShowsTheResultsOfAllStationsOfADatabase) {
  const double now = *parse_utc("2026-01-02T12:00:00Z");
  EXPECT_SAYS(look_at_results(path("none.db"), now).defect, "none.db");
  Result<ResultsDatabase> database = good(ResultsDatabase::open(path("line.db")));
  struct Row {
    const char *run, *unit, *time, *outcome, *station;
  };
  for (const Row& row : {Row{"r0", "SN0", "2026-01-01T11:00:00Z", "pass", "east"},  // the day before
                         Row{"r1", "SN1", "2026-01-01T13:00:00Z", "fail", "east"},
                         Row{"r3", "SN3", "2026-01-02T11:00:00Z", "interrupted", "east"},  // says nothing of the unit
                         Row{"r2", "SN2", "2026-01-02T10:00:00Z", "pass", "east"},
                         Row{"r4", "SN4", "2026-01-02T11:30:00Z", "running", "east"},
                         Row{"r5", "SN5", "2026-01-02T09:00:00Z", "conditional_pass", "west"}}) {
    AttemptRecord attempt;
    std::tie(attempt.run, attempt.unit, attempt.outcome, attempt.station) =
        std::tie(row.run, row.unit, row.outcome, row.station);
    attempt.began_utc = attempt.time_utc = row.time;
    ASSERT_OK(database->note(attempt));
  }
  const ResultsView view = look_at_results(path("line.db"), now);
  EXPECT_EQ(view.defect, "");
  ASSERT_EQ(view.stations.size(), 2U);
  EXPECT_EQ(view.stations[0].station, "east");
  EXPECT_EQ(view.stations[0].attempts, 3U);
  EXPECT_EQ(view.stations[0].judged, 2U);
  EXPECT_EQ(view.stations[0].passed, 1U);
  EXPECT_EQ(view.stations[0].last_unit, "SN3");
  EXPECT_EQ(view.stations[1].passed, 1U);

  write("queue", "SN1\n");
  Served s(station_, {}, path("line.db"), now);
  std::string body;
  for (int i = 0; i < 200 && body.find("\"last_unit\":\"SN3\"") == std::string::npos; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (const auto status = s.client->Get("/status.json")) body = status->body;
  }
  EXPECT_SAYS(body, "\"last_unit\":\"SN3\"");
}

// All there is of a unit, and nothing that is not: a path leads to reports and certificates alone.
TEST_F(Serve, LeadsToTheReportOfAUnit) {
  write("queue", "SN/1\nSN2\n");
  write("queue.state", "fail 2026-01-01T00:00:00Z SN2 # gyro x bias (N01) 0.0634 deg/h, at most 0.02\n");
  std::filesystem::create_directories(path("runs/SN2/diagnosis"));
  write("runs/SN2/diagnosis/report.html", "the report");
  write("runs/SN2/certificate.html", "the certificate");
  write("runs/SN2/secret.html", "secret");
  Served s(station_, {});
  const auto get = [&s](const std::string& at) {
    for (;;) {  // asked again until it is made
      const auto answer = s.client->Get(at);
      if (!answer || answer->status != 200) return std::string();
      if (answer->body.find("being made") == std::string::npos) return answer->body;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  };
  const std::string page = get("/unit/SN2");
  EXPECT_SAYS(page, "<b>Fail:</b> gyro x bias (N01) 0.0634 deg/h");
  EXPECT_SAYS(page, "<a href=\"/report/1/SN2/report.html\">report</a>");
  EXPECT_EQ(get("/unit/?SN2"), page);
  EXPECT_SAYS(get("/unit/SN%2F1"), "No run of this unit is on record.");
  EXPECT_EQ(get("/report/1/SN2/report.html"), "the report");
  EXPECT_EQ(get("/report/1/SN2/certificate.html"), "the certificate");
  for (const char* none :
       {"/unit/SN%00", "/unit/", "/report/1/SN2/secret.html", "/report/2/SN2/report.html",
        "/report/1/../runs/report.html", "/report/1/%2E%2E/report.html", "/report/1/SN2%00/report.html"})
    EXPECT_EQ(get(none), "") << none;
  const std::string metrics = get("/metrics");
  EXPECT_SAYS(metrics, "# TYPE turncal_queue_done gauge\nturncal_queue_done{station=\"east\"} 1\n");
  EXPECT_SAYS(metrics, "turncal_queue_passed{station=\"east\"} 0\n");
  EXPECT_SAYS_NOT(metrics, "turncal_run_progress_ratio{");
}

TEST_F(Serve, WhoGuessesHoldsUpNobodyWhoIsKnown) {
  write("queue", "SN1\n");
  Served s(station_, write_operators(std::string("ana:") + hash_of_secret + "\n"));
  EXPECT_EQ(s.post_of_ana("secret", "add\nunit = A"), 200);
  for (int i = 0; i < 5; ++i) {
    EXPECT_NE(s.post_of_ana("guess" + std::to_string(i), "add\nunit = X"), 200);
    EXPECT_EQ(s.post_of_ana("secret", "add\nunit = B" + std::to_string(i)), 200);
  }
  write_operators(std::string("eve:") + hash_of_secret + "\n");
  EXPECT_NE(s.post_of_ana("secret", "add\nunit = C"), 200);  // taken out is out at once
}

// An operator who was never let in before, while somebody guesses without a pause: the stop comes through, the rest waits.
TEST_F(Serve, WhoGuessesKeepsNobodyFromStopping) {
  write("queue", "SN1\n");
  Served s(station_, write_operators(std::string("ana:") + hash_of_secret + "\n"));
  for (int i = 0; i < 20; ++i) {
    EXPECT_NE(s.post_of_ana("guess" + std::to_string(i), "pause"), 200);
    EXPECT_EQ(s.post_of_ana("guess" + std::to_string(i), "stop"), 401) << "wrong, and not put off";
  }
  EXPECT_EQ(s.post_of_ana("secret", "pause"), 429);
  EXPECT_EQ(s.post_of_ana("secret", "stop"), 409) << "let in: nothing runs that could be stopped";
}

// One that writes nothing, one that is suspended; and who looks without a pause keeps nobody from ending it.
TEST_F(Serve, ARunThatStandsIsSaid) {
  write("queue", "SN1\n");
  const pid_t batch = start_batch("30");
  for (const double began_s = monotonic_s(); look().state != StationState::running && monotonic_s() - began_s < 30.0;) {
  }
  EXPECT_FALSE(look_at(station_, wall_utc_s()).silent_s);
  const StationView silent = look_at(station_, wall_utc_s() + 700.0);
  EXPECT_TRUE(silent.silent_s && *silent.silent_s < 701.0);
  EXPECT_SAYS(silent.for_a_person.front(), "the run has written nothing for");
  ::kill(batch, SIGSTOP);
  const StationView view = look_until([](const StationView& now) { return !now.for_a_person.empty(); });
  EXPECT_EQ(view.tone, Tone::attention);
  ASSERT_FALSE(view.for_a_person.empty());
  EXPECT_SAYS(view.for_a_person.front(), "is suspended");
  ::kill(batch, SIGCONT);
  ::kill(batch, SIGTERM);
  EXPECT_EQ(finish_batch(batch).code, 75);
}

// A command that appends what it is given to `heard`, and then does `and_then`.
AlertConfig telling(const std::string& heard, const std::string& record, const std::string& and_then = "true") {
  return {.command = "{ printf '%s ' \"$TURNCAL_EVENT\"; cat; } >> " + heard + "; " + and_then,
          .record = record,
          .time_s = 1.0,
          .least_yield = 0.8};
}

TEST_F(Serve, TellsOfAnEventOnceAtMost) {
  const AlertConfig config = telling(path("heard"), path("alerts"));
  StationView view;
  view.name = "east";
  view.outcomes = {{"SN1", "fail", "2026-01-01T00:00:00Z", "N01"}, {"SN2", "pass", "2026-01-01T00:00:00Z"}};
  double now_s = 0.0;
  // Looks for two minutes, and is gone when all is said; what was said meanwhile.
  const auto looked = [&](const std::optional<ResultsView>& results = {}) {
    Result<std::unique_ptr<Alerts>> alerts = Alerts::open(config);
    EXPECT_TRUE(alerts) << alerts.error().message;
    for (int i = 0; i < 120; ++i) (*alerts)->look({view}, results, now_s += 1.0);
    (*alerts)->drain();
    EXPECT_EQ((*alerts)->defect(), "");
    const std::string heard = std::filesystem::exists(path("heard")) ? file_text(path("heard")) : "";
    std::filesystem::remove(path("heard"));
    return heard;
  };
  EXPECT_EQ(looked(), "");  // what stood when the record was begun
  std::filesystem::create_directories((view.runs = path("runs")) + "/SN%223.2");
  view.outcomes.insert(view.outcomes.begin(), {"SN\"3", "hold", "2026-01-01T02:00:00Z", "unexplained"});
  EXPECT_EQ(
      looked(),
      "unit "
      "{\"event\":\"unit\",\"station\":\"east\",\"unit\":\"SN\\\"3\",\"outcome\":\"hold\",\"message\":\"unexplained\","
      "\"time_utc\":\"2026-01-01T02:00:00Z\",\"folder\":\"" +
          view.runs + "/SN%223.2\",\"simulated\":false}\n");
  EXPECT_EQ(looked(), "");

  // A condition: when it has stood, and again when it was over.
  view.state = StationState::stopped;
  view.tone = Tone::bad;
  view.headline = "unit SN4 was left in the middle: fault: drive";
  EXPECT_SAYS(
      looked(),
      "stopped {\"event\":\"stopped\",\"station\":\"east\",\"unit\":\"\",\"outcome\":\"\",\"message\":\"unit SN4");
  EXPECT_EQ(looked(), "");
  view.state = StationState::running;
  view.silent_s = 700.0;
  EXPECT_SAYS(looked(), "nothing written for");
  view.silent_s.reset();
  view.state = StationState::stopped;
  view.table_warning = "go to the table";
  EXPECT_SAYS(looked(), "fault: drive; go to the table");
  view.tone = Tone::attention;  // paused
  ResultsView results;
  results.stations.emplace_back().station = "east";
  std::tie(results.stations[0].judged, results.stations[0].passed) = std::tuple(10, 8);
  EXPECT_EQ(looked(results), "");
  results.stations.front().passed = 7;
  EXPECT_SAYS(looked(results), "7 of 10 passed in the last 24 hours, expected 80 %");
  EXPECT_EQ(looked(), "");  // the database is away
  EXPECT_EQ(looked(results), "");

  // A record that has become long is cut, and what was told in its beginning and is still seen is not told again.
  std::string text = file_text(path("alerts"));
  while (text.size() < (std::size_t{3} << 20))
    text += "2026-01-01T03:00:00Z told unit east OLD" + std::to_string(text.size()) + " fail 2026-01-01T00:00:00Z\n";
  write("alerts", text);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(looked(results), "");
  EXPECT_LT(std::filesystem::file_size(path("alerts")), std::size_t{1} << 20);
}

TEST_F(Serve, AnAlertThatFailsHoldsNobodyUpAndIsShown) {
  write("queue", "SN1\n");
  write("alerts", "");
  write("queue.state", "fail 2026-01-01T00:00:00Z SN1 # N01\n");
  const auto open = [&](const std::string& and_then) {
    const AlertConfig alert = telling(path("heard"), path("alerts"), and_then);
    return ServicePage::open("127.0.0.1:0",
                             {.stations = {station_}, .password_file = "", .database = {}, .alert = alert},
                             [] { return 1.7e9; });
  };
  Result<std::unique_ptr<ServicePage>> page = open("sleep 60");
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_FALSE(open("true"));  // two would tell it twice
  httplib::Client client((*page)->url().substr(0, (*page)->url().size() - 1));
  std::string body;
  for (int i = 0; i < 100 && body.find("within its time") == std::string::npos; ++i) {
    const double before_s = monotonic_s();
    const auto answer = client.Get("/status.json");
    ASSERT_TRUE(answer);
    EXPECT_LT(monotonic_s() - before_s, 0.5);
    body = answer->body;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_SAYS(body, "alert.command: did not end within its time and was killed");
  EXPECT_SAYS(file_text(path("alerts")), " told unit east SN1 fail 2026-01-01T00:00:00Z\n");
  EXPECT_SAYS(file_text(path("alerts")), " failed unit east SN1 fail 2026-01-01T00:00:00Z: alert.command: did not end");
  page->reset();
  EXPECT_TRUE(open("true"));
  EXPECT_EQ(std::ranges::count(file_text(path("heard")), '\n'), 1);
}

}  // namespace
}  // namespace turncal
