#include "orchestrator/commands/command_diagnose.h"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <sstream>

#include "calib/diagnosis/diagnosis.h"
#include "calib/diagnosis/rest_diagnosis.h"
#include "calib/rests/single_pose.h"
#include "calib/statistics/segmentation.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/compress_source.h"
#include "orchestrator/jobs/run_results.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/pose_report.h"
#include "orchestrator/report/report.h"
#include "orchestrator/report/rest_report.h"
#include "orchestrator/report/rest_view.h"
#include "orchestrator/watch/progress.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

struct DiagnoseOptions {
  std::string recording;
  std::string holdout;
  std::string out;
  std::optional<double> arw_deg_per_rt_h;
  std::optional<double> vrw_ug_per_rt_hz;
  double gyro_bias_instability_degph = 0.0;
  double accel_bias_instability_ug = 0.0;
};

// What is going on, for work that takes longer than a blink: on a terminal one line that is redrawn, elsewhere one line a phase.
class Phases {
 public:
  explicit Phases(const CommandContext& context) : out_(context.out), terminal_(context.out_is_terminal) {}
  ~Phases() { clear(); }
  void begin(const std::string& what) {
    what_ = what;
    if (terminal_)
      show("");
    else
      out_ << what << std::endl;
  }
  void samples(std::int64_t count) {
    const double now_s = steady_wall_s();
    if (!terminal_ || now_s - drawn_s_ < 0.1) return;
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
  bool terminal_;
  bool shown_ = false;
  std::string what_;
  double drawn_s_ = -1e9;
};

struct LoadedRecording {
  CompressedRecording recording;
  bool by_hand = false;  // no table angles
  std::string hash;
  std::vector<std::string> notes;
};

Result<LoadedRecording> load(const std::string& path, Phases& phases) {
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(path);
  if (!source) return source.error();
  if (!(*source)->segments().empty()) phases.begin("reading " + path);
  Result<CompressedRecording> recording = compress_source(**source, [&](std::int64_t count) { phases.samples(count); });
  if (!recording) return recording.error();
  LoadedRecording loaded;
  loaded.recording = std::move(*recording);
  loaded.by_hand = without_table_angles((*source)->segments());
  Result<std::string> hash = (*source)->content_hash();
  if (!hash) return hash.error();
  loaded.hash = *hash;
  if (std::string damage = describe((*source)->damage()); !damage.empty()) loaded.notes.push_back(path + ": " + damage);
  bool any_rest = false;
  for (const Block& block : loaded.recording.blocks) any_rest = any_rest || block.whole_second;
  if (!any_rest) return input_error(path + ": not one whole second at rest: expected dwells to calibrate from");
  return loaded;
}

Status check_same_unit(const std::string& path, const RecordingInfo& holdout, const RecordingInfo& fitted) {
  const auto refuse = [&](const std::string& key, const std::string& value, const std::string& expected) -> Status {
    return input_error(path + ": " + key + " = '" + value + "': expected '" + expected +
                       "', as in the recording to be fitted");
  };
  if (holdout.unit_serial != fitted.unit_serial) return refuse("unit_serial", holdout.unit_serial, fitted.unit_serial);
  const auto kind = [](IncrementKind k) { return std::string(k == IncrementKind::pulses ? "pulses" : "rad or mps"); };
  if (holdout.gyro_increment != fitted.gyro_increment)
    return refuse("gyro_increment", kind(holdout.gyro_increment), kind(fitted.gyro_increment));
  if (holdout.accel_increment != fitted.accel_increment)
    return refuse("accel_increment", kind(holdout.accel_increment), kind(fitted.accel_increment));
  if (fitted.accel_increment == IncrementKind::pulses && holdout.accel_pulse_mps != fitted.accel_pulse_mps)
    return refuse("accel_pulse_mps", format_number(holdout.accel_pulse_mps), format_number(fitted.accel_pulse_mps));
  return {};
}

// The recordings' own folders are not written to: parameters.conf may be there, the result of a run.
Status check_out(const DiagnoseOptions& options) {
  for (const std::string& path : {options.recording, options.holdout}) {
    if (path.empty()) continue;
    std::error_code error;
    const fs::path folder = fs::is_directory(path, error) ? fs::path(path) : fs::absolute(path, error).parent_path();
    if (fs::equivalent(folder, options.out, error)) {
      return input_error("--out " + options.out + ": is the folder of the recording " + path +
                         ": expected another one, the recording's own files are not touched");
    }
  }
  return {};
}

Result<std::optional<NoiseModel>> noise_given(const DiagnoseOptions& options, const CompressedRecording& recording) {
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
  const RecordingInfo& info = recording.info;
  if (info.gyro_increment == IncrementKind::pulses)
    noise.gyro_pulse_rad = sensor_model(start_parameters(info), info).gyro_scale(0, 0);
  if (info.accel_increment == IncrementKind::pulses) noise.accel_pulse_mps = info.accel_pulse_mps;
  return std::optional(noise);
}

// Verdict, report and files of one recording.
struct Outcome {
  Verdict verdict = Verdict::unexplained;
  std::vector<std::string> table;
  WrittenDiagnosis written;
};

Result<Outcome> diagnose_table(const DiagnoseOptions& options, const LoadedRecording& fitted,
                               const LoadedRecording* holdout, const OutputFolder& folder, DiagnosisContext& report,
                               Phases& phases) {
  const Result<std::optional<NoiseModel>> noise = noise_given(options, fitted.recording);
  if (!noise) return noise.error();
  DiagnosisOptions settings;
  settings.estimate.noise = *noise;
  if (holdout != nullptr) settings.holdout = &holdout->recording;
  phases.begin("diagnosing: fit, scores of the catalogue, selection, held-out data");
  const Diagnosis diagnosis = diagnose(fitted.recording, settings);
  if (!diagnosis.base.converged) return Error{ErrorKind::unit_failed, options.recording + ": " + diagnosis.reason};
  report.false_alarm = settings.false_alarm;
  report.noise_given = noise->has_value();
  phases.begin("writing the report");
  const Result<WrittenDiagnosis> written = write_diagnosis(folder.path(), diagnosis, report);
  if (!written) return written.error();
  return Outcome{diagnosis.verdict, terminal_table(diagnosis, report), *written};
}

Result<Outcome> diagnose_single_pose(const DiagnoseOptions& options, const OutputFolder& folder) {
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(options.recording);
  if (!source) return source.error();
  const Result<CompressedRecording> recording = compress_source(**source, CompressionOptions{});
  if (!recording) return recording.error();
  const Result<SinglePose> pose = analyse_single_pose(*recording);
  if (!pose) return input_error(options.recording + ": " + pose.error().message);
  const Result<WrittenDiagnosis> written = write_diagnosis_files(folder.path(), {}, format_pose(*pose), {});
  if (!written) return written.error();
  return Outcome{Verdict::not_tested, pose_table(*pose), *written};
}

Result<Outcome> diagnose_hand_turned(const DiagnoseOptions& options, const LoadedRecording& fitted,
                                     const LoadedRecording* holdout, const OutputFolder& folder,
                                     DiagnosisContext& report, Phases& phases) {
  if (options.arw_deg_per_rt_h || options.vrw_ug_per_rt_hz || options.gyro_bias_instability_degph > 0.0 ||
      options.accel_bias_instability_ug > 0.0)
    return input_error(options.recording +
                       ": has no table angles: expected no --arw, --vrw or bias instability, the noise is "
                       "measured in the rests");
  const RestData data = make_rest_data(fitted.recording);
  if (data.rests.size() == 1) return diagnose_single_pose(options, folder);
  std::optional<RestData> other;
  RestDiagnosisOptions settings;
  if (holdout != nullptr) {
    other = make_rest_data(holdout->recording);
    if (other->legs.empty()) return input_error(options.holdout + ": holds no rotation between two rests");
    settings.holdout = &*other;
  }
  phases.begin("diagnosing: fit, scores of the catalogue, selection, rests left out");
  const Result<RestDiagnosis> result = diagnose_rests(data, settings);
  if (!result) return Error{result.error().kind, options.recording + ": " + result.error().message};
  report.notes.insert(report.notes.end(), data.notes.begin(), data.notes.end());
  report.false_alarm = settings.false_alarm;
  report.method = rest_method;
  report.hand_turned = true;
  const Diagnosis diagnosis = as_diagnosis(*result, data);
  phases.begin("writing the report");
  const Result<WrittenDiagnosis> written = write_rest_diagnosis(folder.path(), *result, data, diagnosis, report);
  if (!written) return written.error();
  if (!result->base.converged)
    return Outcome{
        diagnosis.verdict, {"verdict     " + verdict_sentence(diagnosis, report, Alphabet::plain)}, *written};
  return Outcome{diagnosis.verdict,
                 terminal_table(diagnosis, report, rest_words(*result, data, diagnosis, Alphabet::plain)), *written};
}

Result<Verdict> diagnose_recording(const DiagnoseOptions& options, CommandContext& context) {
  const double began_s = steady_wall_s();
  if (Status status = check_out(options); !status) return status.error();
  Phases phases(context);
  Result<LoadedRecording> fitted = load(options.recording, phases);
  if (!fitted) return fitted.error();
  std::optional<LoadedRecording> holdout;
  if (!options.holdout.empty()) {
    Result<LoadedRecording> loaded = load(options.holdout, phases);
    if (!loaded) return loaded.error();
    if (Status s = check_same_unit(options.holdout, loaded->recording.info, fitted->recording.info); !s)
      return s.error();
    if (loaded->hash == fitted->hash) {
      return input_error(options.holdout +
                         ": is the recording to be fitted itself: expected data that is not used in the fit");
    }
    if (loaded->by_hand != fitted->by_hand)
      return input_error(options.holdout + ": expected a recording " + (fitted->by_hand ? "without" : "with") +
                         " table angles, as the one to be fitted");
    holdout = std::move(*loaded);
  }

  DiagnosisContext report(fitted->recording);
  report.recording_path = options.recording;
  report.recording_hash = fitted->hash;
  report.holdout_path = options.holdout;
  report.time_utc =
      format_utc(std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count());
  report.notes = fitted->notes;
  if (holdout) report.notes.insert(report.notes.end(), holdout->notes.begin(), holdout->notes.end());

  // An earlier result in the folder is replaced, file by file, each one whole.
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {});
  if (!folder) return folder.error();
  const Result<Outcome> outcome = (fitted->by_hand ? diagnose_hand_turned : diagnose_table)(
      options, *fitted, holdout ? &*holdout : nullptr, *folder, report, phases);
  if (!outcome) return outcome.error();
  folder->keep();
  phases.clear();
  for (const std::string& note : report.notes) context.out << note << '\n';
  context.out << '\n';
  for (const std::string& line : outcome->table) context.out << line << '\n';
  context.out << '\n';
  if (!outcome->written.plot_problem.empty())
    context.out << "report without plots: " << outcome->written.plot_problem << '\n';
  std::error_code error;
  for (const auto& [what, name] :
       {std::pair("report      ", report_name), {"diagnosis   ", diagnosis_name}, {"parameters  ", "parameters.conf"}})
    if (fs::exists(folder->file(name), error)) context.out << what << folder->file(name) << '\n';
  context.out << significant(steady_wall_s() - began_s, 2) << " s" << std::endl;
  return outcome->verdict;
}

