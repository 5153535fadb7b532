#include "orchestrator/records/database_rows.h"

namespace turncal {

std::string places(std::size_t first, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += (i > 0 ? ", $" : "$") + std::to_string(first + i);
  return text;
}

Result<AddedRow> add_calibration_row(SqlConnection& database, const SqlRow& row, const std::vector<SqlRow>& values,
                                     const SqlBytes& statistics) {
  AddedRow added;
  Status status =
      database.run(std::string("INSERT INTO calibration(") + calibration_columns + ") VALUES(" + places(1, row.size()) +
                       ") ON CONFLICT(unit, recording_hash, method, content) DO NOTHING RETURNING id",
                   row, [&](const SqlRow& inserted) {
                     added = {as_integer(inserted.front()), true};
                   });
  if (status && !added.is_new) {
    constexpr std::size_t content = 15;
    status = database.run(
        "SELECT id FROM calibration WHERE unit = $1 AND method = $2 AND recording_hash = $3 AND content = $4",
        {row[0], row[2], row[3], row[content]}, [&](const SqlRow& there) { added.id = as_integer(there.front()); });
  }
  if (status && added.is_new && !values.empty()) {
    std::string sql = std::string("INSERT INTO value(calibration, ") + value_columns + ") VALUES";
    SqlRow all;
    for (const SqlRow& value : values) {
      sql += (all.empty() ? "(" : ", (") + places(all.size() + 1, 1 + value.size()) + ")";
      all.emplace_back(added.id);
      all.insert(all.end(), value.begin(), value.end());
    }
    status = database.run(sql, all);
  }
  if (status && added.is_new && !statistics.empty())
    status =
        database.run("INSERT INTO statistics(calibration, contents) VALUES($1, $2)", {SqlValue(added.id), statistics});
  return status ? Result<AddedRow>(added) : Result<AddedRow>(status.error());
}

Result<bool> add_attempt_row(SqlConnection& database, const std::string& key, SqlRow row) {
  row.insert(row.begin(), key);
  bool is_new = false;
  const Status status = database.run(std::string("INSERT INTO attempt_note(key, ") + attempt_columns + ") VALUES(" +
                                         places(1, row.size()) + ") ON CONFLICT(key) DO NOTHING RETURNING id",
                                     row, [&](const SqlRow&) { is_new = true; });
  return status ? Result<bool>(is_new) : Result<bool>(status.error());
}

std::string where(const std::string& verdict) {
  return "($1 = '' OR unit = $1) AND ($2 = '' OR station = $2) AND ($3 = '' OR part = $3) AND ($4 = '' OR " + verdict +
         " = $4) AND time_utc >= $5 AND ($6 = '' OR substr(time_utc, 1, length($6)) <= $6)";
}

SqlRow values_of(const RecordFilter& f) { return {f.unit, f.station, f.part, f.verdict, f.from, f.to}; }

}  // namespace turncal
