#include "orchestrator/fleet/recalibration.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

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
    const DiagnosisOutput found = TRY(diagnose_recordings({&recording}, diagnosis));
    files.push_back({diagnosis_name, found.files.conf});
    for (auto& [key, value] : output.file.further)
      if (key == "quality.trusted" && !found.diagnosis.trusted) value = "false";
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
  const std::string chunk =
      request.chunks > 1 ? "." + std::to_string(request.chunk) + "-of-" + std::to_string(request.chunks) : "";
  return request.store + "/" + request.version + "/recordings" + chunk + ".csv";
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
    if (static_cast<int>(k % static_cast<std::size_t>(request.chunks)) == request.chunk) mine.push_back(&archive[k]);

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
