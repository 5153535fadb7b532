#include "orchestrator/service/service_page.h"

#include <fmt/format.h>

#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

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
    if (v.state == StationState::stopped && v.tone == Tone::bad) stands("stopped", v.headline);
    if (v.silent_s) stands("silent", v.headline + ": nothing written for " + clock_time(*v.silent_s));
  }
  if (!results || !results->until_utc.empty() || !least_yield) return events;
  for (const StationResults& s : results->stations)
    if (s.judged >= Alerts::least_judged && double(s.passed) < *least_yield * double(s.judged))
      events.push_back({{"yield", "", "",
                         fmt::format("{} of {} passed in the last 24 hours, expected {:.0f} %", s.passed, s.judged,
                                     *least_yield * 100.0),
                         "", s.simulated},
                        s.station,
                        ""});
  return events;
}

// Keys of the events that a record knows.
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

// A record that has become too long keeps its newer half, and of the older one what is still seen: `events`, and the conditions.
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
  if (over_) return;  // not written, so an event when serve begins again
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
