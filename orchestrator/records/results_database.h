// The results of all runs in one database: an SQLite file, or a PostgreSQL server (a name that begins with postgresql://) that many stations
// share; docs/production.md, docs/fleet.md.
//
// Rows are added and never changed. An attempt has a row from its beginning, and another with each outcome; the newest counts. A
// calibration is one row of `calibration` and 24 of `value`, added in one transaction with the whole parameter file, and on disk when add()
// returns; of one recording the newest counts, too. A row that is already there is not added again.
// Numbers of rows (id) grow in the order in which the rows can be read, whoever writes. An empty database gets its tables on the first
// write, and is none for a reader; one of another schema is refused.
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

// The outcome of an attempt in progress; it stays after a power loss if nobody resumes the run.
inline constexpr const char* outcome_running = "running";

// An attempt to calibrate a unit, whatever its outcome. A run of several units is one attempt for each. A resumed run is
// the same attempt, and its newest row counts.
struct AttemptRecord {
  std::int64_t id = 0;
  std::string run;         // beginning and folder, also after a resume; empty: refused before a run existed
  std::int64_t units = 1;  // of the run
  std::string unit, began_utc, time_utc;  // time: end of the attempt
  // A verdict (orchestrator/station/verdict.h), captured, dropped, refused, aborted, interrupted, failed (fault of the station), running.
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
  std::optional<std::int64_t> calibration;  // its row in `calibration`
};

// Returns the database's columns, in order, without id, which the database assigns.
Fields fields_of(AttemptRecord& attempt);

// Selects rows of calibrations or attempts. Empty: any.
struct RecordFilter {
  std::string unit = {}, station = {}, part = {}, verdict = {};
  std::string from = {}, to = {};  // end times or their beginnings: 2026-01-31 as `to` includes that day, UTC
  std::size_t after = 0;           // only rows with a greater id, which reached the database later
  int newest = 0;                  // for attempts: only so many, the newest; 0: all
};
Fields fields_of(RecordFilter& filter);  // the textual criteria

// Returns an input error unless from and to are beginnings of a time such as 2026-01-31T12:00:00Z, from is not after to, and
// the verdict is a valid word.
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
// A row of `calibration`, with contents of its parameter file.
struct StoredCalibration {
  std::int64_t id = 0;
  std::string unit, time_utc, station, operator_name, verdict, reason, folder, recording_hash;
  IncrementKind gyro_increment = IncrementKind::pulses;  // from its parameter file
  bool simulated = false;
  int sessions = 1;
  std::string parameter_file;       // the whole text
  std::vector<StoredValue> values;  // as requested
  SqlBytes statistics;              // of statistics.tcs; empty: none, or not requested
  // The first difference between the row and its parameter file; its verdict then reads "damaged". Empty: none.
  std::string defect;
};

// Returns the columns of newest_calibration, in the order of a table for other programs, and the parameter file.
Fields fields_of(StoredCalibration& calibration);

// Numbers of rows that were new.
struct CopiedRows {
  std::int64_t attempts = 0;  // rows of attempt_note
  std::int64_t calibrations = 0;
};

// Return every column except texts of files, for other programs (docs/production.md); calibrations with their 24 values, sigmas and limits.
DataTable attempts_table(const std::vector<AttemptRecord>& all);
DataTable calibrations_table(const std::vector<StoredCalibration>& all);

class ResultsDatabase {
 public:
  static Result<ResultsDatabase> open(const std::string& name, const SqlPatience& patience = {});  // or makes it
  static Result<ResultsDatabase> open_to_read(const std::string& name, const SqlPatience& patience = {});
  // Checks that `add` could write to this file now. Nothing is made or changed.
  static Status check_writable(const std::string& path);

  // Add a calibration with its attempt, or an attempt alone; on disk when they return.
  // statistics: the bytes of statistics.tcs; empty: there are none.
  Status add(const ParameterFile& file, AttemptRecord attempt, const SqlBytes& statistics = {});
  Status note(AttemptRecord attempt);

  // Returns the rows, oldest first. key: values of that parameter only ("" for all of them).
  Result<std::vector<StoredCalibration>> list(const RecordFilter& filter, const std::string& key) const;
  Result<std::vector<AttemptRecord>> attempts(const RecordFilter& filter) const;
  // Returns an input error that lists the known names when no row has the requested unit, station or part.
  Status check_known(const RecordFilter& filter) const;
  // Passes on the newest calibration of each recording, one at a time.
  Status each_calibration(bool with_statistics, const std::function<void(const StoredCalibration&)>& each) const;

  Status check() const;  // an error that names the first defect of pages, references and rows
  // Writes a new SQLite file with the contents of one moment, while others write.
  Status copy_into(const std::string& path) const;

  // Copies every row once, however often it is called, with one transaction for each page of rows. moves: then removes the rows here.
  Result<CopiedRows> copy_to(ResultsDatabase& other, bool moves = false) const;
  // Makes the roles of a server: turncal_station may add and read, turncal_reader may read. Can be repeated.
  Status make_roles();

 private:
  explicit ResultsDatabase(std::shared_ptr<SqlConnection> connection) : connection_(std::move(connection)) {}
  Result<bool> has_tables() const;
  Status add_attempt(AttemptRecord& attempt);
  Status make_tables(bool keep) const;
  Status check_pages() const;
  std::shared_ptr<SqlConnection> connection_;
};

// Records a station's attempts: in its database or, when that is a server, first in a file of its own (the outbox), from
// which the rows go to the server when it answers. A run never waits longer for a server than `longest_wait_s`, and does not depend on it.
//
// A row that is sent twice is one row, so an interruption between sending and removing does no harm.
inline constexpr double longest_wait_s = 5.0;

// Returns the file that is written first; empty: the station keeps no results.
std::string records_file(const StationConfig& station);

// Sends the rows of the outbox. Returns why some stay here, in one line; empty: none do, or there is no server.
std::string send_records(const StationConfig& station);
// Returns why the server cannot be opened for reading now; empty: it can, or there is none. Changes nothing.
std::string server_trouble(const StationConfig& station);

// Returns attempts, oldest first. Rows that wait for a server are newer and returned alone; `trouble` says so, and when the server is away.
Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble);

}  // namespace turncal
