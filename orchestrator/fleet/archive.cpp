#include "orchestrator/fleet/recalibration.h"

#include <algorithm>
#include <filesystem>

#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

constexpr const char* text_form_mark = "imu.csv";

Result<std::vector<ArchiveEntry>> below(const std::string& folder) {
  std::vector<ArchiveEntry> entries;
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder, fs::directory_options::skip_permission_denied, error), end;
       at != end && !error; at.increment(error)) {
    const fs::path& path = at->path();
    if (path.filename().string().starts_with('.')) continue;
    if (path.filename() == binary_recording_name || path.filename() == text_form_mark)
      entries.push_back({path.parent_path().string(), {}});
    else if (path.extension() == ".tcr")
      entries.push_back({path.string(), {}});
  }
  if (error) return input_error(folder + ": cannot read: " + error.message());
  std::ranges::sort(entries, [](const auto& a, const auto& b) { return a.recording < b.recording; });
  entries.erase(std::unique(entries.begin(), entries.end(),
                            [](const auto& a, const auto& b) { return a.recording == b.recording; }),
                entries.end());
  return entries;
}

Result<std::vector<ArchiveEntry>> listed(const std::string& path) {
  TRY(expect_file(path, FileKind::csv));
  const std::string text = TRY(read_whole_file(path));
  std::string_view remaining = text;
  std::vector<std::string> header;
  for (const std::string_view column : split(next_line(remaining), ',')) header.emplace_back(column);
  if (header.empty() || header.front() != "recording")
    return input_error(path + ":1: " + turncal::quoted(header.front()) +
                       ": expected a list that begins with the column recording");
  for (std::size_t k = 1; k < header.size(); ++k)
    if (std::ranges::find(archive_columns, header[k]) == archive_columns.end())
      return input_error(path + ":1: " + turncal::quoted(header[k]) +
                         ": expected station, lot, part, revision or measured_utc");
  std::vector<ArchiveEntry> entries;
  for (int line = 2; !remaining.empty(); ++line) {
    const std::string_view row = next_line(remaining);
    if (trimmed(row).empty() || row.front() == '#') continue;
    const std::vector<std::string_view> cells = split(row, ',');
    const std::string where = path + ":" + std::to_string(line) + ": ";
    if (cells.size() != header.size())
      return input_error(where + std::to_string(cells.size()) + " cells: expected " + std::to_string(header.size()));
    if (cells.front().empty()) return input_error(where + "expected the path of a recording");
    ArchiveEntry entry{(fs::path(path).parent_path() / fs::path(cells.front())).string(), {}};
    for (std::size_t k = 1; k < cells.size(); ++k)
      if (!cells[k].empty()) entry.record[header[k]] = std::string(cells[k]);
    if (const auto time = entry.record.find("measured_utc"); time != entry.record.end() && !parse_utc(time->second))
      return input_error(where + "measured_utc = " + turncal::quoted(time->second) +
                         ": expected a time as 2026-01-31T12:00:00Z");
    entries.push_back(std::move(entry));
  }
  return entries;
}

// The folder of a run that a row names holds its recording; what is gone is found unreadable when its turn comes.
Result<std::vector<ArchiveEntry>> in_rows(const std::string& name) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(name));
  std::vector<ArchiveEntry> entries;
  TRY(database.each_calibration(false, [&](const KeptCalibration& row) {
    if (!row.folder.empty()) entries.push_back({row.folder, {}});
  }));
  return entries;
}

}  // namespace

Result<std::vector<ArchiveEntry>> read_archive(const std::string& path) {
  std::error_code error;
  std::vector<ArchiveEntry> entries = TRY(names_a_database(path)          ? in_rows(path)
                                          : fs::is_directory(path, error) ? below(path)
                                                                          : listed(path));
  if (entries.empty()) return input_error(path + ": expected recordings, found none");
  return entries;
}

std::map<std::string, std::string> whole_record(const ArchiveEntry& entry) {
  std::map<std::string, std::string> record = entry.record;
  std::error_code error;
  const fs::path folder =
      fs::is_directory(entry.recording, error) ? fs::path(entry.recording) : fs::path(entry.recording).parent_path();
  const std::string beside = (folder / parameters_name).string();
  if (!path_exists(beside)) return record;
  const Result<ParameterFile> file = read_parameter_file(beside);
  if (!file) return record;
  constexpr std::string_view prefix = "record.";
  for (const auto& [key, value] : file->further)
    if (key.starts_with(prefix)) record.emplace(key.substr(prefix.size()), value);
  record.emplace("measured_utc", file->time_utc);
  return record;
}

Result<std::string> format_archive(const std::vector<ArchiveEntry>& entries) {
  std::string text = "recording";
  for (const std::string& column : archive_columns) text += "," + column;
  text += '\n';
  for (const ArchiveEntry& entry : entries) {
    std::vector<std::string> cells = {fs::absolute(entry.recording).lexically_normal().string()};
    for (const std::string& column : archive_columns)
      cells.push_back(entry.record.contains(column) ? entry.record.at(column) : "");
    for (const std::string& cell : cells) {
      if (cell.find_first_of(",\r\n") != std::string::npos)
        return input_error(entry.recording + ": " + turncal::quoted(cell) + ": expected a path without a comma");
      text += (&cell == &cells.front() ? "" : ",") + cell;
    }
    text += '\n';
  }
  return text;
}

}  // namespace turncal
