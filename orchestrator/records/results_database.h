// The results of all runs in one database: an SQLite file, or a PostgreSQL server that many stations share (tables in database_rows.cpp;
// docs/production.md, docs/fleet.md). A name that begins with postgresql:// is a server's, any other a file's.
//
// Rows are added and never changed. An attempt has a row from its beginning, and another when something becomes of it: the newest counts. A calibration is one row of
// `calibration` and 24 of `value`, in one transaction that is on disk when add() returns, with the whole parameter file; of one recording, too, the newest counts. What is there already is
// not added again.
// An empty database gets its tables when it is written; one of another schema is refused.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/attempt_record.h"
#include "orchestrator/records/sql_connection.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

struct StoredValue {
  std::string key;
  double value = 0.0;
  std::optional<double> sigma;
  Limit limit;          // empty: not judged
  std::string verdict;  // empty: not judged
};

struct StoredCalibration {
  std::int64_t id = 0;
  std::string unit, time_utc, station, operator_name, verdict, folder, recording_hash;
  bool simulated = false;
  int sessions = 1;
  std::vector<StoredValue> values;  // as asked for
  // What of the row is not as in the parameter file that it holds; its verdict then reads "damaged". Empty: all is.
  std::string defect;
};

// Columns of newest_calibration, in the order of a table for other programs.
Fields fields_of(StoredCalibration& calibration);

// What a row holds that can be worked on again.
struct KeptCalibration {
  std::int64_t id = 0;
  std::string folder, parameter_file;  // the whole text
  SqlBytes statistics;                 // of statistics.tcs; empty: none, or not asked for
};

// How many rows were not there before.
struct CopiedRows {
  std::int64_t attempts = 0;  // rows of attempt_note
  std::int64_t calibrations = 0;
};

class ResultsDatabase {
 public:
  static Result<ResultsDatabase> open(const std::string& name,
                                      const SqlPatience& patience = {});  // made when it is not there
  static Result<ResultsDatabase> open_to_read(const std::string& name, const SqlPatience& patience = {});
  // Whether `add` could write to this file now. Nothing is made or changed.
  static Status check_writable(const std::string& path);

  // On disk when they return. The attempt is that of the calibration.
  // statistics: the bytes of statistics.tcs; empty: there are none.
  Status add(const ParameterFile& file, const VerdictReport& verdict, AttemptRecord attempt,
             const SqlBytes& statistics = {});
  Status note(AttemptRecord attempt);

  // Oldest first. key: values of that parameter only ("" for all of them).
  Result<std::vector<StoredCalibration>> list(const RecordFilter& filter, const std::string& key) const;
  Result<std::vector<AttemptRecord>> attempts(const RecordFilter& filter) const;
  // An input error that says what there is, where no row at all has the unit, station or part that is asked for.
  Status check_known(const RecordFilter& filter) const;
  // The newest of each recording, one at a time.
  Status each_calibration(bool with_statistics, const std::function<void(KeptCalibration)>& each) const;

  int stored_version() const { return stored_version_; }  // of the schema of one that was opened to read
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
  static Result<ResultsDatabase> in_memory(const std::string& name);
  Status check_version() const;
  Status make_tables(bool keep) const;
  Status check_pages() const;
  std::shared_ptr<SqlConnection> connection_;
  int stored_version_ = 0;
};

}  // namespace turncal
