// The results of all runs in one embedded SQLite database (tables in database_schema.cpp; docs/production.md).
//
// An attempt is one row of `attempt` from its beginning. A calibration is one row of `calibration` and 24 of `value`, in one transaction that is on disk when add() returns. The same
// recording is the same row: adding it again replaces it. The whole parameter file is kept with it.
// A database of an older schema is brought up to date when it is written, and read as if it were; a newer one is refused.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/records/attempt_record.h"
#include "orchestrator/station/verdict.h"

struct sqlite3;

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

class Statement;

class ResultsDatabase {
 public:
  static Result<ResultsDatabase> open(const std::string& path);  // made when it is not there
  static Result<ResultsDatabase> open_to_read(const std::string& path);
  // Whether `add` could write there now. Nothing is made or changed.
  static Status check_writable(const std::string& path);

  // On disk when they return. The attempt is that of the calibration.
  Status add(const ParameterFile& file, const VerdictReport& verdict, AttemptRecord attempt);
  Status note(const AttemptRecord& attempt);  // a new row, or what became of the one that is there

  // Oldest first. key: values of that parameter only ("" for all of them).
  Result<std::vector<StoredCalibration>> list(const RecordFilter& filter, const std::string& key) const;
  Result<std::vector<AttemptRecord>> attempts(const RecordFilter& filter) const;

  int stored_version() const { return stored_version_; }  // of the schema of one that was opened to read
  Status check() const;  // an error that names the first defect of pages, references and rows
  // As it is at one moment, while others write.
  Result<std::string> image() const;
  static Result<ResultsDatabase> of_image(const std::string& image, const std::string& path);  // in memory

 private:
  explicit ResultsDatabase(sqlite3* handle, std::string path);
  static Result<ResultsDatabase> connect(const std::string& path, int flags, int patience_ms);
  static std::string where(const std::string& verdict);
  static void bind_where(const RecordFilter& filter, Statement& statement);
  Status check_version() const;
  Status bring_up_to_date(bool keep) const;
  Error failure(const std::string& what) const;
  Status execute(const char* sql) const;
  std::shared_ptr<sqlite3> handle_;
  std::string path_;
  int stored_version_ = 0;
};

}  // namespace turncal
