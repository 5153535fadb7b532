// `turncal prune`: removes old recordings and keeps all that was made of them.
//
// A recording goes when all of this holds: its run has given its unit a verdict, and not `hold`; it was sealed more than so many days ago;
// its unit has a newer one of a finished run; nobody works in the run's folder. Parameters, reports, journal and log stay, and the log says
// what was removed. What cannot be read is left as it is, and is an error at the end.
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>

#include "imu_io/base/clock.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/run_attempt.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/records/journal_contents.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/parameter_store.h"
#include "orchestrator/watch/progress.h"
#include "orchestrator/watch/run_log.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

struct PruneOptions {
  std::string folder;
  int days = 0;
  bool list = false;
};

// Of a unit that has its verdict.
struct OldRecording {
  std::string unit, run, path, tag;
  double sealed_utc_s = 0.0;
  bool simulated = false, held = false;
  std::pair<std::string, bool> whose() const { return {unit, simulated}; }
};

Status add_recordings(const std::string& run, std::vector<OldRecording>& found) {
  const JournalContents journal = TRY(read_journal(run + "/" + journal_name));
  const std::vector<std::string> units = journal.units();
  for (const std::string& unit : units) {
    const std::string folder = units.size() > 1 ? run + "/" + name_of_unit(unit) : run;
    const std::string path = folder + "/" + binary_recording_name;
    const JournalFields* const verdict = journal.verdict_of(unit);
    if (!verdict || !journal.seal_utc_s || !path_exists(path)) continue;
    const std::pair<std::string, std::string> hold("result", to_string(UnitVerdict::hold));
    found.push_back({.unit = unit,
                     .run = run,
                     .path = path,
                     .tag = std::string(tag_of(journal)),
                     .sealed_utc_s = *journal.seal_utc_s,
                     .simulated = journal.begin_value("simulated") == "true",
                     .held = std::find(verdict->begin(), verdict->end(), hold) != verdict->end()});
  }
  return {};
}

Status remove(const OldRecording& recording) {
  const LockFile held = TRY(hold_folder(recording.run));
  RunLog log = TRY(RunLog::append(recording.run + "/" + log_name, recording.tag));
  log.line(format_utc(wall_utc_s()) + "  " + recording.path + removed_by_prune);
  if (!log.status()) return log.status();
  std::error_code error;
  fs::remove(recording.path, error);
  return error ? Status(storage_error(recording.path, "cannot be removed", error.value())) : Status();
}

std::string megabytes(std::uintmax_t bytes) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.1f MB", 1e-6 * static_cast<double>(bytes));
  return text.data();
}

Status prune(const PruneOptions& options, std::ostream& out) {
  std::error_code error;
  fs::recursive_directory_iterator entries(options.folder, error);
  if (error) return input_error(options.folder + ": cannot be read: " + error.message());
  std::vector<OldRecording> found;
  Status left;
  for (const fs::recursive_directory_iterator end; !error && entries != end; entries.increment(error)) {
    if (entries->path().filename() != journal_name) continue;
    const Status added = add_recordings(entries->path().parent_path().string(), found);
    if (left && !added) left = added;
  }
  if (error) return device_error(options.folder + ": cannot be read: " + error.message());

  std::map<std::pair<std::string, bool>, double> newest;
  for (const OldRecording& recording : found) {
    double& utc_s = newest.emplace(recording.whose(), recording.sealed_utc_s).first->second;
    utc_s = std::max(utc_s, recording.sealed_utc_s);
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
  const double before_utc_s = wall_utc_s() - 86400.0 * options.days;
  std::size_t gone = 0;
  std::uintmax_t bytes = 0;
  for (const OldRecording& recording : found) {
    if (recording.held || recording.sealed_utc_s >= before_utc_s ||
        recording.sealed_utc_s >= newest.at(recording.whose()))
      continue;
    const std::uintmax_t size = fs::file_size(recording.path, error);
    const Status removed = options.list ? Status() : remove(recording);
    if (left && !removed) left = removed;
    if (!removed || error) continue;
    ++gone;
    bytes += size;
    out << recording.path << "  unit " << recording.unit << ", " << format_utc(recording.sealed_utc_s) << ", "
        << megabytes(size) << '\n';
  }
  out << gone << " of " << found.size() << " recordings " << (options.list ? "would be removed, " : "removed, ")
      << megabytes(bytes) << std::endl;
  return left;
}

}  // namespace

void add_prune_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<PruneOptions>();
  const Command command = line.command(
      "prune", "remove old recordings of finished units; never the last one of a unit, nor one that is on hold");
  command.option("folder", options->folder, "folder with the folders of runs").required();
  command.option("--older-than", options->days, "days since the recording was sealed").range(1, 36500).required();
  command.flag("--list", options->list, "only say what would be removed");
  command.runs(context, [options, &context] { return prune(*options, context.out); });
}

}  // namespace turncal
