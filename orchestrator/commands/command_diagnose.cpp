// `turncal diagnose RECORDING... [--holdout RECORDING]... --out DIR`: do the data hold an effect beyond the 24 parameters? Fits, scores
// every effect of the catalogue, adds what stands the test on held-out data, and writes DIR/parameters.conf,
// DIR/diagnosis.conf and DIR/report.html. Exit code 0 when the verdict is clean, 20 when it is not.

#include <memory>
#include <optional>

#include "imu_io/base/clock.h"
#include "imu_io/recordings/matrix_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/jobs/diagnosis_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/watch/progress.h"

namespace turncal {
namespace {

struct DiagnoseOptions {
  std::vector<std::string> recordings;
  std::vector<std::string> holdouts;
  std::string out;
  std::string residuals, format;
  std::optional<double> arw_deg_per_rt_h;
  std::optional<double> vrw_ug_per_rt_hz;
  double gyro_bias_instability_degph = 0.0;
  double accel_bias_instability_ug = 0.0;
};

// What is going on, for work that takes longer than a blink: on a terminal one line that is redrawn, elsewhere one line a phase.
class Phases {
 public:
  // `silent`: what is printed is for a program.
  Phases(const CommandContext& context, bool silent)
      : out_(context.out), terminal_(context.out_is_terminal), silent_(silent) {}
  ~Phases() { clear(); }
  void begin(const std::string& what) {
    what_ = what;
    if (silent_) return;
    if (terminal_)
      show("");
    else
      out_ << what << std::endl;
  }
  void samples(std::int64_t count) {
    const double now_s = monotonic_s();
    if (!terminal_ || silent_ || now_s - drawn_s_ < 0.1) return;
    drawn_s_ = now_s;
    show("  " + significant(1e-6 * static_cast<double>(count), 3) + " million samples");
  }
  void clear() {
    if (shown_) out_ << "\r\x1b[K" << std::flush;
    shown_ = false;
  }

