#include "orchestrator/line_report/history_table.h"

#include "calib/model/parameters.h"

namespace turncal {

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
