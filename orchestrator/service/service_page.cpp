#include "orchestrator/service/service_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/line/shift_report.h"
#include "orchestrator/records/journal.h"
#include "orchestrator/report/document.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/page_server.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

extern const std::string_view service_page_html;  // service_page.html

namespace {

constexpr auto between_looks = std::chrono::seconds(1);
constexpr auto between_results = std::chrono::seconds(10);
constexpr double between_passwords_s = 0.5;

constexpr std::string_view unit_path = "/unit/";
constexpr std::size_t most_made = 32, largest_report_bytes = std::size_t{1} << 24;
constexpr double made_for_s = 10.0;

PageAnswer said(int code, const std::string& text) { return {code, {"text/plain; charset=utf-8", text + "\n"}}; }

struct OpenPage : ServicePage {
  // The page of a unit or a run; empty: there is none.
  struct MadePage {
    std::optional<PageText> text;
    double at_s = 0.0;
  };

  ServiceConfig config;
  std::function<double()> now_utc_s;
  std::mutex mutex;  // guards the following
  std::condition_variable wake;
  bool over = false;
  std::string json, metrics;
  std::optional<ResultsView> results;
  std::map<std::string, MadePage> made;  // by path
  // Used by the server's thread alone. A name that was once admitted does not wait for password guessers; its password is checked each time.
  double password_s = -1e9;
  std::set<std::size_t> welcome;
  std::unique_ptr<PageServer> server;
  std::unique_ptr<Alerts> alerts;                      // null: none
  BackgroundQueue maker{BackgroundQueue::By::thread};  // makes requested pages
  std::jthread looker, reader;  // looker: the stations' files; reader: the database, which may be slow

  ~OpenPage() override {
    server.reset();
    const std::lock_guard lock(mutex);
    over = true;
    wake.notify_all();
  }

  std::string url() const override { return server->url(); }
  bool loopback() const override { return server->loopback(); }

  void look(bool alerting) {
    std::vector<std::string> stations;
    std::vector<StationView> views;
    std::unique_lock lock(mutex);
    const std::optional<ResultsView> newest_results = results;
    lock.unlock();
    const double now = now_utc_s();
    for (const ServedStation& station : config.stations) {
      views.push_back(look_at(station, now));
      stations.push_back(json_of(views.back()));
    }
    if (alerts && alerting) alerts->look(views, newest_results, now);
    JsonObject o;
    o.text("time_utc", format_utc(now));
    o.text("alert_defect", alerts ? alerts->defect() : "");
    o.flag("acts", !config.password_file.empty());
    o.list("stations", stations);
    o.raw("results", newest_results ? json_of(*newest_results) : "null");
    std::string newest_metrics = metrics_of(views, newest_results.value_or(ResultsView{}), now);
    lock.lock();
    json = o.end();
    metrics = std::move(newest_metrics);
  }

  void read() {
    ResultsView newest = look_at_results(config.database, now_utc_s());
    const std::lock_guard lock(mutex);
    results = std::move(newest);
  }

  void keep(const std::function<void()>& job, std::chrono::seconds between) {
    for (std::unique_lock lock(mutex); !over; wake.wait_for(lock, between, [this] { return over; })) {
      lock.unlock();
      job();
      lock.lock();
    }
  }

  std::optional<PageText> make(const std::string& path) const {
    const std::string plain = unescaped_value(path);
    constexpr const char* html = "text/html; charset=utf-8";
    if (const std::optional<std::string> file = report_file(config, plain)) {
      const Result<std::string> text = read_whole_file(*file, largest_report_bytes);
      return text ? std::optional(PageText{html, *text}) : std::nullopt;
    }
    if (!path.starts_with(unit_path)) return {};
    const bool asked = path.substr(unit_path.size()).starts_with("?");  // /unit/?SERIAL, since no path ends in unit ..
    const std::string unit = plain.substr(unit_path.size() + (asked ? 1 : 0));
    if (!check_serial(unit, "unit")) return {};
    return PageText{html, as_page(unit_document(config, unit)).html};
  }

  void make_anew(const std::string& path) {
    std::optional<PageText> text = make(path);
    const std::lock_guard lock(mutex);
    if (made.size() >= most_made)
      made.erase(std::ranges::min_element(made, {}, [](const auto& one) { return one.second.at_s; }));
    made[path] = {std::move(text), monotonic_s()};
  }

