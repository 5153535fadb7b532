#include "orchestrator/fleet/recalibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_writer.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/jobs/calibration_job.h"
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
  TRY(database.each_calibration(false, [&](const StoredCalibration& row) {
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

namespace {

enum Outcome { done, there, failed, unreadable };
constexpr std::array<std::string_view, 4> outcome_names = {"done", "there", "failed", "unreadable"};

std::size_t& count_of(Outcome outcome, RecalibrationCounts& c) {
  return *std::array{&c.done, &c.there, &c.failed, &c.unreadable}[outcome];
}

struct Work {
  Outcome outcome = Outcome::done;
  std::string hash, reason;
  std::optional<Error> storage;  // the store, not the recording
};

void add_record(const ArchiveEntry& entry, ParameterFile& file) {
  for (const auto& [key, value] : whole_record(entry))
    if (!find_further(file, "record." + key)) file.add_further("record." + key, value);
}

// What becomes of a recording, as files of its folder: names, not paths.
Result<std::vector<NamedText>> files_of(const ArchiveEntry& entry, const LoadedRecording& recording,
                                        const RecalibrationRequest& request) {
  CalibrationRequest wanted;
  wanted.time_utc = request.time_utc;
  wanted.test_fit = !request.diagnose;
  CalibrationOutput output = TRY(calibrate_recording(recording, wanted));
  std::vector<NamedText> files;
  add_record(entry, output.file);
  add_measured_utc(recording.data.info, output.file);
  if (request.diagnose) {
    DiagnosisRequest diagnosis;
    diagnosis.time_utc = request.time_utc;
    diagnosis.base = output.fit ? &*output.fit : nullptr;
    const DiagnosisOutput found = TRY(diagnose_recordings({&recording, 1}, diagnosis));
    files.push_back({diagnosis_name, found.files.conf});
    if (const std::string why = found.diagnosis.why_base_not_trusted(); !why.empty()) describe_trust(why, output.file);
  }
  const std::string parameters = TRY(format_parameter_file(output.file));
  files.push_back({parameters_name, parameters});
  if (output.fit) {
    const std::vector<std::byte> bytes =
        TRY(format_statistics({output.file, unit_statistics(recording.data, *output.fit)}));
    files.push_back({statistics_name, std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())});
  }
  return files;
}

// Whether the folder is of these files. It appears whole; where another thread or process was first, its folder stays.
Result<bool> keep(const std::string& folder, const std::vector<NamedText>& files) {
  const std::string temporary = temporary_name(folder);
  std::error_code error;
  fs::create_directories(temporary, error);
  if (error) return device_error(temporary + ": cannot make: " + error.message());
  Status status;
  for (const NamedText& file : files)
    if (status) status = write_file_atomically(temporary + "/" + file.path, file.content);
  bool first = false;
  if (status) {
    fs::rename(temporary, folder, error);
    first = !error;
    if (error && !path_exists(folder)) status = device_error(folder + ": cannot make: " + error.message());
  }
  fs::remove_all(temporary, error);
  if (!status) return status.error();
  return first;
}

// Whether something became of a recording before. Of a folder that has lost its result nothing is kept.
bool is_complete(const std::string& folder) {
  if (path_exists(folder + "/" + failure_name) || path_exists(folder + "/" + parameters_name)) return true;
  std::error_code error;
  fs::remove_all(folder, error);
  return false;
}

// What was kept of a recording, by this process or before.
Work as_it_stands(const std::string& hash, const std::string& folder) {
  if (!path_exists(folder + "/" + failure_name)) return {Outcome::there, hash, "", {}};
  const Result<std::string> text = read_whole_file(folder + "/" + failure_name);
  std::string_view remaining = text ? std::string_view(*text) : std::string_view();
  next_line(remaining);  // which recording
  return {Outcome::failed, hash, std::string(next_line(remaining)), {}};
}

Work work_on(const ArchiveEntry& entry, const RecalibrationRequest& request) {
  const Result<LoadedRecording> recording = load_recording(entry.recording);
  if (!recording) return {Outcome::unreadable, "", recording.error().message, {}};
  // Cut or damaged it is another recording by its hash, and would count beside the whole one.
  if (const std::string damage = describe(recording->damage); !damage.empty())
    return {Outcome::unreadable, recording->hash, damage, {}};
  const std::string folder = request.store + "/" + request.version + "/" + recording->hash;
  if (is_complete(folder)) return as_it_stands(recording->hash, folder);
  Work work{Outcome::done, recording->hash, "", {}};
  Status data = check_data(*recording);
  Result<std::vector<NamedText>> files = data.error();
  if (data) files = files_of(entry, *recording, request);
  if (!files) {
    work = {Outcome::failed, recording->hash, files.error().message, {}};
    files = std::vector<NamedText>{{failure_name, entry.recording + "\n" + files.error().message + "\n"}};
  }
  const Result<bool> first = keep(folder, *files);
  if (!first)
    work.storage = first.error();
  else if (!*first)
    return as_it_stands(recording->hash, folder);
  return work;
}

std::string outcome_file(const RecalibrationRequest& request) {
  if (!request.outcome.empty()) return request.outcome;
  const std::string chunk = request.chunks > 1 ? fmt::format(".{}-of-{}", request.chunk, request.chunks) : "";
  return fmt::format("{}/{}/recordings{}.csv", request.store, request.version, chunk);
}

}  // namespace

void count_outcomes(std::string_view rows, RecalibrationCounts& counts) {
  while (!rows.empty()) {
    const std::string_view row = next_line(rows);
    for (const Outcome outcome : {done, there, failed, unreadable})
      if (row.starts_with(std::string(outcome_names[outcome]) + ",")) ++count_of(outcome, counts);
  }
}

Result<RecalibrationCounts> recalibrate(const std::vector<ArchiveEntry>& archive, const RecalibrationRequest& request,
                                        const RecalibrationProgress& progress) {
  const std::string root = request.store + "/" + request.version;
  if (Status status = make_folder(root); !status) return device_error(status.error().message);
  std::vector<const ArchiveEntry*> mine;
  for (std::size_t k = 0; k < archive.size(); ++k)
    if (int(k % std::size_t(request.chunks)) == request.chunk) mine.push_back(&archive[k]);

  RecalibrationCounts counts;
  counts.entries = mine.size();
  std::vector<Work> works(mine.size());
  std::optional<Error> storage;
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> going = true;
  std::mutex mutex;
  const auto worker = [&] {
    for (std::size_t k = next++; k < mine.size() && going; k = next++) {
      works[k] = work_on(*mine[k], request);
      const std::lock_guard lock(mutex);
      if (works[k].storage) {
        storage = works[k].storage;
        going = false;
        return;
      }
      ++count_of(works[k].outcome, counts);
      progress(counts);
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int k = 1; k < request.threads; ++k) threads.emplace_back(worker);
    worker();
  }
  if (storage) return *storage;
  DataTable table({"outcome", "recording", "hash", "reason"});
  for (std::size_t k = 0; k < works.size(); ++k) {
    table.begin_row();
    table.text(outcome_names[works[k].outcome]);
    table.text(mine[k]->recording);
    table.text(works[k].hash);
    table.text(works[k].reason);
  }
  TRY(write_file_atomically(outcome_file(request), table.csv()));
  return counts;
}

}  // namespace turncal
