// The results of all runs in one embedded SQLite database (tables in results_database.cpp; docs/production.md).
//
// A calibration is one row of `calibration` and 24 of `value`, in one transaction that is on disk when add() returns. The same
// recording is the same row: adding it again replaces it. The whole parameter file is kept with it.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "imu_io/recordings/parameter_file.h"
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

class ResultsDatabase {
 public:
  static Result<ResultsDatabase> open(const std::string& path);  // made when it is not there
  static Result<ResultsDatabase> open_to_read(const std::string& path);
  // Whether `add` could write there now. Nothing is made or changed.
  static Status check_writable(const std::string& path);

  Status add(const ParameterFile& file, const VerdictReport& verdict, const std::string& folder, int sessions);

  // Oldest first. unit: only its calibrations; key: values of that parameter only ("" for all of them).
  Result<std::vector<StoredCalibration>> list(const std::string& unit, const std::string& key) const;

 private:
  explicit ResultsDatabase(sqlite3* handle, std::string path);
  Error failure(const std::string& what) const;
  Status execute(const char* sql) const;
  std::shared_ptr<sqlite3> handle_;
  std::string path_;
};

}  // namespace turncal
