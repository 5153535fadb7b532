// `turncal predict` (calib/prediction/predict.h), also for a sequence that the station cannot run; `turncal design` (docs/sequences.md,
// orchestrator/jobs/design/sequence_design.h).
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "calib/prediction/predict.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/devices/dry_run_devices.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/jobs/prediction_job.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/jobs/run_request.h"
#include "orchestrator/report/result_table.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

struct PredictCommandOptions {
  PredictRequest request;
  std::string format;  // json; empty: text
};

Status run_predict(const PredictCommandOptions& options, CommandContext& context) {
  context.out << as(options.format, TRY(predict_sequences(options.request)).document);
  return {};
}

constexpr double longest_design_s = 43200.0;  // longest searched, with --sigma
constexpr double longest_extra_legs_s = 600.0;
constexpr double usual_acceleration_degps2 = 20.0;                     // where the table allows it
constexpr std::string_view first_words = "# Found by turncal design";  // of the file

// Effects beyond the 24 parameters of a kind of unit (docs/diagnosis.md names the sources), and the rise of temperature that excites them.
struct Grade {
  std::string_view name, effects;
  double rise_c;
};
constexpr Grade grades[] = {{"fog", "gyro_bias_temperature_rate gyro_bias_temperature_lag gyro_scale_temperature", 8.0},
                            {"hrg", "gyro_wave_angle", 0.0}};

struct DesignOptions {
  PlannedSite site;
  DesignTask task;      // uses its least_rest_s, effects and tries
  double time_s = 0.0;  // 0: not given
  std::string sigma, separate, from, start, out, grade, criterion = "mean";
  std::vector<std::string> axes, rates;
  std::optional<double> acceleration_degps2, temperature_rise_c;
  int seed = 1;
};

Error too_much(const char* option, double value, double most, Axis axis) {
  return input_error("{} {}: expected at most {}, the limit of the table's {} axis", option, format_number(value),
                     format_number(most), to_string(axis));
}

// Takes axes, rates and effects by name; rejects those that the table or the catalogue does not have.
Status choose(const DesignOptions& options, DesignTask& task) {
  if (!options.axes.empty()) task.turns = {};
  for (const std::string& name : options.axes) {
    const auto axis = std::ranges::find_if(all_axes, [&](Axis a) { return name == to_string(a); });
    if (axis == all_axes.end())
      return input_error("--axes " + name + ": expected " + one_of(name, {"heading", "pitch", "roll"}));
    task.turns[index(*axis)] = true;
  }
  if (!options.rates.empty()) task.rates_degps.clear();
  for (const std::string& text : options.rates) {
    const std::optional<double> rate = parse_number(text);
    if (!rate || !(*rate >= 0.1 && *rate <= 1000.0))
      return input_error("--rate " + text + ": expected deg/s from 0.1 to 1000");
    task.rates_degps.push_back(*rate);
  }
  task.acceleration_degps2 = options.acceleration_degps2.value_or(usual_acceleration_degps2);
  for (const Axis axis : all_axes) {
    if (!task.turns[index(axis)]) continue;
    const AxisLimits& limits = task.limits[axis];
    if (!options.acceleration_degps2)
      task.acceleration_degps2 = std::min(task.acceleration_degps2, limits.max_acceleration_degps2);
    for (const double rate : task.rates_degps)
      if (!options.rates.empty() && rate > limits.max_rate_degps)
        return too_much("--rate", rate, limits.max_rate_degps, axis);
    if (task.acceleration_degps2 > limits.max_acceleration_degps2)
      return too_much("--acceleration", task.acceleration_degps2, limits.max_acceleration_degps2, axis);
  }
  std::vector<std::string> known;
  for (const PredictedEffect& e : task.effect_aims) known.emplace_back(e.column.entry->name);
  for (const std::string& name : task.effects)
    if (std::ranges::find(known, name) == known.end())
      return input_error("--effects " + name + ": expected " +
                         (find_effect(name)
                              ? "--temperature-rise beside it, which shows it"
                              : "an effect of the catalogue (docs/diagnosis.md)" + did_you_mean(name, known)));
  return {};
}

