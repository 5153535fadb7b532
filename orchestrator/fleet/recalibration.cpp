#include "orchestrator/fleet/recalibration.h"

#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <thread>

#include "calib/statistics/numerics.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_writer.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

namespace fs = std::filesystem;

namespace {

constexpr const char* text_form_mark = "imu.csv";
constexpr const char* outcome_header = "outcome,recording,hash,reason\n";
constexpr const char* outcome_name = "recordings.csv";
constexpr const char* failure_name = "failure.txt";
const std::vector<std::string> archive_columns = {"station", "lot", "part", "revision", "measured_utc"};

Result<std::vector<ArchiveEntry>> below(const std::string& folder) {
  std::set<std::string> paths;
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder, fs::directory_options::skip_permission_denied, error), end;
       at != end && !error; at.increment(error)) {
    const fs::path& path = at->path();
    if (path.filename().string().starts_with('.')) continue;
    if (path.filename() == binary_recording_name || path.filename() == text_form_mark)
      paths.insert(path.parent_path().string());
    else if (path.extension() == ".tcr")
      paths.insert(path.string());
  }
  if (error) return input_error(folder + ": cannot read: " + error.message());
  std::vector<ArchiveEntry> entries;
  for (const std::string& path : paths) entries.push_back({path, {}});
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
      return input_error(path + ":1: " + turncal::quoted(header[k]) + ": expected " +
                         one_of(header[k], archive_columns));
  std::vector<ArchiveEntry> entries;
  for (int line = 2; !remaining.empty(); ++line) {
    const std::string_view row = next_line(remaining);
    if (trimmed(row).empty() || row.front() == '#') continue;
    const std::vector<std::string_view> cells = split(row, ',');
    const std::string where = path + ":" + std::to_string(line) + ": ";
    if (cells.size() != header.size())
      return input_error(where + counted(std::ssize(cells), "cell") + ": expected " + std::to_string(header.size()));
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

// Reads entries from rows; the folder that a row names holds its recording. A missing one is found unreadable when it is processed.
Result<std::vector<ArchiveEntry>> in_rows(const std::string& name) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(name));
  std::vector<ArchiveEntry> entries;
  TRY(database.each_calibration(false, [&](const StoredCalibration& row) {
    if (!row.folder.empty()) entries.push_back({row.folder, {}});
  }));
  return entries;
}

// Returns the record of a recording, from the list and from its run.
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

// Formats a list with absolute paths. An error when a path or value contains a comma or a line break.
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

enum Outcome { done, there, failed, unreadable };
constexpr std::array<std::string_view, 4> outcome_names = {"done", "there", "failed", "unreadable"};

std::size_t& count_of(Outcome outcome, RecalibrationCounts& c) {
  return *std::array{&c.done, &c.there, &c.failed, &c.unreadable}[outcome];
}

struct Work {
  Outcome outcome = Outcome::done;
  std::string hash, reason;
  std::optional<Error> storage;  // error of the store, not of the recording
};

// Returns the results of a recording as files of its folder: names, not paths.
Result<std::vector<NamedText>> files_of(const ArchiveEntry& entry, const LoadedRecording& recording,
                                        const RecalibrationRequest& request) {
  auto output = TRY(calibrate_recording(recording, {.time_utc = request.time_utc, .test_fit = !request.diagnose}));
  std::vector<NamedText> files;
  for (const auto& [key, value] : whole_record(entry))
    if (!find_further(output.file, "record." + key)) output.file.add_further("record." + key, value);
  add_measured_utc(recording.data.info, output.file);
  if (request.diagnose) {
    DiagnosisRequest diagnosis{.time_utc = request.time_utc, .base = output.fit ? &*output.fit : nullptr};
    const DiagnosisOutput found = TRY(diagnose_recordings({&recording, 1}, diagnosis));
    files.push_back({diagnosis_name, found.files.conf});
    if (const std::string why = found.diagnosis.why_base_not_trusted(); !why.empty()) describe_trust(why, output.file);
  }
  files.push_back({parameters_name, TRY(format_parameter_file(output.file))});
  if (output.fit) {
    const auto bytes = TRY(format_statistics({output.file, unit_statistics(recording.data, *output.fit)}));
    files.push_back({statistics_name, std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())});
  }
  return files;
}

// Makes the folder, all at once, and returns whether it has these files. The folder of a faster thread or process stays.
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

// Returns whether a recording has a result. Removes a folder that has lost its result.
bool is_complete(const std::string& folder) {
  if (path_exists(folder + "/" + failure_name) || path_exists(folder + "/" + parameters_name)) return true;
  std::error_code error;
  fs::remove_all(folder, error);
  return false;
}

