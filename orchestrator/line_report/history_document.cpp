#include "orchestrator/line_report/history_document.h"

#include <fmt/format.h>

#include "calib/model/parameters.h"
#include "orchestrator/line/parameter_history.h"
#include "orchestrator/line_report/control_panel.h"

namespace turncal {

Document history_document(const std::vector<StoredCalibration>& all, const std::string& source) {
  using namespace cell;
  const bool simulated = !all.empty() && all.front().simulated;
  Document document{"turncal: control charts of " + source, "Control charts"};
  document.soft(fmt::format("{}, {} calibrations{}", source, all.size(), simulated ? " of simulated units" : ""),
                Scope::all);
  if (all.empty()) {
    document.text("No calibration is on record.");
    return document;
  }
  std::vector<ChartedQuantity> histories;
  for (const std::string_view key : free_parameter_keys()) histories.push_back(parameter_history(all, key));
  document.section("control", "Parameters");
  add_control_charts(histories, document);
  document.section("calibrations", "Calibrations");
  Table table{{number("calibration"), number("id"), text("unit"), text("time"), text("verdict"), text("operator"),
               text("station")}};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StoredCalibration& c = all[i];
    table.row({count(i + 1), count(static_cast<std::size_t>(c.id)), text(c.unit), text(c.time_utc), text(c.verdict),
               text(c.operator_name), text(c.station)});
  }
  document.add(std::move(table));
  return document;
}

namespace {

void add(DataTable& table, std::optional<double> value) { value ? table.number(*value) : table.nothing(); }

}  // namespace

DataTable calibrations_table(const std::vector<StoredCalibration>& all) {
  std::vector<std::string> columns = {"id",       "unit",      "time_utc", "verdict",        "station",
                                      "operator", "simulated", "sessions", "recording_hash", "folder"};
  for (const std::string_view key : parameter_keys) {
    columns.emplace_back(key);
    columns.push_back("sigma." + std::string(key));
  }
  DataTable table(std::move(columns));
  for (const StoredCalibration& c : all) {
    table.begin_row();
    table.count(c.id);
    for (const std::string* field : {&c.unit, &c.time_utc, &c.verdict, &c.station, &c.operator_name})
      table.text(*field);
    table.flag(c.simulated);
    table.count(c.sessions);
    table.text(c.recording_hash);
    table.text(c.folder);
    for (const StoredValue& value : c.values) {
      table.number(value.value);
      add(table, value.sigma);
    }
  }
  return table;
}

DataTable attempts_table(const std::vector<AttemptRecord>& all) {
  DataTable table({"id",
                   "unit",
                   "began_utc",
                   "time_utc",
                   "outcome",
                   "reason",
                   "station",
                   "part",
                   "revision",
                   "operator",
                   "ambient",
                   "simulated",
                   "temperature_min_c",
                   "temperature_max_c",
                   "residual",
                   "diagnosis",
                   "recorded_s",
                   "sessions",
                   "repeated_dwells",
                   "lost_samples",
                   "calibration",
                   "folder"});
  for (const AttemptRecord& a : all) {
    table.begin_row();
    table.count(a.id);
    for (const std::string* field : {&a.unit, &a.began_utc, &a.time_utc, &a.outcome, &a.reason, &a.station, &a.part,
                                     &a.revision, &a.operator_name, &a.ambient})
      table.text(*field);
    table.flag(a.simulated);
    for (const std::optional<double>& value : {a.temperature_min_c, a.temperature_max_c, a.residual}) add(table, value);
    table.text(a.diagnosis);
    add(table, a.recorded_s);
    table.count(a.sessions);
    table.count(a.repeated_dwells);
    table.count(static_cast<std::int64_t>(a.lost_samples));
    a.calibration ? table.count(*a.calibration) : table.nothing();
    table.text(a.folder);
  }
  return table;
}

}  // namespace turncal