// Returns the file's name without extension, in characters that a sequence may have.
std::string name_of(const std::string& file) {
  std::string name = std::filesystem::path(file).stem().string();
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-' && c != '.') c = '_';
  return name.empty() ? "designed" : name;
}

// Reads the wanted sigmas, `key = sigma` in units of the parameter file; parameters that are not named do not count.
Status read_aims(const std::string& path, DesignTask& task) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  task.aim.setZero();
  for (const int k : free_parameters()) task.aim[k] = file.number_or(parameter_key(k), 0.0, positive);
  TRY(file.check_all_used());
  if (task.aim.maxCoeff() <= 0.0) return input_error(path + ": expected a line like N01 = 0.003");
  return {};
}

// Returns the least time by white noise alone: a bias is known no better than the random walk over the root of the time.
Result<double> least_time_s(const DesignTask& task) {
  const ParameterVector si = si_per_unit(task.info);
  double least_s = 600.0;
  for (int k = 0; k < 6; ++k) {
    if (task.aim[k] <= 0.0) continue;
    const NoiseModel& noise = task.predict.noise;
    const double walk = k < 3 ? noise.angle_random_walk[k] : noise.velocity_random_walk[k - 3];
    const double needed_s = std::pow(walk / (task.aim[k] * si[k]), 2);
    if (needed_s > longest_design_s)
      return input_error("{} = {:.3g} needs {:.3g} h with this noise: expected a sigma that 12 h can give",
                         parameter_key(k), task.aim[k], needed_s / 3600.0);
    least_s = std::max(least_s, needed_s);
  }
  return least_s;
}

bool reaches(const Prediction& prediction, const ParameterVector& aim) {
  for (int k = 0; k < parameter_count; ++k)
    if (aim[k] > 0.0 && !(prediction.determined[std::size_t(k)] && prediction.sigma[k] <= aim[k])) return false;
  return true;
}

class Designer {
 public:
  Designer(const DesignOptions& options, CommandContext& context)
      : options_(options), context_(context), task_(options.task) {}

  Status run() {
    TRY(check_site(options_.site));
    double rise_c = 0.0;
    for (const Grade& grade : grades) {
      if (grade.name != options_.grade) continue;
      for (const auto& effect : split_words(grade.effects)) task_.effects.emplace_back(effect);
      rise_c = grade.rise_c;
    }
    if (rise_c = options_.temperature_rise_c.value_or(rise_c); rise_c != 0.0)
      task_.predict.temperature = TemperatureProfile{.rise_c = rise_c};
    if (!options_.separate.empty() && (!options_.sigma.empty() || !task_.effects.empty()))
      return input_error("--separate: expected neither --sigma nor --effects with it");
    if (options_.separate.empty() != options_.from.empty())
      return input_error("--separate, --from: expected both, an effect and the recording that it was found in");
    if (options_.separate.empty() && (options_.time_s > 0.0) == !options_.sigma.empty())
      return input_error("expected --time or --sigma, one of them");
    // Checked before minutes of search, not after them.
    TRY(check_replaceable(options_.out, first_words));
    if (const Result<AtomicFile> writable = AtomicFile::create(options_.out); !writable) return writable.error();
    const PlannedUnit unit = TRY(planned_unit(options_.site));
    TRY(prepare(unit));
    if (!options_.separate.empty()) return separate();
    if (!options_.sigma.empty()) {
      TRY(read_aims(options_.sigma, task_));
      double time_s = TRY(least_time_s(task_));
      task_.tries = std::max(100, task_.tries / 5);
      for (task_.time_s = time_s;; task_.time_s *= 1.25) {
        if (task_.time_s > longest_design_s)
          return Error{ErrorKind::unit_failed,
                       options_.sigma + ": no sequence of 12 h was found that gives these sigmas"};
        says("looking for " + format_duration(task_.time_s));
        TRY(search());
        if (reaches(columns_.back().prediction, task_.aim)) break;
        columns_.pop_back();
      }
    } else {
      task_.time_s = options_.time_s;
      TRY(search());
    }
    const std::string bound = bound_text(columns_.back().prediction);
    const std::string text = text_of(walk_, task_.time_s, bound);
    TRY(write_file_atomically(options_.out, text));
    Document document;
    Facts premises = describe_premises(options_.site, unit.info);
    premises.rows.emplace_back("time", fmt::format("{:.0f} s", columns_.back().station_s));
    document.add(std::move(premises));
    document.add(sigma_table(columns_, unit.info));
    if (!bound.empty()) document.text(bound);
    add_undetermined(columns_, document);
    if (task_.predict.effects) add_detectable(columns_, document);
    context_.out << as_text(document);
    context_.out << "sequence    " << options_.out << std::endl;
    const std::vector<std::string> open = open_parameters(columns_.back().prediction, task_.aim);
    if (open.empty()) return {};
    return Error{ErrorKind::unit_failed, options_.out + ": " + coverage_text(open)};
  }