 private:
  void show(const std::string& more) {
    out_ << '\r' << what_ << more << "\x1b[K" << std::flush;
    shown_ = true;
  }
  std::ostream& out_;
  bool terminal_, silent_;
  bool shown_ = false;
  std::string what_;
  double drawn_s_ = -1e9;
};

Result<std::vector<LoadedRecording>> load(const std::vector<std::string>& paths, Phases& phases) {
  std::vector<LoadedRecording> all;
  for (const std::string& path : paths) {
    const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
    if (!source->segments().empty()) phases.begin("reading " + path);
    Result<LoadedRecording> loaded = load_recording(*source, [&](std::int64_t count) { phases.samples(count); });
    if (!loaded) return loaded.error();
    all.push_back(std::move(*loaded));
  }
  return all;
}

std::vector<const LoadedRecording*> each_of(const std::vector<LoadedRecording>& recordings) {
  std::vector<const LoadedRecording*> each;
  for (const LoadedRecording& recording : recordings) each.push_back(&recording);
  return each;
}

Result<std::optional<NoiseModel>> noise_given(const DiagnoseOptions& options, const RecordingInfo& info) {
  if (!options.arw_deg_per_rt_h && !options.vrw_ug_per_rt_hz) {
    if (options.gyro_bias_instability_degph > 0.0 || options.accel_bias_instability_ug > 0.0)
      return input_error(
          "--gyro-bias-instability and --accel-bias-instability fix the noise: expected --arw and --vrw with them");
    return std::optional<NoiseModel>{};
  }
  if (!options.arw_deg_per_rt_h || !options.vrw_ug_per_rt_hz)
    return input_error("--arw and --vrw fix the noise together: expected both or neither");
  NoiseModel noise;
  noise.angle_random_walk.setConstant(*options.arw_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(*options.vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  noise.gyro_bias_instability_radps = options.gyro_bias_instability_degph * radps_per_degph;
  noise.accel_bias_instability_mps2 = options.accel_bias_instability_ug * 1e-6 * standard_gravity_mps2;
  if (info.gyro_increment == IncrementKind::pulses) noise.gyro_pulse_rad = nominal_gyro_rad(info);
  if (info.accel_increment == IncrementKind::pulses) noise.accel_pulse_mps = info.accel_pulse_mps;
  return std::optional(noise);
}

Result<Verdict> diagnose(const DiagnoseOptions& options, CommandContext& context) {
  const double began_s = monotonic_s();
  for (const std::vector<std::string>& sources : {options.recordings, options.holdouts})
    for (const std::string& source : sources) TRY(check_not_source(options.out, source));
  if (!options.residuals.empty())
    if (Status status = check_ending(options.residuals, {".csv", ".npy", ".mat"}); !status) return status.error();
  Phases phases(context, !options.format.empty());
  const std::vector<LoadedRecording> fitted = TRY(load(options.recordings, phases));
  const std::vector<LoadedRecording> holdouts = TRY(load(options.holdouts, phases));
  const RecordingInfo& info = fitted.front().data.info;
  std::optional<NoiseModel> noise = TRY(noise_given(options, info));
  DiagnosisRequest request;
  request.time_utc = format_utc(wall_utc_s());
  request.holdouts = each_of(holdouts);
  request.noise = noise;
  request.samples = (options.holdouts.empty() ? options.recordings : options.holdouts).front();
  request.phase = [&phases](const std::string& what) { phases.begin(what); };
  OutputFolder folder = TRY(OutputFolder::prepare_results(options.out, info.unit_serial));
  const DiagnosisOutput output = TRY(diagnose_recordings(each_of(fitted), request));
  const std::string plot_problem = TRY(write_diagnosis(folder.path(), output.files));
  folder.keep();
  phases.clear();
  if (!options.residuals.empty()) {
    const std::vector<NumberColumn> columns = residual_columns(output.diagnosis);
    TRY(write_columns(options.residuals, columns));
  }
  if (!options.format.empty()) {
    context.out << key_values_as(options.format, output.files.conf) << std::flush;
    return output.diagnosis.verdict;
  }
  const DiagnosisFiles& files = output.files;
  context.out << '\n' << as_text(files.report, diagnosis_lines) << '\n';
  if (!plot_problem.empty()) context.out << "report without plots: " << plot_problem << '\n';
  if (!files.report.title.empty()) context.out << "report      " << folder.file(report_name) << '\n';
  context.out << "diagnosis   " << folder.file(diagnosis_name) << '\n';
  if (files.parameters) context.out << "parameters  " << folder.file(parameters_name) << '\n';
  context.out << significant(monotonic_s() - began_s, 2) << " s" << std::endl;
  return output.diagnosis.verdict;
}

}  // namespace

void add_diagnose_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<DiagnoseOptions>();
  const Command command = line.command(
      "diagnose", "find, name and add an effect that the 24 parameters lack; report the error before and after");
  command.option("recording", options->recordings, "a folder (binary or text form) or a .tcr file; several of one unit")
      .required();
  command
      .option(
          "--holdout", options->holdouts,
          "another recording of the unit, not used in the fit (again for more); default: recordings, or dwells, left "
          "out in turn")
      .one_word_each();
  command.option("--out", options->out, "folder for parameters.conf, diagnosis.conf and report.html").required();
  command.option("--residuals", options->residuals, "writes the residuals to this file, too: .csv, .npy or .mat");
  command.option("--format", options->format, "print diagnosis.conf in this form instead of words")
      .one_of(data_formats);
  command.option("--arw", options->arw_deg_per_rt_h, "angle random walk, deg/sqrt(h): noise given, not measured")
      .positive();
  command.option("--vrw", options->vrw_ug_per_rt_hz, "velocity random walk, ug/sqrt(Hz)").positive();
  command.option("--gyro-bias-instability", options->gyro_bias_instability_degph, "deg/h, with --arw and --vrw")
      .not_negative();
  command.option("--accel-bias-instability", options->accel_bias_instability_ug, "ug, with --arw and --vrw")
      .not_negative();
  command.runs(context, [options, &context]() -> Status {
    const Verdict verdict = TRY(diagnose(*options, context));
    if (verdict != Verdict::clean) context.exit_code = exit_code(ErrorKind::unit_failed);
    return {};
  });
}

}  // namespace turncal
