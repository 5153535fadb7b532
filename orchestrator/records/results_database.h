// The results of all runs in one database: an SQLite file, or a PostgreSQL server (a name that begins with postgresql://) that many stations
// share; docs/production.md, docs/fleet.md.
//
// Rows are added and never changed. An attempt has a row from its beginning, and another when something becomes of it: the newest counts. A
// calibration is one row of `calibration` and 24 of `value`, added in one transaction with the whole parameter file, on disk when add()
// returns; of one recording, too, the newest counts. What is there already is not added again.
// An empty database gets its tables when it is written; one of another schema is refused.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/sql_connection.h"
#include "orchestrator/station/fields.h"
#include "orchestrator/station/station_config.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

inline constexpr int database_version = 4;

// While an attempt goes on, and for ever where the power failed and nobody took it up again.
inline constexpr const char* outcome_running = "running";

// An attempt to calibrate a unit, whatever became of it. A run of several units is one attempt of each; resumed after an interruption it is
// the same attempt, and its newest row counts.
struct AttemptRecord {
  std::int64_t id = 0;
  std::string run;  // its beginning and folder, the same when it is taken up again; empty: refused before there was one
  std::string unit, began_utc, time_utc;  // time: of its end
  // A verdict (orchestrator/station/verdict.h), captured, dropped, refused, aborted, interrupted, failed (of the station), running.
  std::string outcome, reason;
  bool simulated = false;
  std::string station, operator_name, part, revision, ambient;
  std::optional<double> temperature_min_c, temperature_max_c;
  std::optional<double> residual;  // quality.normalised_rms
  std::string diagnosis;
  std::optional<double> recorded_s;
  int sessions = 1;
  std::int64_t repeated_dwells = 0, lost_samples = 0;
  std::string folder;
  std::optional<std::int64_t> calibration;  // its row
};

// Columns of the database, in their order; without id, which a row gets there.
Fields fields_of(AttemptRecord& attempt);

// Rows of calibrations or attempts. Empty: any.
struct RecordFilter {
  std::string unit = {}, station = {}, part = {}, verdict = {};
  std::string from = {},
              to = {};  // times of the end, or their beginning: 2026-01-31 as `to` is the whole of that day, UTC
  int newest = 0;       // of attempts: at most so many, the newest; 0: all
};
Fields fields_of(RecordFilter& filter);  // the words

// An input error unless from and to are the beginning of a time as 2026-01-31T12:00:00Z, from not after to, and
// the verdict is a word that there is.
Status check(const RecordFilter& filter);

struct StoredValue {
  std::string key;
  double value = 0.0;
  std::optional<double> sigma;
  Limit limit;          // empty: not judged
  std::string verdict;  // empty: not judged
  std::optional<double> sigma_max;
  std::string sigma_verdict;  // empty: not judged
};
// A row of `calibration`, and what the parameter file in it says.
struct StoredCalibration {
  std::int64_t id = 0;
  std::string unit, time_utc, station, operator_name, verdict, reason, folder, recording_hash;
  IncrementKind gyro_increment = IncrementKind::pulses;  // as its parameter file says
  bool simulated = false;
  int sessions = 1;
  std::string parameter_file;       // the whole text
  std::vector<StoredValue> values;  // as asked for
  SqlBytes statistics;              // of statistics.tcs; empty: none, or not asked for
  // What of the row is not as in its parameter file; its verdict then reads "damaged". Empty: all is.
  std::string defect;
};

// Columns of newest_calibration, in the order of a table for other programs, and the parameter file.
Fields fields_of(StoredCalibration& calibration);

// How many rows were not there before.
struct CopiedRows {
  std::int64_t attempts = 0;  // rows of attempt_note
  std::int64_t calibrations = 0;
};

// Every column but the text of files, for other programs (docs/production.md); of calibrations with their 24 values, sigmas and limits.
DataTable attempts_table(const std::vector<AttemptRecord>& all);
DataTable calibrations_table(const std::vector<StoredCalibration>& all);

class ResultsDatabase {
 public:
  static Result<ResultsDatabase> open(const std::string& name,
                                      const SqlPatience& patience = {});  // made when it is not there
  static Result<ResultsDatabase> open_to_read(const std::string& name, const SqlPatience& patience = {});
  // Whether `add` could write to this file now. Nothing is made or changed.
  static Status check_writable(const std::string& path);

  // On disk when they return. The attempt is that of the calibration.
  // statistics: the bytes of statistics.tcs; empty: there are none.
  Status add(const ParameterFile& file, AttemptRecord attempt, const SqlBytes& statistics = {});
  Status note(AttemptRecord attempt);

  // Oldest first. key: values of that parameter only ("" for all of them).
  Result<std::vector<StoredCalibration>> list(const RecordFilter& filter, const std::string& key) const;
  Result<std::vector<AttemptRecord>> attempts(const RecordFilter& filter) const;
  // An input error that says what there is, where no row at all has the unit, station or part that is asked for.
  Status check_known(const RecordFilter& filter) const;
  // The newest of each recording, one at a time.
  Status each_calibration(bool with_statistics, const std::function<void(const StoredCalibration&)>& each) const;

  Status check() const;  // an error that names the first defect of pages, references and rows
  // An SQLite file of what it is at one moment, while others write.
  Result<std::string> image() const;
  static Result<ResultsDatabase> of_image(const std::string& image, const std::string& path);  // in memory

  // Every row once, however often it is done, a page of rows a transaction. moves: what is there is then taken away here.
  Result<CopiedRows> copy_to(ResultsDatabase& other, bool moves = false) const;
  // The roles of a server: turncal_station may add and read, turncal_reader may read. Can be done again.
  Status make_roles();

 private:
  explicit ResultsDatabase(std::shared_ptr<SqlConnection> connection) : connection_(std::move(connection)) {}
  Result<bool> has_tables() const;
  Status make_tables(bool keep) const;
  Status check_pages() const;
  std::shared_ptr<SqlConnection> connection_;
};

// Where a station writes down its attempts: into its database or, where that is a server, first into a file of its own (the outbox), from
// which the rows go to the server when it answers. A run never waits longer for a server than `longest_wait_s`, and needs it for nothing.
//
// A row that is sent twice is one row: whoever is interrupted between sending and taking away sends again.
inline constexpr double longest_wait_s = 5.0;

// The file that is written first; empty: the station keeps no results.
std::string records_file(const StationConfig& station);

// Sends what is kept. Why something stays here, in one line; empty: nothing does, or there is no server.
std::string send_records(const StationConfig& station);
// Why the server could not be written to now; empty: it could, or there is none. Nothing is changed.
std::string server_trouble(const StationConfig& station);

// Oldest first. Where rows wait for a server they are the newest, and alone; then, and where it is away, `trouble` says so.
Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble);

}  // namespace turncal