 private:
  void says(const std::string& progress) const {
    if (!context_.quiet) context_.err << progress << std::endl;
  }

  // Finds the shortest legs that separate the alias class of an effect, after the recording it was found in.
  Status separate() {
    const double time_s = options_.time_s > 0.0 ? options_.time_s : longest_extra_legs_s;
    const LoadedRecording loaded = TRY(load_recording(options_.from));
    TRY(check_data(loaded));
    if (loaded.by_hand)
      return input_error(options_.from + ": " + no_table_angles + ": expected a recording made on a table");
    says("diagnosing " + options_.from);
    const Diagnosis diagnosis = diagnose(loaded.data);
    const auto found = diagnosis.aliases.find(options_.separate);
    if (found == diagnosis.aliases.end() || found->second.empty()) {
      std::vector<std::string> classes;
      for (const auto& [name, others] : diagnosis.aliases)
        if (!others.empty()) classes.push_back(name);
      return input_error("--separate {}: expected an effect that {} cannot tell from others: {}", options_.separate,
                         options_.from,
                         classes.empty() ? std::string("it has none, its diagnosis is ") + to_string(diagnosis.verdict)
                                         : join(classes));
    }
    const Separation separation(loaded.data, diagnosis, options_.separate);
    task_.info = loaded.data.info;
    task_.limits.sample_period_s = task_.info.sample_period_s;
    task_.time_s = time_s;
    const ExtraLegs legs = TRY(find_extra_legs(
        &separation, task_, [&](double longest_s) { says("looking for " + format_duration(longest_s)); }));
    const std::vector<AliasPair> before = separation.pairs(nullptr, 0.0);
    std::string open;
    double least = separating_gain;
    for (std::size_t k = 0; k < legs.after.size(); ++k) {
      const AliasPair& pair = legs.after[k];
      context_.out << fmt::format("{} from {}: 2 ln L {:.1f}, with these legs {:.1f} ({:.0f} is enough)\n", pair.truth,
                                  pair.other, before[k].gain, pair.gain, separating_gain);
      least = std::min(least, pair.gain);
      if (pair.gain < separating_gain && open.find(pair.other) == std::string::npos)
        open += (open.empty() ? "" : ", ") + pair.truth + " from " + pair.other;
    }
    if (least < SelectionLimits{}.bic_margin)
      return Error{ErrorKind::unit_failed, "no motion of this table in " + format_duration(time_s) +
                                               " was found that tells apart: " + open + "; no sequence is written"};
    TRY(write_file_atomically(options_.out, text_of(legs.walk, legs.time_s)));
    context_.out << "sequence    " << options_.out << ", " << format_duration(legs.time_s) << std::endl;
    if (legs.apart) return {};
    return Error{ErrorKind::unit_failed, options_.out + ": may not be enough to tell apart: " + open};
  }

