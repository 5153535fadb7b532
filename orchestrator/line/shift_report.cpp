#include "orchestrator/line/shift_report.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

namespace turncal {

namespace {

std::string words_of(const std::string& name, const RecordFilter& filter) {
  std::string text = name;
  const std::pair<const char*, const std::string*> parts[] = {{"unit", &filter.unit},
                                                              {"station", &filter.station},
                                                              {"part", &filter.part},
                                                              {"from", &filter.from},
                                                              {"to", &filter.to}};
  for (const auto& [word, value] : parts)
    if (!value->empty()) text += std::string(", ") + word + " " + *value;
  return text;
}

ChartedQuantity charted(const std::string& key, const std::vector<AttemptRecord>& attempts,
                        const std::function<std::optional<double>(const AttemptRecord&)>& value_of) {
  ChartedQuantity quantity;
  quantity.key = key;
  for (const AttemptRecord& attempt : attempts) {
    const std::optional<double> value = value_of(attempt);
    if (!value || !attempt.calibration) continue;
    quantity.units.push_back(attempt.unit);
    quantity.times.push_back(attempt.time_utc);
    quantity.values.push_back(*value);
    quantity.sigmas.emplace_back();
  }
  quantity.chart = control_chart(quantity.values, quantity.limit);
  return quantity;
}

std::set<std::int64_t> ids_of(const std::vector<AttemptRecord>& attempts, const std::string& station = "") {
  std::set<std::int64_t> ids;
  for (const AttemptRecord& attempt : attempts)
    if (station.empty() || attempt.station == station) ids.insert(attempt.id);
  return ids;
}

std::vector<StationFigures> figures_of_stations(const std::vector<AttemptRecord>& all,
                                                const std::vector<AttemptRecord>& chosen) {
  std::map<std::string, StationFigures> stations;
  for (const AttemptRecord& attempt : chosen) {
    StationFigures& figures = stations[attempt.station];
    figures.station = attempt.station;
    if (!attempt.residual) continue;
    figures.mean_residual += *attempt.residual;
    ++figures.calibrated;
  }
  std::vector<StationFigures> list;
  for (auto& [name, figures] : stations) {
    figures.yield = line_yield(all, ids_of(chosen, name));
    if (figures.calibrated > 0) figures.mean_residual /= static_cast<double>(figures.calibrated);
    list.push_back(figures);
  }
  return list;
}

}  // namespace

Result<ShiftReport> shift_report(const ResultsDatabase& database, const std::string& name, const RecordFilter& filter,
                                 bool simulated) {
  if (Status status = check(filter); !status) return status.error();
  if (Status status = database.check_known(filter); !status) return status.error();
  Result<std::vector<AttemptRecord>> all = database.attempts({}), chosen = database.attempts(filter);
  if (!all) return all.error();
  if (!chosen) return chosen.error();
  Result<std::vector<StoredCalibration>> calibrations = database.list(filter, "");
  if (!calibrations) return calibrations.error();
  ShiftReport report;
  report.source = words_of(name, filter);
  report.simulated = simulated;
  const auto of_the_other_kind = [simulated](const auto& row) { return row.simulated != simulated; };
  std::erase_if(*all, of_the_other_kind);
  report.of_the_other_kind = std::erase_if(*chosen, of_the_other_kind);
  std::erase_if(*calibrations, of_the_other_kind);
  report.damaged = std::erase_if(*calibrations, [](const StoredCalibration& c) { return !c.defect.empty(); });
  report.attempts = std::move(*chosen);
  report.calibrations = std::move(*calibrations);
  report.yield = line_yield(*all, ids_of(report.attempts));
  report.stations = figures_of_stations(*all, report.attempts);
  report.charts.push_back(charted("residual", report.attempts, [](const AttemptRecord& a) { return a.residual; }));
  report.charts.push_back(
      charted("temperature", report.attempts, [](const AttemptRecord& a) { return a.temperature_max_c; }));
  report.charts.push_back(
      charted("hours", report.attempts, [](const AttemptRecord& a) { return std::optional(hours_of(a)); }));
  for (const std::string_view key : free_parameter_keys())
    report.charts.push_back(parameter_history(report.calibrations, key));
  report.turn_on = repeatability(report.calibrations, 0.0, turn_on_days);
  report.month = repeatability(report.calibrations, month_from_days, month_to_days);
  report.differences = station_differences(report.calibrations);
  return report;
}

std::vector<ChartSignal> signals_of(const std::vector<ChartedQuantity>& charts) {
  std::vector<ChartSignal> found;
  for (const ChartedQuantity& chart : charts) {
    std::map<std::size_t, std::size_t> last;  // point of the last signal, by rule
    for (const RunSignal& signal : chart.chart.signals) {
      const auto before = last.find(signal.rule);
      const bool goes_on = signal.rule != 1 && before != last.end() && before->second + 1 == signal.point;
      last[signal.rule] = signal.point;
      if (!goes_on) found.push_back({&chart, signal});
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const ChartSignal& a, const ChartSignal& b) {
    return a.chart->times[a.signal.point] < b.chart->times[b.signal.point];
  });
  return found;
}

}  // namespace turncal
