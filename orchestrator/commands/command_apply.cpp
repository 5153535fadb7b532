// `turncal apply RECORDING --parameters FILE --out CSV`: calibrated increments of every sample,
//   dtheta = n counts_gyro - N0 dt  [rad],   dv = a counts_accel - A0 dt  [m/s],   dt the sample period.
// Refused: a wrong checksum, a missing key, parameters of another unit, simulated parameters on a real unit's recording.
// Effects beyond the 24 parameters are taken off as the estimate modelled them (effect_terms.h).
#include <filesystem>
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/format_number.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/effect_terms.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct ApplyOptions {
  std::string recording;
  std::string parameters;
  std::string out;
};

void append_row(const ImuSample& sample, const SensorModel& model, const EffectTerms::Term& effects, double period_s,
                std::string& text) {
  const Eigen::Vector3d dtheta = model.gyro_scale * Eigen::Vector3d(sample.gyro[0], sample.gyro[1], sample.gyro[2]) -
                                 (model.gyro_bias_radps + effects.rate_radps) * period_s;
  const Eigen::Vector3d dv = model.accel_scale * Eigen::Vector3d(sample.accel[0], sample.accel[1], sample.accel[2]) -
                             (model.accel_bias_mps2 + effects.force_mps2) * period_s;
  NumberBuffer buffer;
  text += format_number(sample.counter, buffer);
  for (const double value : {dtheta[0], dtheta[1], dtheta[2], dv[0], dv[1], dv[2]}) {
    text += ',';
    text += format_number(value, buffer);
  }
  text += '\n';
}

Status apply(const ApplyOptions& options, CommandContext& context) {
  const Result<ParameterFile> parameters = read_parameter_file(options.parameters);
  if (!parameters) return parameters.error();
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(options.recording);
  if (!source) return source.error();
  const RecordingInfo& info = (*source)->info();
  if (Status status = check_applicable(*parameters, options.parameters, info); !status) return status;
  Result<EffectTerms> effects = EffectTerms::of(*parameters, options.parameters, **source);
  if (!effects) return effects.error();
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
  std::string text = "sample,dtheta_x_rad,dtheta_y_rad,dtheta_z_rad,dv_x_mps,dv_y_mps,dv_z_mps\n";
  if (Status status = check_replaceable(options.out, text); !status) return status;
  Result<AtomicFile> file = AtomicFile::create(options.out);
  if (!file) return file.error();
  const SensorModel model = sensor_model(from_vector(parameters->parameters), info);
  std::int64_t samples = 0;
  Status status = (*source)->read([&](std::span<const ImuSample> block) {
    for (const ImuSample& sample : block)
      append_row(sample, model, effects->at(sample.counter), info.sample_period_s, text);
    samples += static_cast<std::int64_t>(block.size());
    Status written = file->write(text);
    text.clear();
    return written;
  });
  if (!status) return status;
  if (status = file->write(text); !status) return status;
  if (status = file->commit(); !status) return status;
  context.out << "calibrated increments of " << samples << " samples  " << options.out << std::endl;
  return {};
}

}  // namespace

void add_apply_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<ApplyOptions>();
  const Command command = line.command("apply", "write calibrated increments of a recording");
  command.option("recording", options->recording, "a folder (binary or text form) or a .tcr file").required();
  command.option("--parameters", options->parameters, "parameter file").required();
  command.option("--out", options->out, "CSV file to write; an existing one is replaced, whole").required();
  command.runs(context, [options, &context] { return apply(*options, context); });
}

}  // namespace turncal
