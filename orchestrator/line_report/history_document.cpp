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

DataTable calibrations_table(const std::vector<StoredCalibration>& all) {
  std::vector<std::string> columns;
  StoredCalibration named;
  for (const Field& field : fields_of(named)) columns.push_back(field.key);
  for (const std::string_view key : parameter_keys) {
    columns.emplace_back(key);
    columns.push_back("sigma." + std::string(key));
  }
  DataTable table(std::move(columns));
  for (StoredCalibration c : all) {
    add_row(fields_of(c), table);
    for (StoredValue& value : c.values) {
      add_cell({"", &value.value}, table);
      add_cell({"", &value.sigma}, table);
    }
  }
  return table;
}

DataTable attempts_table(const std::vector<AttemptRecord>& all) {
  const std::vector<std::string> columns = {"id",
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
                                            "folder"};
  DataTable table(columns);
  for (AttemptRecord attempt : all) {
    Fields fields = fields_of(attempt);
    fields.push_back({"id", &attempt.id});
    table.begin_row();
    for (const std::string& column : columns) add_cell(field_named(column, fields), table);
  }
  return table;
}

}  // namespace turncal
