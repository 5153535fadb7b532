// `turncal calibrate RECORDING... --out DIR [--method ...]`: writes DIR/parameters.conf from any recording, or from several of one unit. A
// truth.conf beside the first (as after a dry run) is compared with the result. Exit code 20, the file written, where the data speak
// against its sigmas.
#include <filesystem>
#include <memory>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/data_text.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/truth.h"
#include "orchestrator/fleet/prior_history.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

struct CalibrateOptions {
  std::vector<std::string> recordings;
  std::string out;
  std::string format;
  std::string method = calibration_methods[0];
  bool partial = false;
  PriorSource prior;
};

std::optional<ParameterVector> truth_beside(const std::string& recording) {
  std::error_code error;
  const fs::path folder = fs::is_directory(recording, error) ? fs::path(recording) : fs::path(recording).parent_path();
  const fs::path file = folder / "truth.conf";
  if (!fs::exists(file, error)) return std::nullopt;
  const Result<ParameterVector> truth = read_truth(file.string());
  return truth ? std::optional(*truth) : std::nullopt;
}

Status calibrate(const CalibrateOptions& options, CommandContext& context) {
  std::vector<LoadedRecording> recordings;
  for (const std::string& path : options.recordings) {
    TRY(check_not_source(options.out, path));
    LoadedRecording recording = TRY(load_recording(path));
    recordings.push_back(std::move(recording));
  }
  OutputFolder folder = TRY(OutputFolder::prepare_results(options.out, recordings.front().data.info.unit_serial));
  CalibrationRequest request;
  request.method = options.method;
  request.time_utc = format_utc(wall_utc_s());
  const bool with_prior = !options.prior.from.empty();
  if (with_prior && (recordings.size() > 1 || options.method != calibration_methods[0]))
    return input_error("--prior: expected one recording, and the method joint");
  if (!with_prior && !options.prior.part.empty()) return input_error("--part: expected --prior");
  request.partial = options.partial || with_prior;
  CalibrationOutput output = TRY(calibrate_recordings(recordings, request));
  add_measured_utc(recordings.front().data.info, output.file);
  std::optional<StatisticsFile> statistics;  // for the fleet: of the data alone
  if (const std::optional<UnitStatistics> found = statistics_of(recordings, output))
    statistics = StatisticsFile{output.file, *found};
  if (with_prior) {
    TRY(add_prior(options.prior, recordings.front(), request, output));
    const std::string open = undetermined_parameters(*output.fit);
    if (!open.empty() && !options.partial) return not_determined("this recording does not determine " + open);
  }
  const std::string file = folder.file(parameters_name);
  TRY(write_parameter_file(output.file, file));
  if (statistics) {
    TRY(write_statistics(*statistics, folder.file(statistics_name)));
  }
  folder.keep();
  if (!options.format.empty()) {
    const std::string text = TRY(format_parameter_file(output.file));
    context.out << key_values_as(options.format, text) << std::flush;
  } else {
    for (const std::string& note : output.notes) context.out << note << '\n';
    context.out << '\n'
                << as_text(result_table(output.file, truth_beside(options.recordings.front()))) << "\nparameters  "
                << file << std::endl;
  }
  if (output.distrust.empty()) return {};
  return Error{ErrorKind::unit_failed, file + ": not trusted: " + output.distrust};
}

}  // namespace

void add_calibrate_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<CalibrateOptions>();
  const Command command = line.command("calibrate", "estimate the parameters from a recording");
  command.option("recording", options->recordings, "a folder (binary or text form) or a .tcr file; several of one unit")
      .required();
  command.option("--out", options->out, "folder for parameters.conf").required();
  command.option("--method", options->method, "how to estimate")
      .one_of(std::vector<std::string>(std::begin(calibration_methods), std::end(calibration_methods)))
      .default_in_help();
  command.option("--format", options->format, "print parameters.conf in this form instead of words")
      .one_of(data_formats);
  command.flag("--partial", options->partial, "write a result even if some parameters are not determined");
  command.option("--prior", options->prior.from,
                 "what earlier calibrations say: a results database, a store of `turncal recalibrate`, or a folder "
                 "with runs below it");
  command.option("--part", options->prior.part, "of the prior: only units of this part number");
  command.runs(context, [options, &context] { return calibrate(*options, context); });
}

}  // namespace turncal
