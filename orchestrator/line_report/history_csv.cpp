#include "orchestrator/line_report/history_csv.h"

#include "calib/model/parameters.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

// A negative number is no formula.
std::string csv_text(std::string text) {
  if (text.find_first_of("=+-@\t\r") == 0 && !parse_number(text)) text.insert(0, "'");
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string cell(std::optional<double> value) { return value ? format_number(*value) : ""; }
std::string cell(bool value) { return value ? "true" : "false"; }

}  // namespace

std::string csv_row(const std::vector<std::string>& cells) {
  std::string row;
  for (const std::string& text : cells) row += (row.empty() && &text == &cells.front() ? "" : ",") + csv_text(text);
  return row + "\n";
}

std::string calibrations_csv(const std::vector<StoredCalibration>& all) {
  std::vector<std::string> head = {"id",       "unit",      "time_utc", "verdict",        "station",
                                   "operator", "simulated", "sessions", "recording_hash", "folder"};
  for (const std::string_view key : parameter_keys) {
    head.emplace_back(key);
    head.push_back("sigma." + std::string(key));
  }
  std::string text = csv_row(head);
  for (const StoredCalibration& c : all) {
    std::vector<std::string> row = {std::to_string(c.id),
                                    c.unit,
                                    c.time_utc,
                                    c.verdict,
                                    c.station,
                                    c.operator_name,
                                    cell(c.simulated),
                                    std::to_string(c.sessions),
                                    c.recording_hash,
                                    c.folder};
    for (const StoredValue& value : c.values) {
      row.push_back(format_number(value.value));
      row.push_back(cell(value.sigma));
    }
    text += csv_row(row);
  }
  return text;
}

std::string attempts_csv(const std::vector<AttemptRecord>& all) {
  std::string text = csv_row({"id",
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
    text += csv_row({std::to_string(a.id),
                     a.unit,
                     a.began_utc,
                     a.time_utc,
                     a.outcome,
                     a.reason,
                     a.station,
                     a.part,
                     a.revision,
                     a.operator_name,
                     a.ambient,
                     cell(a.simulated),
                     cell(a.temperature_min_c),
                     cell(a.temperature_max_c),
                     cell(a.residual),
                     a.diagnosis,
                     cell(a.recorded_s),
                     std::to_string(a.sessions),
                     std::to_string(a.repeated_dwells),
                     std::to_string(a.lost_samples),
                     a.calibration ? std::to_string(*a.calibration) : "",
                     a.folder});
  }
  return text;
}

}  // namespace turncal
