// What keeps a results database: its check, its image for a backup, copies of its rows, and the roles of a server.

#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include <cstring>
#include <map>

#include "imu_io/base/posix_file.h"
#include "orchestrator/records/database_rows.h"

namespace turncal {

namespace {

constexpr std::size_t rows_a_page = 100;

struct Page {
  std::vector<std::int64_t> ids;
  std::vector<SqlRow> rows;
};

// The next rows behind `last`, without their ids.
Result<Page> page_of(SqlConnection& database, const std::string& columns, const std::string& table, std::int64_t last,
                     std::int64_t end) {
  Page page;
  TRY(database.run("SELECT id, " + columns + " FROM " + table + " WHERE id > $1 AND id <= $2 ORDER BY id LIMIT " +
                       std::to_string(rows_a_page),
                   {last, end}, [&](SqlRow row) {
                     page.ids.push_back(as_integer(row.front()));
                     row.erase(row.begin());
                     page.rows.push_back(std::move(row));
                   }));
  return page;
}

Result<std::map<std::int64_t, std::vector<SqlRow>>> values_of_page(SqlConnection& database, const Page& page) {
  std::map<std::int64_t, std::vector<SqlRow>> values;
  TRY(database.run(
      std::string("SELECT calibration, ") + value_columns + " FROM value WHERE calibration >= $1 AND calibration <= $2",
      {page.ids.front(), page.ids.back()}, [&](SqlRow row) {
        const std::int64_t of = as_integer(row.front());
        row.erase(row.begin());
        values[of].push_back(std::move(row));
      }));
  return values;
}

Result<std::map<std::int64_t, SqlBytes>> statistics_of_page(SqlConnection& database, const Page& page) {
  std::map<std::int64_t, SqlBytes> statistics;
  TRY(database.run("SELECT calibration, contents FROM statistics WHERE calibration >= $1 AND calibration <= $2",
                   {page.ids.front(), page.ids.back()},
                   [&](const SqlRow& row) { statistics[as_integer(row[0])] = as_bytes(row[1]); }));
  return statistics;
}

Result<std::int64_t> last_id(SqlConnection& database, const std::string& table) {
  std::int64_t last = 0;
  TRY(database.run("SELECT max(id) FROM " + table, {}, [&](const SqlRow& row) { last = as_integer(row.front()); }));
  return last;
}

constexpr const char* roles = R"(
DO $$ BEGIN
  IF NOT EXISTS (SELECT 1 FROM pg_roles WHERE rolname = 'turncal_station') THEN CREATE ROLE turncal_station; END IF;
  IF NOT EXISTS (SELECT 1 FROM pg_roles WHERE rolname = 'turncal_reader') THEN CREATE ROLE turncal_reader; END IF;
END $$;
REVOKE ALL ON calibration, value, statistics, attempt_note, schema_version, attempt, newest_calibration FROM PUBLIC;
GRANT SELECT ON calibration, value, statistics, attempt_note, schema_version, attempt, newest_calibration
  TO turncal_station, turncal_reader;
GRANT INSERT ON calibration, value, statistics, attempt_note TO turncal_station;
)";

}  // namespace

Status ResultsDatabase::make_roles() {
  return in_transaction(*connection_, [this] { return connection_->run(roles); });
}

