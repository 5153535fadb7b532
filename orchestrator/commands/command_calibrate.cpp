#include "orchestrator/commands/command_calibrate.h"

#include <chrono>
#include <filesystem>
#include <memory>

#include "imu_io/base/clock.h"
#include "orchestrator/devices/truth.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/result_table.h"

namespace turncal {

namespace {

namespace fs = std::filesystem;

struct CalibrateOptions {
  std::string recording;
  std::string out;
  std::string method = calibration_methods[0];
  bool partial = false;
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
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(options.recording);
  if (!source) return source.error();
  CalibrationRequest request;
  request.method = options.method;
  request.partial = options.partial;
  request.time_utc =
      format_utc(std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count());
  const Result<CalibrationOutput> output = calibrate_recording(**source, request);
  if (!output) return output.error();
  // An earlier result in the folder is replaced, whole.
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {});
  if (!folder) return folder.error();
  const std::string file = folder->file("parameters.conf");
  if (Status status = write_parameter_file(output->file, file); !status) return status;
  folder->keep();
  for (const std::string& note : output->notes) context.out << note << '\n';
  context.out << '\n';
  print_results(output->file, truth_beside(options.recording), context.out);
  context.out << "\nparameters  " << file << std::endl;
  return {};
}

}  // namespace

void add_calibrate_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = app.add_subcommand("calibrate", "estimate the parameters from a recording");
  command->add_option("recording", options->recording, "a folder (binary or text form) or a .tcr file")->required();
  command->add_option("--out", options->out, "folder for parameters.conf")->required();
  command->add_option("--method", options->method, "how to estimate")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(calibration_methods), std::end(calibration_methods))))
      ->capture_default_str();
  command->add_flag("--partial", options->partial, "write a result even if some parameters are not determined");
  command->callback([options, &context] {
    if (Status status = calibrate(*options, context); !status) context.fail(status.error());
  });
}

}  // namespace turncal
