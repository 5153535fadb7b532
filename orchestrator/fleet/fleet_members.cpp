#include "orchestrator/fleet/fleet_members.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <span>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/station_config.h"

namespace turncal {
namespace {

constexpr double day_s = 86400.0;

std::string level_of(const ParameterFile& file, const std::string& factor, const std::string& measured) {
  if (factor == "version") return file.software_version;
  if (factor == "month") return measured.substr(0, 7);
  const std::string* const value = find_further(file, "record." + factor);
  return value && !value->empty() ? *value : "?";
}

}  // namespace

Result<FleetSource> read_fleet(const std::string& from, const std::vector<std::string>& factors) {
  FleetSource source;
  struct One {
    std::string time_utc;
    FleetMember member;
  };
  std::map<std::string, One> by_recording;
  bool real = false;
  const auto take = [&](const std::string& where, const Result<std::string>& bytes) {
    Result<StatisticsFile> statistics =
        bytes ? parse_statistics(std::as_bytes(std::span(*bytes)), where) : Result<StatisticsFile>(bytes.error());
    if (!statistics) {
      source.skipped.push_back(statistics.error().message);
      return;
    }
    const ParameterFile& file = statistics->file;
    (file.simulated ? source.simulated : real) = true;
    One one{file.time_utc, {}};
    const std::string* const record = find_further(file, "record.measured_utc");
    const std::string measured = record ? *record : file.time_utc;
    one.member.unit = file.unit_serial;
    for (const std::string& factor : factors) one.member.level.push_back(level_of(file, factor, measured));
    const std::optional<double> time = parse_utc(measured);
    one.member.day = time ? *time / day_s : std::numeric_limits<double>::quiet_NaN();
    one.member.statistics = std::move(statistics->statistics);
    const auto [place, is_new] = by_recording.try_emplace(file.recording_hash, std::move(one));
    if (!is_new && place->second.time_utc < one.time_utc) place->second = std::move(one);
  };
  TRY(each_kept_file(from, statistics_name, take));
  if (by_recording.empty())
    return input_error(
        from + ": expected " + std::string(statistics_name) + " of runs or of `turncal recalibrate` in it, found " +
        (source.skipped.empty() ? std::string("none") : "none that can be read: " + source.skipped.front()));
  if (source.simulated && real)
    return input_error(from + ": simulated and real units together: expected one or the other");
  double first = std::numeric_limits<double>::infinity();
  for (const auto& [hash, one] : by_recording)
    if (one.member.day < first) first = std::floor(one.member.day);
  source.first_day = std::isfinite(first) ? first : 0.0;
  std::vector<One> all;
  for (auto& [hash, one] : by_recording) all.push_back(std::move(one));
  std::ranges::stable_sort(all, [](const One& a, const One& b) { return a.member.unit < b.member.unit; });
  for (One& one : all) {
    one.member.day -= source.first_day;
    source.members.push_back(std::move(one.member));
  }
  return source;
}

std::string date_of(double day) { return format_utc(day * day_s).substr(0, 10); }

namespace {

namespace fs = std::filesystem;

Status in_database(const std::string& source, const std::string& name, const EachKeptFile& each) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(source));
  const bool statistics = name == statistics_name;
  return database.each_calibration(statistics, [&](const StoredCalibration& row) {
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
  if (error) TRY(expect_file(source, FileKind::database));
  if (error) return input_error(source + ": cannot read: " + error.message());
  std::ranges::sort(paths);
  for (const std::string& path : paths) each(path, read_whole_file(path));
  return {};
}

}  // namespace turncal