// Rows of attempts up to the last one that is there now: their calibrations were added before them.
Result<CopiedRows> ResultsDatabase::copy_to(ResultsDatabase& other, bool moves) const {
  SqlConnection& from = *connection_;
  SqlConnection& to = *other.connection_;
  const std::int64_t last_attempt = TRY(last_id(from, "attempt_note"));
  const std::int64_t last_calibration = TRY(last_id(from, "calibration"));
  CopiedRows copied;
  std::map<std::int64_t, std::int64_t> number_there;
  for (std::int64_t last = 0; last < last_calibration;) {
    const Page page = TRY(page_of(from, calibration_columns, "calibration", last, last_calibration));
    if (page.ids.empty()) break;
    std::map<std::int64_t, std::vector<SqlRow>> values = TRY(values_of_page(from, page));
    std::map<std::int64_t, SqlBytes> statistics = TRY(statistics_of_page(from, page));
    CopiedRows now;
    const auto add = [&]() -> Status {
      for (std::size_t i = 0; i < page.ids.size(); ++i) {
        const AddedRow added = TRY(add_calibration_row(to, page.rows[i], values[page.ids[i]], statistics[page.ids[i]]));
        number_there[page.ids[i]] = added.id;
        now.calibrations += added.is_new;
      }
      return {};
    };
    TRY(in_transaction(to, add));
    copied.calibrations += now.calibrations;
    last = page.ids.back();
  }
  for (std::int64_t last = 0; last < last_attempt;) {
    Page page = TRY(page_of(from, "key, " + attempt_columns(), "attempt_note", last, last_attempt));
    if (page.ids.empty()) break;
    last = page.ids.back();
    // A row that has taken the number of one that is gone may name a calibration that was not looked at: another time.
    std::erase_if(page.rows, [&](const SqlRow& row) {
      return as_number(row.back()) && !number_there.contains(as_integer(row.back()));
    });
    CopiedRows now;
    Status status = in_transaction(to, [&]() -> Status {
      for (const SqlRow& row : page.rows) {
        SqlRow there(row.begin() + 1, row.end());
        if (as_number(there.back())) there.back() = number_there[as_integer(there.back())];
        const bool is_new = TRY(add_attempt_row(to, as_text(row.front()), there));
        now.attempts += is_new;
      }
      return {};
    });
    if (status && moves)
      status = in_transaction(from, [&]() -> Status {
        for (const SqlRow& row : page.rows) TRY(from.run("DELETE FROM attempt_note WHERE key = $1", {row.front()}));
        return {};
      });
    TRY(status);
    copied.attempts += now.attempts;
  }
  if (!moves) return copied;
  // A calibration is added together with a row of its attempt: where that is gone, it is there.
  TRY(
      from.run("DELETE FROM calibration WHERE NOT EXISTS (SELECT 1 FROM attempt_note WHERE attempt_note.calibration = "
               "calibration.id)"));
  return copied;
}

Status ResultsDatabase::check_pages() const {
  const auto damaged = [this](const std::string& what) {
    return input_error(connection_->name() + ": results database: damaged: " + what);
  };
  std::string found;
  TRY(connection_->run("PRAGMA integrity_check(1)", {}, [&](const SqlRow& row) { found = as_text(row[0]); }));
  if (found != "ok") return damaged(found);
  found.clear();
  const auto say = [&](const SqlRow& row) {
    if (found.empty())
      found = "row " + std::to_string(as_integer(row[1])) + " of " + as_text(row[0]) + " names a row of " +
              as_text(row[2]) + " that is not there";
  };
  TRY(connection_->run("PRAGMA foreign_key_check", {}, say));
  return found.empty() ? Status{} : damaged(found);
}

Status ResultsDatabase::check() const {
  if (connection_->sqlite()) TRY(check_pages());  // a server sees to that itself
  const std::vector<StoredCalibration> calibrations = TRY(list({}, ""));
  for (const StoredCalibration& c : calibrations)
    if (!c.defect.empty()) return input_error(c.defect);
  static_cast<void>(TRY(attempts({})));
  return {};
}

Result<ResultsDatabase> ResultsDatabase::in_memory(const std::string& name) {
  std::shared_ptr<SqlConnection> connection = TRY(connect_to_memory(name));
  return ResultsDatabase(std::move(connection));
}