// Returns the outcome stored for a recording, by this process or earlier.
Work as_it_stands(const std::string& hash, const std::string& folder) {
  if (!path_exists(folder + "/" + failure_name)) return {Outcome::there, hash, "", {}};
  const Result<std::string> text = read_whole_file(folder + "/" + failure_name);
  std::string_view remaining = text ? std::string_view(*text) : std::string_view();
  next_line(remaining);  // skips the line that names the recording
  return {Outcome::failed, hash, std::string(next_line(remaining)), {}};
}

Work work_on(const ArchiveEntry& entry, const RecalibrationRequest& request) {
  const Result<LoadedRecording> recording = load_recording(entry.recording);
  if (!recording) return {Outcome::unreadable, "", recording.error().message, {}};
  // A cut or damaged recording has another hash, and would count beside the whole one.
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

// Counts the rows of a file of outcomes; each begins with `done`, `there`, `failed` or `unreadable`.
void count_outcomes(std::string_view rows, RecalibrationCounts& counts) {
  while (!rows.empty()) {
    const std::string_view row = next_line(rows);
    for (const Outcome outcome : {done, there, failed, unreadable})
      if (row.starts_with(std::string(outcome_names[outcome]) + ",")) ++count_of(outcome, counts);
  }
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
  for (std::size_t k = 0; k < works.size(); ++k)
    table.row({outcome_names[works[k].outcome], mine[k]->recording, works[k].hash, works[k].reason});
  TRY(write_file_atomically(outcome_file(request), table.csv()));
  return counts;
}

// ---- the archive in chunks, each a task of a Slurm array ----

namespace {

constexpr std::size_t recordings_of_a_chunk = 100, most_chunks = 1000;
constexpr double slurm_deadline_s = 60.0;

// Arguments: $1 the job's folder, $2 the number of chunks, then the command.
constexpr const char* task_script = R"(#!/bin/sh
folder=$1 chunks=$2
shift 2
exec "$@" --chunk "$SLURM_ARRAY_TASK_ID" "$chunks" --outcome "$folder/$SLURM_ARRAY_TASK_ID.csv"
)";

struct Job {
  std::string folder, name;
  std::vector<std::string> command;  // command of a task, with the script's arguments
  std::vector<int> attempts;         // of each chunk
};

Result<std::string> ask_slurm(const std::string& program, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), program);
  const Result<ChildEnd> said = pipe_through("slurm-client", std::move(arguments), "", slurm_deadline_s);
  if (!said) return device_error("engine slurm: " + said.error().message);
  return said->output;
}

// Submits the given tasks, neither finished nor in the queue, as one array.
Status submit(Job& job, const std::vector<int>& chunks) {
  const std::string list = fmt::format("{}", fmt::join(chunks, ","));
  std::vector<std::string> arguments = {"--parsable", "--requeue", "--job-name", job.name, "--output", "%a.log"};
  for (const std::string& word : {std::string("--chdir"), job.folder, std::string("--array"), list,
                                  std::string("--open-mode"), std::string("append"), job.folder + "/task.sh"})
    arguments.push_back(word);
  arguments.insert(arguments.end(), job.command.begin(), job.command.end());
  const std::string id = TRY(ask_slurm("sbatch", std::move(arguments)));
  for (const int k : chunks) ++job.attempts[std::size_t(k)];
  return {};
}

struct Queue {
  std::map<int, std::string> state;  // state of each queued chunk
  std::string words() const {
    std::map<std::string, int> counts;
    for (const auto& [chunk, state_words] : state) ++counts[state_words];
    std::vector<std::string> parts;
    for (const auto& [state_words, count] : counts) parts.push_back(fmt::format("{} {}", count, state_words));
    return join(parts);
  }
};

Result<Queue> queue_of(const Job& job) {
  const auto text = TRY(ask_slurm("squeue", {"--noheader", "--array", "--name", job.name, "--format", "%K %T %r"}));
  Queue queue;
  for (std::string_view remaining = text; !remaining.empty();) {
    const std::string_view line = trimmed(next_line(remaining));
    const std::size_t blank = line.find(' ');
    const std::optional<double> chunk = device_number(line.substr(0, blank));
    if (!chunk || blank == std::string_view::npos) continue;
    std::string words(line.substr(blank + 1));
    if (words.ends_with(" None")) words.resize(words.size() - 5);
    queue.state[int(*chunk)] = words;
  }
  return queue;
}