constexpr double least_recording_s = 1800.0;

}  // namespace

void diagnose_run(const std::string& folder, const Status& run, CommandContext& context) {
  if (!run && run.error().kind != ErrorKind::unit_failed) return;
  const fs::path recording = fs::path(folder) / binary_recording_name;
  std::error_code error;
  if (!fs::exists(recording, error) || !fs::exists(fs::path(folder) / parameters_name, error)) return;
  const Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(recording.string());
  if (!source) return context.fail(source.error());
  const Segments& segments = (*source)->segments();
  const std::int64_t samples = segments.empty() ? 0 : segments.back().end_sample - segments.front().start_sample;
  if (static_cast<double>(samples) * (*source)->info().sample_period_s < least_recording_s) return;
  DiagnoseOptions options;
  options.recording = recording.string();
  options.out = (fs::path(folder) / "diagnosis").string();
  std::ostringstream text;
  CommandContext inside{text, context.err};
  const Result<Verdict> verdict = diagnose_recording(options, inside);
  const std::string_view simulated = fs::exists(fs::path(folder) / truth_name, error) ? dry_run_tag : simulated_tag;
  const std::string_view tag = (*source)->info().simulated ? simulated : std::string_view();
  std::istringstream lines(text.str());
  for (std::string line; std::getline(lines, line);) context.out << tag << line << '\n';
  context.out << std::flush;
  if (!verdict)
    context.fail(verdict.error());
  else if (*verdict != Verdict::clean && context.exit_code == 0)
    context.exit_code = exit_code(ErrorKind::unit_failed);
}

