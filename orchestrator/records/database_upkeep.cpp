// What keeps a results database: its check, its image for a backup, copies of its rows, and the roles of a server.

#include "orchestrator/records/results_database.h"

#include <sqlite3.h>

#include <cstring>
#include <map>
#include <set>

#include "imu_io/base/files.h"
#include "orchestrator/records/database_rows.h"

namespace turncal {

namespace {

using Page = std::vector<std::pair<std::int64_t, SqlRow>>;  // with their ids

// The next rows behind `last`.
Result<Page> page_of(SqlConnection& database, const std::string& table, std::int64_t last, std::int64_t end) {
  Page page;
  TRY(database.run(
      "SELECT " + columns_of(table) + ", id FROM " + table + " WHERE id > $1 AND id <= $2 ORDER BY id LIMIT 100",
      {last, end}, [&](SqlRow row) {
        const std::int64_t id = as_integer(row.back());
        row.pop_back();
        page.emplace_back(id, std::move(row));
      }));
  return page;
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
  for (std::int64_t last = 0;;) {
    const Page page = TRY(page_of(from, "calibration", last, last_calibration));
    if (page.empty()) break;
    const auto add = [&]() -> Status {
      std::set<std::int64_t> added;
      for (const auto& [id, row] : page) {
        const AddedRow there = TRY(add_calibration(to, row));
        number_there[id] = there.id;
        if (there.is_new) added.insert(id);
      }
      for (const std::string table : {"value", "statistics"}) {
        std::vector<SqlRow> rows;
        TRY(from.run("SELECT " + columns_of(table) + " FROM " + table + " WHERE calibration > $1 AND calibration <= $2",
                     {last, page.back().first}, [&](SqlRow row) {
                       const std::int64_t id = as_integer(row.front());
                       if (!added.contains(id)) return;
                       row.front() = number_there[id];
                       rows.push_back(std::move(row));
                     }));
        TRY(insert(to, table, rows));
      }
      copied.calibrations += std::ssize(added);
      return {};
    };
    TRY(in_transaction(to, add));
    last = page.back().first;
  }
  for (std::int64_t last = 0;;) {
    Page page = TRY(page_of(from, "attempt_note", last, last_attempt));
    if (page.empty()) break;
    last = page.back().first;
    std::vector<SqlRow> rows;
    for (auto& [id, row] : page) {
      SqlValue& calibration = row.back();
      const auto there = number_there.find(as_integer(calibration));
      // A row that has taken the number of one that is gone may name a calibration that was not looked at: another time.
      if (as_number(calibration) && there == number_there.end()) continue;
      if (as_number(calibration)) calibration = there->second;
      rows.push_back(std::move(row));
    }
    const auto add = [&]() -> Status {
      copied.attempts += std::ssize(TRY(insert(to, "attempt_note", rows, unique_attempt)));
      return {};
    };
    const auto take_away = [&]() -> Status {
      for (const SqlRow& row : rows) TRY(from.run("DELETE FROM attempt_note WHERE key = $1", {row.front()}));
      return {};
    };
    TRY(in_transaction(to, add));
    if (moves) TRY(in_transaction(from, take_away));
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
  return std::string(reinterpret_cast<const char*>(bytes.get()), std::size_t(size));
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
