#include "orchestrator/command_run.h"

#include <array>
#include <csignal>
#include <memory>

#include "imu_io/atomic_file.h"
#include "imu_io/format_number.h"
#include "imu_io/recording_check.h"
#include "imu_io/recording_source.h"
#include "orchestrator/builtin_sequence.h"
#include "orchestrator/calibration_job.h"
#include "orchestrator/dry_run_devices.h"
#include "orchestrator/output_folder.h"
#include "orchestrator/progress.h"
#include "orchestrator/recording_sink.h"
#include "orchestrator/result_table.h"
#include "orchestrator/run_log.h"
#include "orchestrator/station_run.h"
#include "orchestrator/truth.h"

namespace turncal {

namespace {

constexpr const char* parameters_name = "parameters.conf";
constexpr const char* truth_name = "truth.conf";
constexpr const char* log_name = "run.log";

struct RunOptions {
  bool dry_run = false;
  bool capture_only = false;
  std::string unit;
  std::string out;
  std::string rig;
  std::string sequence;
  std::string station;
};

// Everything that is checked before anything is made or moved.
struct PreparedRun {
  StationConfig station;
  RigConfig rig;
  Sequence sequence;
};

std::atomic<int> stop_requests{0};
static_assert(std::atomic<int>::is_always_lock_free);

// While this object lives, SIGINT, SIGTERM and SIGHUP ask the run to stop, and a reader of our output that goes away does
// not end the program: whatever happens to the terminal, the table is never left moving.
class StopSignals {
 public:
  StopSignals() {
    stop_requests = 0;
    for (std::size_t i = 0; i < signals.size(); ++i) {
      struct sigaction action {};
      action.sa_handler = signals[i] == SIGPIPE ? SIG_IGN : [](int) { stop_requests.fetch_add(1); };
      sigaction(signals[i], &action, &old_[i]);
    }
  }
  ~StopSignals() {
    for (std::size_t i = 0; i < signals.size(); ++i) sigaction(signals[i], &old_[i], nullptr);
  }
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

 private:
  static constexpr std::array<int, 4> signals = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};
  std::array<struct sigaction, 4> old_{};
};

// The run's log and what the operator sees, fed from the same events.
class Fanout : public RunObserver {
 public:
  Fanout(RunObserver& first, RunObserver& second) : first_(first), second_(second) {}
  void on_transition(const TransitionRecord& record) override {
    first_.on_transition(record);
    second_.on_transition(record);
  }
  void on_progress(const RunSnapshot& snapshot) override {
    first_.on_progress(snapshot);
    second_.on_progress(snapshot);
  }

