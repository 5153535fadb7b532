// `turncal recalibrate ARCHIVE --out STORE`: every recording of an archive again with this version, each once (recalibration.h), and what
// changed against another version. Exit code 0 though some recordings failed: they are listed.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <thread>

#include "imu_io/base/clock.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/fleet/slurm_array.h"
#include "orchestrator/fleet/version_changes.h"
#include "orchestrator/station/version.h"
#include "orchestrator/watch/progress.h"

namespace turncal {
namespace {

struct RecalibrateOptions {
  std::string archive;
  std::string store;
  std::string against;
  std::string version = software_version();
  std::string engine = "local";
  std::string outcome;
  std::vector<std::int64_t> chunk;
  int threads = 0, chunks = 0;
  bool no_diagnosis = false;
};

// On a terminal one line redrawn, elsewhere a line every tenth and whenever a queue has changed.
class CountPrinter {
 public:
  explicit CountPrinter(CommandContext& context) : context_(context), began_s_(monotonic_s()) {}
  ~CountPrinter() {
    if (context_.out_is_terminal && shown_ > 0) context_.out << '\n';
  }
  void show(const RecalibrationCounts& c) {
    const std::size_t step = context_.out_is_terminal ? 1 : std::max<std::size_t>(c.entries / 10, 1);
    if (c.finished() < c.entries && c.finished() < shown_ + step && c.waiting == waiting_) return;
    shown_ = c.finished();
    waiting_ = c.waiting;
    const double spent_s = monotonic_s() - began_s_;
    const double worked = static_cast<double>(c.done + c.failed + c.unreadable);
    const double left_s = worked > 0.0 ? spent_s / worked * static_cast<double>(c.entries - c.finished()) : 0.0;
    char text[160];
    std::snprintf(text, sizeof text, "%zu of %zu recordings, %zu were there, %zu failed", c.finished(), c.entries,
                  c.there, c.failed + c.unreadable);
    std::string line = text;
    if (worked > 0.0 && left_s > 0.0)
      line += ", " + format_duration(left_s) + " left, until " + format_utc(wall_utc_s() + left_s);
    if (!c.waiting.empty()) line += "; " + c.waiting;
    if (context_.out_is_terminal)
      context_.out << '\r' << line << "\x1b[K" << std::flush;
    else
      context_.out << line << std::endl;
  }

 private:
  CommandContext& context_;
  double began_s_;
  std::size_t shown_ = 0;
  std::string waiting_;
};

Status recalibrate_archive(const RecalibrateOptions& options, CommandContext& context) {
  RecalibrationRequest request{.store = options.store,
                               .version = options.version,
                               .time_utc = format_utc(wall_utc_s()),
                               .diagnose = !options.no_diagnosis,
                               .outcome = options.outcome};
  if (options.version.empty() || options.version.front() == '.' || options.version.find('/') != std::string::npos)
    return input_error("--as-version " + turncal::quoted(options.version) +
                       ": expected the name of a folder in the store: without /, and no dot at its beginning");
  const bool on_slurm = options.engine == "slurm";
  if (on_slurm && (!options.chunk.empty() || !options.outcome.empty()))
    return input_error("--engine slurm: makes the chunks itself: expected neither --chunk nor --outcome");
  if (!on_slurm && options.chunks > 0) return input_error("--chunks: expected --engine slurm");
  if (!options.chunk.empty()) {
    if (options.chunk[1] < 1 || options.chunk[0] < 0 || options.chunk[0] >= options.chunk[1])
      return input_error("--chunk " + std::to_string(options.chunk[0]) + " " + std::to_string(options.chunk[1]) +
                         ": expected K N with K from 0 to N - 1");
    request.chunk = static_cast<int>(options.chunk[0]);
    request.chunks = static_cast<int>(options.chunk[1]);
  }
  request.threads = options.threads > 0 ? options.threads
                    : on_slurm          ? 1
                                        : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  const std::vector<ArchiveEntry> archive = TRY(read_archive(options.archive));
  Result<RecalibrationCounts> counts = RecalibrationCounts{};
  {
    CountPrinter printer(context);
    const auto show = [&](const RecalibrationCounts& c) { printer.show(c); };
    counts = on_slurm ? recalibrate_on_slurm(archive, request, {.chunks = options.chunks}, show)
                      : recalibrate(archive, request, show);
  }
  if (!counts) return counts.error();
  context.out << counts->done << " done, " << counts->there << " were there, " << counts->failed
              << " cannot be calibrated, " << counts->unreadable << " cannot be read: " << options.store << '/'
              << request.version << std::endl;
  if (options.against.empty()) return {};
  const VersionChanges changes = TRY(compare_versions(options.store, options.against, request.version));
  context.out << as_text(changes_document(changes));
  return {};
}

}  // namespace

void add_recalibrate_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<RecalibrateOptions>();
  const Command command =
      line.command("recalibrate", "calibrate every recording of an archive again with this version");
  command.option("archive", options->archive, "a folder with recordings below it, a CSV list, or a results database")
      .required();
  command.option("--out", options->store, "store: a folder; what is there already is not done again").required();
  command.option("--against", options->against, "say what changed against this version of the store");
  command.option("--as-version", options->version, "name of the version in the store").default_in_help();
  command.option("--engine", options->engine, "who does the work: this machine, or an array job of Slurm")
      .one_of({"local", "slurm"})
      .default_in_help();
  command.option("--chunks", options->chunks, "tasks of the array job; default: one for 100 recordings").range(1, 1000);
  command.option("--threads", options->threads, "recordings at a time; default: all cores, of a Slurm task one")
      .range(1, 256);
  command.option("--chunk", options->chunk, "K N: only every N-th recording from the K-th (0 to N - 1)").words(2);
  command.option("--outcome", options->outcome,
                 "what became of each recording (CSV); default: recordings.csv in the store");
  command.flag("--no-diagnosis", options->no_diagnosis, "calibrate only");
  command.runs(context, [options, &context] { return recalibrate_archive(*options, context); });
}

}  // namespace turncal
