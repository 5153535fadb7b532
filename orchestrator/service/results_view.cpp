#include "orchestrator/service/results_view.h"

#include <map>
#include <utility>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/line/line_yield.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

namespace {

constexpr double looked_back_s = 86400.0;
constexpr SqlPatience patience{.wait_s = 2.0, .all_s = 5.0};

Result<std::vector<AttemptRecord>> newest_attempts(const std::string& database, double now_utc_s) {
  const ResultsDatabase open = TRY(ResultsDatabase::open_to_read(database, patience));
  return open.attempts({.from = format_utc(now_utc_s - looked_back_s)});
}

}  // namespace

std::vector<StationResults> results_by_station(const std::vector<AttemptRecord>& attempts) {
  std::map<std::pair<bool, std::string>, StationResults> found;
  for (const AttemptRecord& attempt : attempts) {
    if (attempt.outcome == outcome_running) continue;
    StationResults& station = found[{attempt.simulated, attempt.station}];
    station.station = attempt.station;
    station.simulated = attempt.simulated;
    ++station.attempts;
    const AttemptKind kind = kind_of(attempt);
    station.judged += kind != AttemptKind::says_nothing;
    station.passed += kind == AttemptKind::passed;
    if (attempt.time_utc < station.last_time_utc) continue;
    station.last_unit = attempt.unit;
    station.last_outcome = attempt.outcome;
    station.last_time_utc = attempt.time_utc;
  }
  std::vector<StationResults> stations;
  for (auto& [key, station] : found) stations.push_back(std::move(station));
  return stations;
}

ResultsView look_at_results(const std::string& database, double now_utc_s) {
  const Result<std::vector<AttemptRecord>> attempts = newest_attempts(database, now_utc_s);
  if (!attempts) return {.defect = attempts.error().message, .stations = {}};
  return {.defect = {}, .stations = results_by_station(*attempts)};
}

std::string json_of(const ResultsView& view) {
  std::string stations;
  for (const StationResults& station : view.stations) {
    JsonObject o;
    o.text("station", station.station);
    o.raw("simulated", station.simulated ? "true" : "false");
    o.number("attempts", static_cast<double>(station.attempts));
    o.number("judged", static_cast<double>(station.judged));
    o.number("passed", static_cast<double>(station.passed));
    o.text("last_unit", station.last_unit);
    o.text("last_outcome", station.last_outcome);
    o.text("last_time_utc", station.last_time_utc);
    stations += (stations.empty() ? "" : ",") + o.end();
  }
  JsonObject o;
  o.text("defect", view.defect);
  o.raw("stations", "[" + stations + "]");
  return o.end();
}

}  // namespace turncal