 private:
  RunObserver& first_;
  RunObserver& second_;
};

Result<PreparedRun> prepare(const RunOptions& options) {
  PreparedRun run;
  if (!is_plain_text(options.unit)) {
    return input_error("--unit '" + options.unit + "': expected a serial number of printable characters without '#'");
  }
  run.station = default_station_config();
  if (!options.station.empty()) {
    Result<StationConfig> station = read_station_config(options.station);
    if (!station) return station.error();
    run.station = std::move(*station);
  }
  if (!options.dry_run) {
    if (!options.rig.empty()) return input_error("--rig describes a simulated table and unit: it needs --dry-run");
    return input_error("station '" + run.station.name +
                       "' has only mock devices (table.driver = mock, imu.driver = rig): nothing real would be "
                       "calibrated; use --dry-run to rehearse");
  }
  run.rig = default_rig_config();
  const std::string rig_file = options.rig.empty() ? run.station.rig_file : options.rig;
  if (!rig_file.empty()) {
    Result<RigConfig> rig = read_rig_config(rig_file);
    if (!rig) return rig.error();
    run.rig = std::move(*rig);
  }
  if (options.station.empty()) {  // the built-in station stands where the rig does
    run.station.latitude_deg = run.rig.site.latitude_deg;
    run.station.gravity_mps2 = run.rig.site.gravity_mps2;
  }
  Result<Sequence> sequence = options.sequence.empty()
                                  ? parse_sequence(builtin_sequence_text(), builtin_sequence_name())
                                  : read_sequence(options.sequence);
  if (!sequence) return sequence.error();
  run.sequence = std::move(*sequence);
  return run;
}

Status check_plan(const Plan& plan) {
  if (plan.ok()) return {};
  const std::size_t more = plan.violations.size() - 1;
  return input_error(plan.violations.front() +
                     (more > 0 ? " (and " + std::to_string(more) + " more; see turncal check)" : ""));
}

Result<CalibrationOutput> calibrate_capture(const OutputFolder& folder, const Clock& clock) {
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(folder.file(binary_recording_name));
  if (!source) return source.error();
  CalibrationRequest request;
  request.time_utc = format_utc(clock.utc_s());
  return calibrate_recording(**source, request);
}

// Calibrates the sealed recording and makes the results durable: the truth in any case, the parameter file last.
Status write_results(const OutputFolder& folder, const DryRunDevices& devices, bool capture_only,
                     std::optional<CalibrationOutput>& output) {
  Status calibrated;
  if (!capture_only) {
    Result<CalibrationOutput> result = calibrate_capture(folder, devices.clock);
    if (result) {
      output = std::move(*result);
    } else {
      calibrated = result.error();
    }
  }
  const std::optional<double> reference_c = output ? output->mean_temperature_c : std::nullopt;
  const Status written = write_file_atomically(folder.file(truth_name), format_truth(devices.rig, reference_c));
  if (!calibrated) return calibrated;
  if (!written || !output) return written;
  return write_parameter_file(output->file, folder.file(parameters_name));
}

void print_summary(const OutputFolder& folder, const RunOutcome& outcome, const std::optional<CalibrationOutput>& output,
                   double recorded_s, double wall_s, std::ostream& out) {
  char text[200];
  std::snprintf(text, sizeof text,
                "Dry run complete: %s recorded (%.10g s of station time) in %.1f s; %d dwells repeated, %llu samples lost.",
                format_duration(recorded_s).c_str(), recorded_s, wall_s, outcome.repeated_dwells,
                static_cast<unsigned long long>(outcome.lost_samples));
  out << text << '\n';
  if (output) {
    for (const std::string& note : output->notes) out << note << '\n';
    const Result<ParameterVector> truth = read_truth(folder.file(truth_name));
    out << '\n';
    print_results(output->file, truth ? std::optional(*truth) : std::nullopt, out);
    out << "\nparameters  " << folder.file(parameters_name) << '\n';
  }
  out << "truth       " << folder.file(truth_name) << '\n'
      << "recording   " << folder.file(binary_recording_name) << '\n'
      << "log         " << folder.file(log_name) << std::endl;
}

Status execute(const RunOptions& options, CommandContext& context) {
  const double began_s = steady_wall_s();
  Result<PreparedRun> prepared = prepare(options);
  if (!prepared) return prepared.error();
  DryRunDevices rig_devices(prepared->rig);
  RecordingInfo info;
  rig_devices.imu.describe(info);
  const Plan plan = make_plan(prepared->sequence, plan_limits(prepared->station, info.sample_period_s));
  if (Status status = check_plan(plan); !status) return status;

  Result<OutputFolder> folder = OutputFolder::prepare(
      options.out, {binary_recording_name, partial_recording_name, parameters_name, truth_name, log_name});
  if (!folder) return folder.error();
  const std::string tag = "[dry run] ";
  Result<RunLog> log = RunLog::create(folder->file(log_name), tag);
  if (!log) return log.error();
  log->line(std::string("turncal ") + software_version() + ", unit " + options.unit + ", station " +
            prepared->station.name + ", sequence " + prepared->sequence.name + ", rig seed " +
            format_number(prepared->rig.seed));

  ProgressView view(context.out, context.out_is_terminal ? context.terminal_columns : 0, tag, steady_wall_s);
  Fanout observers(*log, view);
  RecordingSink sink(folder->path());
  std::optional<CalibrationOutput> output;
  const StopSignals signals;
  const auto calibrate = [&] { return write_results(*folder, rig_devices, options.capture_only, output); };
  StationRun run(rig_devices.devices(), {prepared->sequence, plan, prepared->station, options.unit}, sink,
                 {&observers, &stop_requests, calibrate});
  const RunOutcome outcome = run.run();
  view.clear();
  if (outcome.state != RunState::done) {
    log->line(outcome.error.message);
    if (outcome.recorded_samples > 0) folder->keep();
    return outcome.error;
  }
  if (!log->status()) return log->status();
  folder->keep();
  const double recorded_s = static_cast<double>(outcome.recorded_samples) * info.sample_period_s;
  print_summary(*folder, outcome, output, recorded_s, steady_wall_s() - began_s, context.out);
  return {};
}

}  // namespace

void add_run_command(CLI::App& app, CommandContext& context) {
  const auto options = std::make_shared<RunOptions>();
  CLI::App* command = app.add_subcommand("run", "run a calibration: move the table, record, calibrate");
  command->add_flag("--dry-run", options->dry_run, "use the built-in rig (mock table, simulated IMU) in virtual time");
  command->add_option("--unit", options->unit, "serial number of the unit")->required();
  command->add_option("--out", options->out, "folder for the results; must not hold a run yet")->required();
  command->add_option("--rig", options->rig, "rig configuration (docs/rig.md); default: the built-in one");
  command->add_option("--sequence", options->sequence, "sequence file; default: the fourteen steps");
  command->add_option("--station", options->station, "station configuration; default: the built-in rig station");
  command->add_flag("--capture-only", options->capture_only, "record the sequence, do not calibrate");
  command->callback([options, &context] {
    if (Status status = execute(*options, context); !status) context.fail(status.error());
  });
}

}  // namespace turncal