  // Returns the distance to the lower bound; empty when a parameter that counts is undetermined, by the walk or by any turns.
  std::string bound_text(const Prediction& prediction) {
    if (!open_parameters(prediction, task_.aim).empty()) return {};
    says("computing the lower bound");
    if (!options_.sigma.empty()) task_.criterion = AimAt::worst;
    const std::optional<double> least = design_bound(task_);
    if (!least) return {};
    double sum = 0.0, worst = 0.0;
    int n = 0;
    for (int k = 0; k < parameter_count; ++k) {
      if (task_.aim[k] <= 0.0) continue;
      sum += std::log(prediction.sigma[k] / task_.aim[k]);
      worst = std::max(worst, prediction.sigma[k] / task_.aim[k]);
      ++n;
    }
    const bool mean = task_.criterion == AimAt::mean;
    return fmt::format("{} of sigma / aim {:.3f}; no sequence of such turns with rests of {:.3g} s can be below {:.3f}",
                       mean ? "Geometric mean" : "Largest", mean ? std::exp(sum / n) : worst, task_.least_rest_s,
                       std::exp(*least));
  }

  std::string text_of(const Walk& walk, double time_s, const std::string& bound = {}) const {
    WalkHeader header{.name = name_of(options_.out),
                      .comments = {std::string(first_words).substr(2) + " for " + format_number(std::round(time_s)) +
                                   " s: see docs/sequences.md."}};
    if (!bound.empty()) header.comments.push_back(bound + ".");
    header.rate_degps = task_.rates_degps.front();
    header.acceleration_degps2 = task_.acceleration_degps2;
    return sequence_text(walk, header);
  }

  Status prepare(const PlannedUnit& unit) {
    const Sequence reference = TRY(parse_sequence(std::string(builtin_sequence_text), "fourteen_step.seq"));
    const Sequence start = TRY(options_.start.empty() ? reference : read_sequence(options_.start));
    task_.limits = plan_limits(unit.station, unit.info.sample_period_s);
    task_.info = unit.info;
    task_.predict.noise = noise_model(options_.site);
    task_.predict.unit = unit.parameters;
    task_.predict.effects = !task_.effects.empty();
    task_.seed = std::uint64_t(options_.seed);
    task_.criterion = options_.criterion == "worst" ? AimAt::worst : AimAt::mean;
    columns_.push_back(predicted(reference));
    task_.aim = columns_.front().prediction.sigma;
    for (int k = 0; k < parameter_count; ++k)
      if (const std::optional<double> most = unit.station.limits.sigma_max[std::size_t(k)]) task_.aim[k] = *most;
    task_.effect_aims = columns_.front().prediction.effects;
    task_.start = on_table(walk_of(start), task_.limits);
    return choose(options_, task_);
  }

  NamedPrediction predicted(const Sequence& sequence) const {
    const Plan plan = make_plan(sequence, task_.limits);
    return {sequence.name, predict(task_.info, planned_motion(sequence, plan), task_.predict), plan.station_s};
  }

  // Finds the best walk of task_.time_s: returns its text, and adds its prediction as the last column.
  Status search() {
    const double began_s = monotonic_s();
    double printed_s = began_s;
    const Result<Design> found = design_walk(task_, [&](const DesignProgress& progress) {
      const double now_s = monotonic_s();
      if (now_s - printed_s < 5.0 && progress.done < progress.tries) return true;
      printed_s = now_s;
      const double left_s = (now_s - began_s) / progress.done * (progress.tries - progress.done);
      says(fmt::format("tried {} of {}  cost {:.4f}  {}  {} left", progress.done, progress.tries, progress.cost,
                       counted(progress.legs, "leg"), format_duration(left_s)));
      return true;
    });
    if (!found) return found.error();
    walk_ = found->walk;
    const Result<Sequence> sequence = parse_sequence(text_of(walk_, task_.time_s), options_.out);
    if (!sequence) return Error{ErrorKind::internal, sequence.error().message};
    columns_.push_back(predicted(*sequence));
    return {};
  }

  const DesignOptions& options_;
  CommandContext& context_;
  DesignTask task_;
  std::vector<NamedPrediction> columns_;  // the fourteen steps, then the walks found
  Walk walk_;
};

Status design(const DesignOptions& options, CommandContext& context) { return Designer(options, context).run(); }

}  // namespace

