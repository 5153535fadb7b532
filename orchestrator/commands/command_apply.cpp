// `turncal apply RECORDING --parameters FILE --out FILE`: calibrated increments of every sample (calibrated_intervals.h), as CSV, .npy, .mat or
// a recording (.tcr), by the name of the file.
// Refused: a wrong checksum, a missing key, parameters of another unit, simulated parameters on a real unit's recording.
#include <filesystem>
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/format_number.h"
#include "imu_io/recordings/matrix_writer.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct ApplyOptions {
  std::string recording;
  std::string parameters;
  std::string out;
};

void append_row(const ImuSample& sample, std::string& text) {
  NumberBuffer buffer;
  text += format_number(sample.counter, buffer);
  for (const auto& increments : {sample.gyro, sample.accel})
    for (const double value : increments) {
      text += ',';
      text += format_number(value, buffer);
    }
  text += '\n';
}

Status write_csv(RecordingSource& source, const std::string& path) {
  std::string text = "sample,dtheta_x_rad,dtheta_y_rad,dtheta_z_rad,dv_x_mps,dv_y_mps,dv_z_mps\n";
  TRY(check_replaceable(path, text));
  AtomicFile file = TRY(AtomicFile::create(path));
  Status status = source.read([&](std::span<const ImuSample> block) {
    for (const ImuSample& sample : block) append_row(sample, text);
    Status written = file.write(text);
    text.clear();
    return written;
  });
  if (!status) return status;
  if (status = file.write(text); !status) return status;
  return file.commit();
}

// By the name of the file: a recording, .npy or .mat, or CSV.
Status write_calibrated(RecordingSource& source, const std::string& path) {
  if (names_matrix(path)) return write_recording_columns(source, path);
  if (!path.ends_with(".tcr")) return write_csv(source, path);
  TRY(check_replaceable(path, recording_beginning));
  return import_binary(source, path);
}

Status apply(const ApplyOptions& options, CommandContext& context) {
  if (Status status = check_ending(options.out, {".csv", ".npy", ".mat", ".tcr"}); !status) return status;
  const ParameterFile parameters = TRY(read_parameter_file(options.parameters));
  std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(options.recording));
  std::unique_ptr<CalibratedSource> calibrated = TRY(CalibratedSource::of(parameters, options.parameters, *source));
  std::error_code error;
  if (std::filesystem::is_directory(options.out, error)) {
    return input_error(options.out + ": expected a file name, found a folder");
  }
  if (Status status = check_apart({{"the source", options.recording},
                                   {"the source", options.recording + "/" + binary_recording_name},
                                   {"the source", options.recording + "/imu.csv"},
                                   {"the source", options.parameters},
                                   {"--out", options.out}});
      !status) {
    return status;
  }
  TRY(write_calibrated(*calibrated, options.out));
  context.out << "calibrated increments  " << options.out << std::endl;
  return {};
}

}  // namespace

void add_apply_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<ApplyOptions>();
  const Command command = line.command("apply", "write calibrated increments of a recording");
  command.option("recording", options->recording, "a folder (binary or text form) or a .tcr file").required();
  command.option("--parameters", options->parameters, "parameter file").required();
  command
      .option("--out", options->out,
              "file to write: .csv, .npy, .mat or .tcr (a recording); an existing one is replaced, whole")
      .required();
  command.runs(context, [options, &context] { return apply(*options, context); });
}

}  // namespace turncal
