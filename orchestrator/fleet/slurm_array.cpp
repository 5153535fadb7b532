#include "orchestrator/fleet/recalibration.h"

#include <stdlib.h>

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <thread>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t recordings_of_a_chunk = 100, most_chunks = 1000;
constexpr double slurm_deadline_s = 60.0;

// $1: the job's folder, $2: the number of chunks, then the command.
constexpr const char* task_script = R"(#!/bin/sh
folder=$1 chunks=$2
shift 2
exec "$@" --chunk "$SLURM_ARRAY_TASK_ID" "$chunks" --outcome "$folder/$SLURM_ARRAY_TASK_ID.csv"
)";

struct Job {
  std::string folder, name;
  std::vector<std::string> command;  // of a task, with what the script needs
  std::vector<int> attempts;         // of each chunk
};

Result<std::string> ask_slurm(const std::string& program, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), program);
  const Result<ChildEnd> said = pipe_through("slurm-client", std::move(arguments), "", slurm_deadline_s);
  if (!said) return device_error("engine slurm: " + said.error().message);
  return said->output;
}

// The tasks that are not finished and not in the queue, in one array.
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
  std::map<int, std::string> state;  // of each chunk in it
  std::string words() const {
    std::map<std::string, int> counts;
    for (const auto& [chunk, state_words] : state) ++counts[state_words];
    std::vector<std::string> parts;
    for (const auto& [state_words, count] : counts) parts.push_back(fmt::format("{} {}", count, state_words));
    return join(parts);
  }
};

Result<Queue> queue_of(const Job& job) {
  const std::string text =
      TRY(ask_slurm("squeue", {"--noheader", "--array", "--name", job.name, "--format", "%K %T %r"}));
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

// All chunks together as recordings.csv, in the order of the chunks.
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
    fs::remove(fs::path(job.folder).parent_path(), error);  // where they are empty
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
    // Twice in a row: a file server may show a file late.
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
  const auto first = std::size_t(failed.front());
  const std::string log = file_of(job, first, ".log");
  return device_error(fmt::format("{} of {} chunks failed {} times; {}: {}", failed.size(), chunks,
                                  options.most_attempts, log, last_line(log)));
}

}  // namespace turncal
