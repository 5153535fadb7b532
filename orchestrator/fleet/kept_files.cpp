#include "orchestrator/fleet/kept_files.h"

#include <algorithm>
#include <filesystem>
#include <vector>

#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/station_config.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

Status in_database(const std::string& source, const std::string& name, const EachKeptFile& each) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(source));
  const bool statistics = name == statistics_name;
  return database.each_calibration(statistics, [&](const KeptCalibration& row) {
    const std::string where = source + ": row " + std::to_string(row.id);
    if (!statistics) return each(where, row.parameter_file);
    const auto* const bytes = reinterpret_cast<const char*>(row.statistics.data());
    if (!row.statistics.empty()) each(where, std::string(bytes, row.statistics.size()));
  });
}

}  // namespace

Status each_kept_file(const std::string& source, const std::string& name, const EachKeptFile& each) {
  if (names_a_database(source)) return in_database(source, name, each);
  std::vector<std::string> paths;
  std::error_code error;
  for (fs::recursive_directory_iterator at(source, error), end; at != end && !error; at.increment(error))
    if (at->path().filename() == name && !at->path().parent_path().filename().string().starts_with('.'))
      paths.push_back(at->path().string());
  if (error) return input_error(source + ": cannot read: " + error.message());
  std::sort(paths.begin(), paths.end());
  for (const std::string& path : paths) each(path, read_whole_file(path));
  return {};
}

}  // namespace turncal
