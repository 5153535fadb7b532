#include "orchestrator/service/alerts.h"

#include <fmt/format.h>

#include <utility>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/station/hooks.h"

namespace turncal {

namespace {

constexpr std::size_t largest_record = std::size_t{1} << 26;
constexpr std::string_view of_unit = "unit ", of_yield = "yield ";

std::string key_of(const Alert& a) {
  return a.event + " " + a.station + (a.unit.empty() ? "" : fmt::format(" {} {} {}", a.unit, a.outcome, a.time_utc));
}

}  // namespace

Fields fields_of(Alert& a) {
  return {{"event", &a.event},     {"station", &a.station},   {"unit", &a.unit},     {"outcome", &a.outcome},
          {"message", &a.message}, {"time_utc", &a.time_utc}, {"folder", &a.folder}, {"simulated", &a.simulated}};
}

std::vector<Alert> alerts_in(const std::vector<StationView>& stations, const std::optional<ResultsView>& results,
                             const AlertConfig& config, double now_utc_s) {
  std::vector<Alert> alerts;
  for (const StationView& v : stations) {
    for (const UnitOutcome& o : v.outcomes)
      if (wants_a_look(o.outcome))
        alerts.push_back({"unit", v.name, o.unit, o.outcome, o.reason, o.time_utc, "", v.simulated});
    const auto stands = [&](const char* event, const std::string& message) {
      alerts.push_back({event, v.name, "", "", message, format_utc(now_utc_s), v.folder, v.simulated});
    };
    if (v.state == StationState::unreadable) stands("unreadable", v.headline);
    if (v.state == StationState::stopped && v.tone == Tone::bad) stands("stopped", v.headline);
    if (v.silent_s) stands("silent", v.headline + ": nothing written for " + clock_time(*v.silent_s));
  }
  if (results && results->until_utc.empty() && config.least_yield)
    for (const StationResults& s : results->stations)
      if (s.judged >= Alerts::least_judged &&
          static_cast<double>(s.passed) < *config.least_yield * static_cast<double>(s.judged))
        alerts.push_back({"yield", s.station, "", "",
                          fmt::format("{} of {} passed in the last 24 hours, expected {:.0f} %", s.passed, s.judged,
                                      *config.least_yield * 100.0),
                          format_utc(now_utc_s), "", s.simulated});
  return alerts;
}

Result<std::unique_ptr<Alerts>> Alerts::open(const AlertConfig& config) {
  LockFile lock = TRY(LockFile::acquire(config.record + ".lock"));
  std::unique_ptr<Alerts> alerts(new Alerts(config, std::move(lock)));
  alerts->first_ = !path_exists(config.record);
  TRY(append_durably(config.record, ""));
  const std::string text = TRY(read_whole_file(config.record, largest_record));
  for (std::string_view remaining = text; !remaining.empty();) {
    const std::vector<std::string_view> words = split(next_line(remaining), ' ');
    if (words.size() < 3) continue;
    const std::string key(words[2].data(), static_cast<std::size_t>(words.back().end() - words[2].begin()));
    if (words[1] == "known" || words[1] == "told") alerts->known_.insert(key);
    if (words[1] == "over") alerts->known_.erase(key);
  }
  return alerts;
}

Alerts::~Alerts() { over_ = true; }

void Alerts::look(const std::vector<StationView>& stations, const std::optional<ResultsView>& results,
                  double now_utc_s) {
  std::set<std::string> stand;
  for (Alert& alert : alerts_in(stations, results, config_, now_utc_s)) {
    const std::string key = key_of(alert);
    if (alert.unit.empty()) {
      stand.insert(key);
      const double since_s = since_.try_emplace(key, now_utc_s).first->second;
      alert.time_utc = format_utc(since_s);
      if (!first_ && now_utc_s - since_s < stands_s) continue;
    }
    if (known_.contains(key)) continue;
    const bool taken = first_ ? queue_.post([this, key] { write("known", key); })
                              : queue_.post([this, alert, key] { tell(alert, key); });
    if (taken) known_.insert(key);  // else at the next look
  }
  first_ = false;
  std::erase_if(since_, [&](const auto& one) { return !stand.contains(one.first); });
  const bool yields_known = results && results->defect.empty();
  std::erase_if(known_, [&](const std::string& key) {
    return !key.starts_with(of_unit) && !stand.contains(key) && (yields_known || !key.starts_with(of_yield)) &&
           queue_.post([this, key] { write("over", key); });
  });
}

bool Alerts::write(const char* what, const std::string& key) {
  if (over_) return false;  // an event that is not written is one when serve begins again
  const std::string line = fmt::format("{} {} {}", format_utc(wall_utc_s()), what, key);
  const Status written = append_durably(config_.record, line + "\n");
  const std::lock_guard lock(mutex_);
  lines_.push_back(written ? line : written.error().message);
  if (!written) defect_ = written.error().message;
  return bool(written);
}

void Alerts::tell(Alert alert, const std::string& key) {
  if (!write("told", key)) return;
  const Status told = run_command("alert.command", config_.command,
                                  {.event = alert.event,
                                   .unit = alert.unit,
                                   .folder = alert.folder,
                                   .message = alert.message,
                                   .outcome = alert.outcome,
                                   .dry_run = alert.simulated,
                                   .input = json_of(fields_of(alert)) + "\n"},
                                  config_.time_s, [this] { return over_.load(); });
  {
    const std::lock_guard lock(mutex_);
    defect_ = told ? "" : key + ": " + told.error().message;
  }
  if (!told) write("failed", key + ": " + told.error().message);
}

std::string Alerts::defect() const {
  const std::lock_guard lock(mutex_);
  return defect_;
}

std::vector<std::string> Alerts::take_lines() {
  const std::lock_guard lock(mutex_);
  return std::exchange(lines_, {});
}

}  // namespace turncal