std::string file_of(const Job& job, std::size_t chunk, const char* ending) {
  return job.folder + "/" + std::to_string(chunk) + ending;
}

std::string last_line(const std::string& path) {
  const Result<std::string> text = read_whole_file(path);
  if (!text) return text.error().message;
  std::string last;
  for (std::string_view remaining = *text; !remaining.empty();)
    if (const std::string_view line = trimmed(next_line(remaining)); !line.empty()) last = line;
  return last.empty() ? path + ": is empty" : last;
}

Result<Job> prepare(const std::vector<ArchiveEntry>& archive, const RecalibrationRequest& request, std::size_t chunks) {
  const std::string store = fs::absolute(request.store).lexically_normal().string();
  const std::string list = TRY(format_archive(archive));
  TRY(make_folder(store + "/.jobs"));
  std::string folder = store + "/.jobs/XXXXXX";
  if (!::mkdtemp(folder.data())) return device_error(folder + ": cannot make");
  Job job{folder, "turncal-" + folder.substr(folder.size() - 6), {}, std::vector<int>(chunks, 0)};
  TRY(write_files_atomically({{folder + "/archive.csv", list}, {folder + "/task.sh", task_script}}));
  std::error_code error;
  const std::string program = fs::read_symlink("/proc/self/exe", error).string();
  job.command = {
      folder, std::to_string(chunks), program,         "recalibrate", folder + "/archive.csv",        "--out",
      store,  "--as-version",         request.version, "--threads",   std::to_string(request.threads)};
  if (!request.diagnose) job.command.emplace_back("--no-diagnosis");
  return job;
}

// Joins all chunks into recordings.csv, in order.
Status collect(const Job& job, const RecalibrationRequest& request) {
  std::string all = outcome_header;
  for (std::size_t k = 0; k < job.attempts.size(); ++k) {
    const Result<std::string> text = read_whole_file(file_of(job, k, ".csv"));
    if (text && text->starts_with(outcome_header)) all += text->substr(std::string_view(outcome_header).size());
  }
  return write_file_atomically(request.store + "/" + request.version + "/" + outcome_name, all);
}

}  // namespace

Result<RecalibrationCounts> recalibrate_on_slurm(const std::vector<ArchiveEntry>& archive,
                                                 const RecalibrationRequest& request, const SlurmOptions& options,
                                                 const RecalibrationProgress& progress) {
  const std::size_t wanted = options.chunks > 0 ? std::size_t(options.chunks)
                                                : std::min(archive.size() / recordings_of_a_chunk + 1, most_chunks);
  const std::size_t chunks = std::min(wanted, archive.size());
  Job job = TRY(prepare(archive, request, chunks));
  std::vector<int> open;
  for (std::size_t k = 0; k < chunks; ++k) open.push_back(int(k));
  if (Status status = submit(job, open); !status) {
    std::error_code error;
    fs::remove_all(job.folder, error);
    fs::remove(fs::path(job.folder).parent_path(), error);  // removed only if empty
    fs::remove(request.store, error);
    return status.error();
  }
  RecalibrationCounts counts;
  counts.entries = archive.size();
  std::vector<int> gone, failed;
  for (int polls = 1; !open.empty(); ++polls) {
    std::this_thread::sleep_for(std::chrono::seconds(std::clamp(polls / 10, 1, 15)));
    const Result<Queue> queue = queue_of(job);  // before the files: what has left the queue has written its file
    std::vector<int> still, missing;
    for (const int k : open) {
      const Result<std::string> text = read_whole_file(file_of(job, std::size_t(k), ".csv"));
      if (text)
        count_outcomes(*text, counts);
      else if (still.push_back(k); queue && !queue->state.contains(k))
        missing.push_back(k);
    }
    open = still;
    // Requires a file to be missing twice in a row, because a file server may show it late.
    std::vector<int> again;
    std::set_intersection(missing.begin(), missing.end(), gone.begin(), gone.end(), std::back_inserter(again));
    gone = missing;
    std::erase_if(again, [&](int k) {
      if (job.attempts[std::size_t(k)] < options.most_attempts) return false;
      failed.push_back(k);
      std::erase(open, k);
      return true;
    });
    if (!again.empty()) {
      TRY(submit(job, again));
      gone.clear();
    }
    counts.waiting = queue ? queue->words() : queue.error().message;
    progress(counts);
  }
  counts.waiting.clear();
  TRY(collect(job, request));
  if (failed.empty()) {
    std::error_code error;
    fs::remove_all(job.folder, error);
    return counts;
  }
  const std::string log = file_of(job, std::size_t(failed.front()), ".log");
  return device_error(fmt::format("{} of {} failed {}; {}: {}", failed.size(), counted(chunks, "chunk"),
                                  counted(options.most_attempts, "time"), log, last_line(log)));
}

