#include "orchestrator/records/attempt_record.h"

#include <algorithm>

#include "imu_io/base/text_pieces.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/records/sqlite_statement.h"

namespace turncal {

namespace {

constexpr std::string_view form = "dddd-dd-ddTdd:dd:ddZ";

bool begins_a_time(std::string_view text) {
  constexpr std::size_t shortest = 4;  // a year
  if (text.empty()) return true;
  if (text.size() < shortest || text.size() > form.size() || text.back() == '-' || text.back() == ':') return false;
  return std::equal(text.begin(), text.end(), form.begin(),
                    [](char c, char wanted) { return wanted == 'd' ? c >= '0' && c <= '9' : c == wanted; });
}

constexpr const char* columns =
    "run, unit, began_utc, time_utc, outcome, reason, simulated, station, operator, part, revision, ambient, "
    "temperature_min_c, temperature_max_c, residual, diagnosis, recorded_s, sessions, repeated_dwells, lost_samples, "
    "folder, calibration";

}  // namespace

Status check(const RecordFilter& filter) {
  for (const auto& [option, text] : {std::pair{"--from", &filter.from}, std::pair{"--to", &filter.to}})
    if (!begins_a_time(*text))
      return input_error(std::string(option) + " " + quoted(*text) +
                         ": expected a date or a time as 2026-01-31 or 2026-01-31T12:00:00Z");
  return {};
}

Status ResultsDatabase::note(const AttemptRecord& a) {
  // What is replaced keeps its beginning.
  Statement insert(handle_.get(), std::string("INSERT INTO attempt(") + columns +
                                      ") VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                                      "ON CONFLICT(run, unit) DO UPDATE SET time_utc = excluded.time_utc, "
                                      "outcome = excluded.outcome, reason = excluded.reason, "
                                      "temperature_min_c = excluded.temperature_min_c, "
                                      "temperature_max_c = excluded.temperature_max_c, residual = excluded.residual, "
                                      "diagnosis = excluded.diagnosis, recorded_s = excluded.recorded_s, "
                                      "sessions = excluded.sessions, repeated_dwells = excluded.repeated_dwells, "
                                      "lost_samples = excluded.lost_samples, folder = excluded.folder, "
                                      "calibration = excluded.calibration");
  if (!insert) return failure("cannot write");
  insert.bind(a.run.empty() ? std::nullopt : std::optional(a.run)).bind(a.unit).bind(a.began_utc).bind(a.time_utc);
  insert.bind(a.outcome).bind(a.reason).bind(std::int64_t{a.simulated}).bind(a.station).bind(a.operator_name);
  insert.bind(a.part).bind(a.revision).bind(a.ambient).bind(a.temperature_min_c).bind(a.temperature_max_c);
  insert.bind(a.residual).bind(a.diagnosis).bind(a.recorded_s).bind(std::int64_t{a.sessions});
  insert.bind(a.repeated_dwells).bind(a.lost_samples).bind(a.folder).bind(a.calibration);
  return insert.done() ? Status{} : failure("cannot write");
}

Result<std::vector<AttemptRecord>> ResultsDatabase::attempts(const RecordFilter& filter) const {
  Statement rows(handle_.get(), std::string("SELECT ") + columns + ", id FROM attempt WHERE " + where("outcome") +
                                    " ORDER BY time_utc, id");
  if (!rows) return failure("cannot read");
  bind_where(filter, rows);
  std::vector<AttemptRecord> found;
  while (rows.row()) {
    AttemptRecord a;
    int column = 0;
    for (std::string* field : {&a.run, &a.unit, &a.began_utc, &a.time_utc, &a.outcome, &a.reason})
      *field = rows.text(column++);
    a.simulated = rows.integer(column++) != 0;
    for (std::string* field : {&a.station, &a.operator_name, &a.part, &a.revision, &a.ambient})
      *field = rows.text(column++);
    for (std::optional<double>* field : {&a.temperature_min_c, &a.temperature_max_c, &a.residual})
      *field = rows.number(column++);
    a.diagnosis = rows.text(column++);
    a.recorded_s = rows.number(column++);
    a.sessions = static_cast<int>(rows.integer(column++));
    a.repeated_dwells = rows.integer(column++);
    a.lost_samples = rows.integer(column++);
    a.folder = rows.text(column++);
    if (rows.number(column)) a.calibration = rows.integer(column);
    a.id = rows.integer(++column);
    found.push_back(std::move(a));
  }
  if (!rows.ended_well()) return failure("cannot read");
  return found;
}

}  // namespace turncal