void add_diagnose_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<DiagnoseOptions>();
  const Command command = line.command(
      "diagnose", "find, name and add an effect that the 24 parameters lack; report the error before and after");
  command.option("recording", options->recording, "a folder (binary or text form) or a .tcr file").required();
  command.option("--holdout", options->holdout,
                 "another recording of the unit, not used in the fit; default: dwells left out in turn");
  command.option("--out", options->out, "folder for parameters.conf, diagnosis.conf and report.html").required();
  command.option("--arw", options->arw_deg_per_rt_h, "angle random walk, deg/sqrt(h): noise given, not measured")
      .positive();
  command.option("--vrw", options->vrw_ug_per_rt_hz, "velocity random walk, ug/sqrt(Hz)").positive();
  command.option("--gyro-bias-instability", options->gyro_bias_instability_degph, "deg/h, with --arw and --vrw")
      .not_negative();
  command.option("--accel-bias-instability", options->accel_bias_instability_ug, "ug, with --arw and --vrw")
      .not_negative();
  command.runs(context, [options, &context]() -> Status {
    const Result<Verdict> verdict = diagnose_recording(*options, context);
    if (!verdict) return verdict.error();
    if (*verdict != Verdict::clean) context.exit_code = exit_code(ErrorKind::unit_failed);
    return {};
  });
}

}  // namespace turncal