// ---- what changed between versions ----

namespace {

Result<std::set<std::string>> recordings_of(const std::string& version) {
  std::set<std::string> names;
  std::error_code error;
  for (fs::directory_iterator at(version, error), end; at != end && !error; at.increment(error))
    if (at->is_directory() && !at->path().filename().string().starts_with('.'))
      names.insert(at->path().filename().string());
  if (error) return input_error(version + ": cannot read: " + error.message());
  return names;
}

std::string verdict_of(const std::string& folder) {
  if (path_exists(folder + "/" + failure_name)) return "failed";
  const std::string path = folder + "/" + diagnosis_name;
  if (!path_exists(path)) return "not_made";
  Result<KeyValueFile> file = KeyValueFile::read(path);
  return file && file->has("verdict") ? file->text("verdict") : "unreadable";
}

}  // namespace

Result<VersionChanges> compare_versions(const std::string& store, const std::string& from, const std::string& to) {
  VersionChanges changes{.from = from, .to = to};
  const std::string old_root = store + "/" + from + "/", new_root = store + "/" + to + "/";
  const std::set<std::string> olds = TRY(recordings_of(old_root));
  const std::set<std::string> news = TRY(recordings_of(new_root));
  std::vector<ParameterChange> all(parameter_count);
  std::vector<std::vector<double>> ratios(parameter_count);
  for (const std::string& name : olds) {
    if (!news.contains(name)) {
      ++changes.only_from;
      continue;
    }
    ++changes.both;
    ++changes.verdicts[{verdict_of(old_root + name), verdict_of(new_root + name)}];
    const std::string old_path = old_root + name + "/" + parameters_name,
                      new_path = new_root + name + "/" + parameters_name;
    if (!path_exists(old_path) || !path_exists(new_path)) continue;
    const ParameterFile before = TRY(read_parameter_file(old_path));
    const ParameterFile after = TRY(read_parameter_file(new_path));
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (!before.sigma[k] || !after.sigma[k] || !(*after.sigma[k] > 0.0) || !(*before.sigma[k] > 0.0)) continue;
      const auto at = Eigen::Index(k);
      const double change = (after.parameters[at] - before.parameters[at]) / *after.sigma[k];
      ParameterChange& c = all[k];
      ++c.recordings;
      c.mean += change;
      c.rms += change * change;
      ratios[k].push_back(*after.sigma[k] / *before.sigma[k]);
      if (std::abs(change) > std::abs(c.largest)) {
        c.largest = change;
        c.largest_unit = after.unit_serial;
        c.largest_recording = name;
      }
    }
  }
  for (const std::string& name : news) changes.only_to += !olds.contains(name);
  for (std::size_t k = 0; k < all.size(); ++k) {
    ParameterChange& c = all[k];
    if (c.recordings == 0) continue;
    c.key = parameter_keys[k];
    c.mean /= double(c.recordings);
    c.rms = std::sqrt(c.rms / double(c.recordings));
    c.sigma_ratio = median(ratios[k]);
    changes.parameters.push_back(std::move(c));
  }
  return changes;
}

Document changes_document(const VersionChanges& c) {
  using namespace cell;
  Document document{"", "From version " + c.from + " to " + c.to};
  document.text(fmt::format("from version {} to {}: {} in both, {} only in the first, {} only in the second", c.from,
                            c.to, counted(c.both, "recording"), c.only_from, c.only_to));
  Table parameters{
      {name("parameter"), number("mean"), number("rms"), number("largest"), number("sigma ratio"), name("unit")}};
  for (const ParameterChange& p : c.parameters)
    parameters.row({name(p.key), fixed(p.mean, 3), fixed(p.rms, 3), fixed(p.largest, 3), fixed(p.sigma_ratio, 3),
                    name(p.largest_unit)});
  if (!c.parameters.empty()) {
    document.section("parameters", "Change in sigmas of the second");
    document.add(std::move(parameters));
  }
  document.section("verdicts", "Verdicts");
  Table verdicts{{text("first"), text("second"), number("recordings")}};
  for (const auto& [was_is, recordings] : c.verdicts)
    verdicts.row({text(was_is.first), text(was_is.second), count(recordings)});
  document.add(std::move(verdicts));
  return document;
}

}  // namespace turncal