Result<std::string> ResultsDatabase::image() const {
  const std::string& name = connection_->name();
  if (!connection_->sqlite()) {  // the rows of a server, as a file
    ResultsDatabase copy = TRY(in_memory(name));
    TRY(copy.make_tables(true));
    const Status copied = in_transaction(*connection_, [&]() -> Status {  // of one moment
      const Result<CopiedRows> rows = copy_to(copy);
      return rows ? Status{} : rows.error();
    });
    return copied ? copy.image() : Result<std::string>(copied.error());
  }
  sqlite3_int64 size = 0;
  // As one that is read: what is being written is waited for, as with any other statement.
  TRY(connection_->run("BEGIN; SELECT count(*) FROM sqlite_master"));
  const std::unique_ptr<unsigned char, void (*)(void*)> bytes(
      sqlite3_serialize(connection_->sqlite(), "main", &size, 0), sqlite3_free);
  TRY(connection_->run("COMMIT"));
  if (size == 0) return std::string();  // a file of no bytes is an empty database
  if (!bytes)
    return device_error(name + ": results database: there is no memory for its " + std::to_string(size) + " bytes");
  return std::string(reinterpret_cast<const char*>(bytes.get()), static_cast<std::size_t>(size));
}

Result<ResultsDatabase> ResultsDatabase::of_image(const std::string& image, const std::string& path) {
  Result<ResultsDatabase> database = in_memory(path);
  if (!database || image.empty()) return database;
  sqlite3* const handle = database->connection_->sqlite();
  auto* const bytes = static_cast<unsigned char*>(sqlite3_malloc64(image.size()));
  if (!bytes)
    return device_error(path + ": results database: there is no memory for its " + std::to_string(image.size()) +
                        " bytes");
  std::memcpy(bytes, image.data(), image.size());
  const auto size = static_cast<sqlite3_int64>(image.size());
  if (sqlite3_deserialize(handle, "main", bytes, size, size,
                          SQLITE_DESERIALIZE_FREEONCLOSE | SQLITE_DESERIALIZE_RESIZEABLE) != SQLITE_OK)
    return device_error(path + ": results database: cannot read: " + sqlite3_errmsg(handle));
  return database;
}

namespace {

constexpr SqlPatience short_patience{.wait_s = 3.0, .all_s = longest_wait_s};

}  // namespace

std::string records_file(const StationConfig& station) {
  return names_a_server(station.database) ? station.outbox : station.database;
}

std::string send_records(const StationConfig& station) {
  if (!names_a_server(station.database) || !path_exists(station.outbox)) return "";
  const Result<ResultsDatabase> kept = ResultsDatabase::open(station.outbox);
  if (!kept) return kept.error().message;
  const auto waiting = kept->attempts({});
  if (!waiting) return waiting.error().message;
  if (waiting->empty()) return "";
  Result<ResultsDatabase> server = ResultsDatabase::open(station.database, short_patience);
  const Result<CopiedRows> sent = server ? kept->copy_to(*server, true) : Result<CopiedRows>(server.error());
  if (sent) return "";
  const auto left = kept->attempts({});
  const std::size_t count = left ? left->size() : waiting->size();
  return sent.error().message + "; " + std::to_string(count) + (count == 1 ? " attempt is" : " attempts are") +
         " kept in " + station.outbox + " and sent later";
}

std::string server_trouble(const StationConfig& station) {
  if (!names_a_server(station.database)) return "";
  const Result<ResultsDatabase> server = ResultsDatabase::open_to_read(station.database, short_patience);
  return server ? "" : server.error().message;
}

Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble) {
  std::vector<AttemptRecord> all;
  const auto take = [&](const std::string& name) -> Status {
    const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(name, short_patience));
    const std::vector<AttemptRecord> some = TRY(database.attempts(filter));
    all.insert(all.end(), some.begin(), some.end());
    return {};
  };
  trouble.clear();
  const std::string file = records_file(station);
  if (!file.empty() && path_exists(file)) TRY(take(file));
  if (!names_a_server(station.database)) return all;
  // What waits here is newer than what the server has of this station, and says that the server was away a moment ago.
  if (!all.empty())
    trouble = station.database + ": results database: not all of it: " + station.outbox + " keeps rows for it";
  else if (Status status = take(station.database); !status)
    trouble = status.error().message;
  return all;
}

}  // namespace turncal
