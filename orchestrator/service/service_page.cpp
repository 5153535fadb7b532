#include "orchestrator/service/service_page.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/records/journal.h"
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

}  // namespace

struct ServicePage::State {
  // Of a unit or a run; empty: there is none.
  struct MadePage {
    std::optional<PageText> text;
    double at_s = 0.0;
  };

  ServiceConfig config;
  std::function<double()> now_utc_s;
  std::mutex mutex;  // of what follows
  std::condition_variable wake;
  bool over = false;
  std::string json, metrics;
  std::optional<ResultsView> results;
  std::string asked_for;                 // a page of a unit or a run that a client waits for
  std::map<std::string, MadePage> made;  // by path
  // The server's thread alone. Who was let in once does not wait for those who guess; the password is looked at each time.
  double password_s = -1e9;
  std::set<std::size_t> welcome;
  std::thread looker, reader,
      maker;  // of the stations' files; of the database, which may keep its reader waiting; of pages that are asked for
  std::unique_ptr<PageServer> server;
  std::unique_ptr<Alerts> alerts;  // nothing: none are wanted

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
    const std::string unit = plain.starts_with(unit_path) ? plain.substr(unit_path.size()) : "";
    if (!check_serial(unit, "unit")) return {};
    return PageText{html, as_page(unit_document(config, unit)).html};
  }

  void keep_making() {
    std::unique_lock lock(mutex);
    for (;;) {
      wake.wait(lock, [this] { return over || !asked_for.empty(); });
      if (over) return;
      const std::string path = std::exchange(asked_for, "");
      lock.unlock();
      std::optional<PageText> text = make(path);
      lock.lock();
      if (made.size() >= most_made)
        made.erase(std::ranges::min_element(made, {}, [](const auto& one) { return one.second.at_s; }));
      made[path] = {std::move(text), monotonic_s()};
    }
  }

  PageAnswer post(const PagePost& request) {
    if (request.path != "/act") return said(404, "Not Found");
    Result<KeyValueFile> wanted = KeyValueFile::parse(request.body, "request");
    if (!wanted) return said(400, wanted.error().message);
    const StationAction action{wanted->text("action"), unescaped_value(wanted->text_or("unit", ""))};
    const double now_s = monotonic_s();
    const std::size_t who = std::hash<std::string>{}(request.authorization);
    // Whoever guesses passwords must not keep an operator from stopping a table.
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
    const auto at =
        std::ranges::find_if(config.stations, [&station](const ServedStation& one) { return one.name == station; });
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
    // Made by another thread: no drawing keeps a stop waiting.
    const auto there = made.find(std::string(path));
    if (there == made.end() || monotonic_s() - there->second.at_s > made_for_s) {
      asked_for = path;
      wake.notify_all();
    }
    if (there != made.end()) return there->second.text;
    return PageText{"text/html; charset=utf-8",
                    "<!DOCTYPE html><html lang=\"en\"><head>" + std::string(page_head) +
                        "<meta http-equiv=\"refresh\" content=\"1\"><title>turncal</title></head>"
                        "<body><p>The page is being made.</p></body></html>\n"};
  }
};

ServicePage::ServicePage() : state_(std::make_unique<State>()) {}

ServicePage::~ServicePage() {
  state_->server.reset();
  {
    const std::lock_guard lock(state_->mutex);
    state_->over = true;
  }
  state_->wake.notify_all();
  for (std::thread* thread : {&state_->looker, &state_->reader, &state_->maker})
    if (thread->joinable()) thread->join();
}

std::string ServicePage::url() const { return state_->server->url(); }
bool ServicePage::loopback() const { return state_->server->loopback(); }

Result<std::unique_ptr<ServicePage>> ServicePage::open(const std::string& address, const ServiceConfig& config,
                                                       std::function<double()> now_utc_s) {
  const bool acts = !config.password_file.empty();
  if (acts) TRY(check_operators(config.password_file));
  std::unique_ptr<ServicePage> page(new ServicePage);
  State& state = *page->state_;
  state.config = config;
  state.now_utc_s = std::move(now_utc_s);
  if (!config.alert.command.empty()) state.alerts = TRY(Alerts::open(config.alert));
  state.look(true);
  PageServer::Posts posts;
  if (acts) posts = [&state](const PagePost& request) { return state.post(request); };
  std::unique_ptr<PageServer> server = TRY(PageServer::open(
      address, [&state](std::string_view path) { return state.page(path); }, {.connections = 256}, std::move(posts)));
  if (acts && !server->loopback())
    return input_error("--listen '" + address +
                       "': with serve.password_file a loopback address is expected, behind a proxy that encrypts");
  state.server = std::move(server);
  state.looker = start_without_signals([&state] { state.keep([&state] { state.look(true); }, between_looks); });
  state.maker = start_without_signals([&state] { state.keep_making(); });
  if (!config.database.empty())
    state.reader = start_without_signals([&state] { state.keep([&state] { state.read(); }, between_results); });
  return page;
}

}  // namespace turncal