void add_site_options(const Command& command, PlannedSite& site) {
  command.option("--station", site.station, "station configuration; default: the built-in rig station");
  command.option("--latitude", site.latitude_deg, "latitude, degrees; default: the station's");
  command.option("--gravity", site.gravity_mps2, "gravity, m/s^2; default: the station's");
  command.option("--arw", site.arw_deg_per_rt_h, {is::default_in_help}, "angle random walk, deg/sqrt(h)");
  command.option("--vrw", site.vrw_ug_per_rt_hz, {is::default_in_help}, "velocity random walk, ug/sqrt(Hz)");
  command.option("--gyro-bias-instability", site.gyro_bias_instability_degph, {is::default_in_help},
                 "bias instability of the gyros, deg/h");
  command.option("--accel-bias-instability", site.accel_bias_instability_ug, {is::default_in_help},
                 "bias instability of the accelerometers, ug");
}

void add_predict_command(CommandLine& line) {
  const auto [command, options] = line.command<PredictCommandOptions>(
      "predict", "predict the sigma of each parameter after a sequence; nothing moves", run_predict);
  PredictRequest& request = options.request;
  command.option("--sequence", request.sequences, {is::required}, "sequence file; several are compared side by side");
  add_site_options(command, request.site);
  command.flag("--effects", request.effects,
               "report the smallest effects that would be detected, and which are confounded");
  command.option("--temperature-rise", request.temperature_rise_c, {is::default_in_help},
                 "temperature rise over the run, C, for --effects");
  command.option("--temperature-tau", request.temperature_tau_s, {is::time(1.0, 1e6), is::default_in_help},
                 "time constant of the temperature rise");
  command.option("--navigate", request.navigate_s, {is::time(1.0, 86400.0)},
                 "predict the drift of free navigation after this time");
  command.option("--align", request.align_s, {is::time(20.0, 86400.0), is::default_in_help},
                 "alignment before the navigation");
  command.option("--format", options.format, {is::one_of({"json"})}, "print the result in this form instead of text");
}

void add_design_command(CommandLine& line) {
  const auto [command, options] =
      line.command<DesignOptions>("design", "find a sequence with small sigmas in a given time; nothing moves", design);
  command.option("--time", options.time_s, {is::time(1.0, 86400.0)}, "length of the run");
  command.option("--sigma", options.sigma,
                 "instead of --time: file of wanted sigmas (N01 = 0.003); finds the shortest run that reaches them");
  command.option("--separate", options.separate,
                 "effect that a diagnosis found: design the shortest legs, at most --time (10min), that separate it "
                 "from the effects it is confounded with");
  command.option("--from", options.from, "recording or run with that diagnosis");
  command.option("--out", options.out, {is::required}, "sequence file to write");
  add_site_options(command, options.site);
  command.option("--start", options.start, "sequence that the search starts from; default: the fourteen steps");
  command.option("--aim", options.criterion, {is::one_of({"mean", "worst"}), is::default_in_help},
                 "minimise the mean of all sigmas, or the worst");
  command.option("--effects", options.task.effects, "effects of the catalogue that the sequence should make visible");
  command.option(
      "--grade", options.grade, {is::one_of({"fog", "hrg"})},
      "make the usual effects of fibre-optic (fog) or hemispherical resonator (hrg) gyros visible (docs/diagnosis.md)");
  command.option("--temperature-rise", options.temperature_rise_c,
                 "temperature rise over the run, C, for --effects; default: 0, with --grade fog 8");
  command.option("--axes", options.axes, "axes that may turn: heading, pitch, roll; default: all");
  command.option("--rate", options.rates, "rates to choose from, deg/s; default: 10, or the axis limit");
  command.option("--acceleration", options.acceleration_degps2, {is::positive},
                 "acceleration, deg/s^2; default: 20, or the table limit");
  command.option("--least-rest", options.task.least_rest_s, {is::time(2.0, 3600.0), is::default_in_help},
                 "shortest rest");
  command.option("--seed", options.seed, {is::in(0, 1000000000), is::default_in_help}, "seed of the search");
  command.option("--tries", options.task.tries, {is::in(1, 1000000), is::default_in_help},
                 "number of candidate sequences");
}

}  // namespace turncal