  PageAnswer post(const PagePost& request) {
    if (request.path != "/act") return said(404, "Not Found");
    Result<KeyValueFile> wanted = KeyValueFile::parse(request.body, "request");
    if (!wanted) return said(400, wanted.error().message);
    const StationAction action{wanted->text("action"), unescaped_value(wanted->text_or("unit", ""))};
    const double now_s = monotonic_s();
    const std::size_t who = std::hash<std::string>{}(request.authorization);
    // Password guessing must not keep an operator from stopping a table.
    const bool waits = !welcome.contains(who) && action.action != "stop";
    if (waits && now_s - password_s < between_passwords_s) return said(429, "too soon: try again in a second");
    if (waits) password_s = now_s;
    const Result<std::string> name = authorised_operator(config.password_file, request.authorization);
    if (!name) {
      welcome.erase(who);
      return said(401, name.error().message);
    }
    welcome.insert(who);
    const std::string station = unescaped_value(wanted->text("station"));
    if (Status status = wanted->check_all_used(); !status) return said(400, status.error().message);
    const auto at = std::ranges::find(config.stations, station, &ServedStation::name);
    if (at == config.stations.end()) return said(404, "no such station");
    const Result<std::string> done = act(*at, action, *name, now_utc_s());
    look(false);
    return done ? said(200, *done) : said(409, done.error().message);
  }

  std::optional<PageText> page(std::string_view path) {
    const std::lock_guard lock(mutex);
    if (path == "/status.json") return PageText{"application/json", json};
    if (path == "/metrics") return PageText{"text/plain; version=0.0.4; charset=utf-8", metrics};
    if (path == "/") return page_with(service_page_html, json);
    if (!path.starts_with(unit_path) && !path.starts_with("/report/")) return {};
    // Made by another thread, so that no drawing delays a stop.
    const auto there = made.find(std::string(path));
    const bool old = there == made.end() || monotonic_s() - there->second.at_s > made_for_s;
    if (old && maker.pending() == 0) maker.post([this, path = std::string(path)] { make_anew(path); });
    if (there != made.end()) return there->second.text;
    std::string html = as_page(Document{"turncal", "The page is being made."}).html;
    html.insert(html.find("</head>"), "<meta http-equiv=\"refresh\" content=\"1\">");
    return PageText{"text/html; charset=utf-8", html};
  }
};

}  // namespace

Result<std::unique_ptr<ServicePage>> ServicePage::open(const std::string& address, const ServiceConfig& config,
                                                       std::function<double()> now_utc_s) {
  const bool acts = !config.password_file.empty();
  if (acts) TRY(check_operators(config.password_file));
  auto page = std::make_unique<OpenPage>();
  OpenPage& one = *page;
  one.config = config;
  one.now_utc_s = std::move(now_utc_s);
  if (!config.alert.command.empty()) one.alerts = TRY(Alerts::open(config.alert));
  one.look(true);
  PageServer::Posts posts;
  if (acts) posts = [&one](const PagePost& request) { return one.post(request); };
  std::unique_ptr<PageServer> server = TRY(PageServer::open(
      address, [&one](std::string_view path) { return one.page(path); }, {.connections = 256}, std::move(posts)));
  if (acts && !server->loopback())
    return input_error("--listen '" + address +
                       "': with serve.password_file a loopback address is expected, behind a proxy that encrypts");
  one.server = std::move(server);
  one.looker = start_without_signals([&one] { one.keep([&one] { one.look(true); }, between_looks); });
  if (!config.database.empty())
    one.reader = start_without_signals([&one] { one.keep([&one] { one.read(); }, between_results); });
  return std::unique_ptr<ServicePage>(std::move(page));
}

// ---- alerts ----

namespace {

constexpr std::uintmax_t largest_record = std::uintmax_t{1} << 20;  // bytes
constexpr std::string_view of_unit = "unit ", of_yield = "yield ";

struct Event {
  HookCall call;
  std::string station, time_utc;
  std::string key() const {
    return call.event + " " + station +
           (call.unit.empty() ? "" : fmt::format(" {} {} {}", call.unit, call.outcome, time_utc));
  }
};

std::string json_of(Event event) {
  auto& [call, station, time_utc] = event;
  const Fields fields = {{"event", &call.event},     {"station", &station},       {"unit", &call.unit},
                         {"outcome", &call.outcome}, {"message", &call.message},  {"time_utc", &time_utc},
                         {"folder", &call.folder},   {"simulated", &call.dry_run}};
  return json_of(fields) + "\n";
}

std::vector<Event> events_in(const std::vector<StationView>& stations, const std::optional<ResultsView>& results,
                             std::optional<double> least_yield) {
  std::vector<Event> events;
  for (const StationView& v : stations) {
    for (const UnitOutcome& o : v.outcomes)
      if (standing_of(&o) == Standing::not_passed)
        events.push_back(
            {{"unit", o.unit, last_folder(v.runs, o.unit), o.reason, o.outcome, v.simulated}, v.name, o.time_utc});
    const auto stands = [&](const char* event, const std::string& message) {
      events.push_back({{event, "", v.folder, message, "", v.simulated}, v.name, ""});
    };
    if (v.state == StationState::unreadable) stands("unreadable", v.headline);
    if (v.state == StationState::stopped && v.tone == Tone::bad)
      stands("stopped", v.headline + (v.table_warning.empty() ? "" : "; " + v.table_warning));
    if (v.silent_s) stands("silent", v.headline + ": nothing written for " + clock_time(*v.silent_s));
  }
  if (!results || !results->until_utc.empty() || !least_yield) return events;
  for (const StationResults& s : results->stations)
    if (s.judged >= Alerts::least_judged && !Share{s.passed, s.judged}.reaches(*least_yield))
      events.push_back({{"yield", "", "",
                         fmt::format("{} of {} passed in the last 24 hours, expected {:.0f} %", s.passed, s.judged,
                                     *least_yield * 100.0),
                         "", s.simulated},
                        s.station,
                        ""});
  return events;
}

// Returns the keys of the events in a record.
std::set<std::string> known_in(std::string_view record) {
  std::set<std::string> known;
  while (!record.empty()) {
    const std::vector<std::string_view> words = split(next_line(record), ' ');
    if (words.size() < 3) continue;
    const std::string key(words[2].data(), std::size_t(words.back().end() - words[2].begin()));
    if (words[1] == "known" || words[1] == "told") known.insert(key);
    if (words[1] == "over") known.erase(key);
  }
  return known;
}

std::string record_line(std::string_view what, std::string_view key) {
  return fmt::format("{} {} {}\n", format_utc(wall_utc_s()), what, key);
}

// Shortens a record to its newer half and, of the older one, what still matters: current `events`, and conditions.
void shorten(const std::string& path, const std::set<std::string>& events) {
  const Result<std::string> text = read_whole_file(path, std::string::npos);
  if (!text || text->size() <= largest_record) return;  // tried again at the next look
  const std::size_t newer = text->find('\n', text->size() - largest_record / 2) + 1;
  std::string kept;
  for (const std::string& key : known_in(std::string_view(*text).substr(0, newer)))
    if (!key.starts_with(of_unit) || events.contains(key)) kept += record_line("known", key);
  static_cast<void>(write_file_atomically(path, kept + text->substr(newer)));
}

}  // namespace

Result<std::unique_ptr<Alerts>> Alerts::open(const AlertConfig& config) {
  std::unique_ptr<Alerts> alerts(new Alerts(config, TRY(LockFile::acquire(config.record + ".lock"))));
  alerts->first_ = !path_exists(config.record);
  TRY(append_durably(config.record, ""));
  alerts->known_ = known_in(TRY(read_whole_file(config.record, std::string::npos)));
  return alerts;
}

void Alerts::look(const std::vector<StationView>& stations, const std::optional<ResultsView>& results,
                  double now_utc_s) {
  std::set<std::string> stand, events;
  for (Event& event : events_in(stations, results, config_.least_yield)) {
    const std::string key = event.key();
    events.insert(key);
    if (event.call.unit.empty()) {
      stand.insert(key);
      const double since_s = since_.try_emplace(key, now_utc_s).first->second;
      event.time_utc = format_utc(since_s);
      if (!first_ && now_utc_s - since_s < stands_s) continue;
    }
    if (known_.contains(key)) continue;
    event.call.input = first_ ? "" : json_of(event);
    if (queue_.post([this, call = event.call, key] { tell(call, key); })) known_.insert(key);  // else at the next look
  }
  first_ = false;
  std::erase_if(since_, [&](const auto& one) { return !stand.contains(one.first); });
  const bool yields_known = results && results->defect.empty();
  std::erase_if(known_, [&](const std::string& key) {
    return !key.starts_with(of_unit) && !stand.contains(key) && (yields_known || !key.starts_with(of_yield)) &&
           queue_.post([this, key] { static_cast<void>(write("over", key)); });
  });
  std::error_code unknown;
  if (std::filesystem::file_size(config_.record, unknown) > largest_record && !unknown)
    static_cast<void>(queue_.post([this, events] { shorten(config_.record, events); }));
}

Status Alerts::write(const char* what, const std::string& key) const {
  return append_durably(config_.record, record_line(what, key));
}

void Alerts::tell(const HookCall& call, const std::string& key) {
  if (over_) return;  // not recorded, so it is an event when serve begins again
  Status told = write(call.input.empty() ? "known" : "told", key);
  if (told && !call.input.empty()) {
    told = run_command("alert.command", config_.command, call, config_.time_s, [this] { return over_.load(); });
    if (!told) static_cast<void>(write("failed", key + ": " + told.error().message));
  }
  const std::lock_guard lock(mutex_);
  defect_ = told ? "" : key + ": " + told.error().message;
}

std::string Alerts::defect() const {
  const std::lock_guard lock(mutex_);
  return defect_;
}

}  // namespace turncal
