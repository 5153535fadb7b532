// `turncal design`: a sequence found for a time (orchestrator/jobs/sequence_design.h; docs/design.md).
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/commands/command_predict.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/planned_unit.h"
#include "orchestrator/jobs/sequence_coverage.h"
#include "orchestrator/jobs/sequence_design.h"
#include "orchestrator/report/prediction_table.h"
#include "orchestrator/station/builtin_sequence.h"
#include "orchestrator/watch/progress.h"

namespace turncal {
namespace {

struct DesignOptions {
  PlannedSite site;
  std::string time, start, out, criterion = "mean";
  std::vector<std::string> effects, axes, rates;
  double acceleration_degps2 = 20.0, least_rest_s = 10.0;
  int seed = 1, tries = 1500;
};

// Axes, rates and effects by their names; those that the table or the catalogue does not have are refused.
Status choose(const DesignOptions& options, DesignTask& task) {
  if (!options.axes.empty()) task.turns = {};
  for (const std::string& name : options.axes) {
    const auto axis = std::ranges::find_if(all_axes, [&](Axis a) { return name == to_string(a); });
    if (axis == all_axes.end()) return input_error("--axes " + name + ": expected heading, pitch or roll");
    task.turns[index(*axis)] = true;
  }
  if (!options.rates.empty()) task.rates_degps.clear();
  for (const std::string& text : options.rates) {
    const std::optional<double> rate = parse_number(text);
    if (!rate || !(*rate >= 0.1 && *rate <= 1000.0))
      return input_error("--rate " + text + ": expected deg/s from 0.1 to 1000");
    task.rates_degps.push_back(*rate);
  }
  for (const Axis axis : all_axes) {
    if (!task.turns[index(axis)]) continue;
    const AxisLimits& limits = task.limits[axis];
    for (const double rate : task.rates_degps)
      if (rate > limits.max_rate_degps)
        return input_error("--rate " + format_number(rate) + ": expected at most " +
                           format_number(limits.max_rate_degps) + ", what the table's " + to_string(axis) +
                           " axis may do");
    if (task.acceleration_degps2 > limits.max_acceleration_degps2)
      return input_error("--acceleration " + format_number(task.acceleration_degps2) + ": expected at most " +
                         format_number(limits.max_acceleration_degps2) + ", what the table's " + to_string(axis) +
                         " axis may do");
  }
  for (const std::string& name : options.effects)
    if (std::ranges::none_of(task.effect_aims, [&](const PredictedEffect& e) { return e.column.entry->name == name; }))
      return input_error("--effects " + name + ": expected an effect of the catalogue (docs/effect-components.md)");
  return {};
}

// The file's name without its ending, in the letters that a sequence may have.
std::string name_of(const std::string& file) {
  std::string name = std::filesystem::path(file).stem().string();
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-' && c != '.') c = '_';
  return name.empty() ? "designed" : name;
}

Status design(const DesignOptions& options, CommandContext& context) {
  if (Status status = check_site(options.site); !status) return status;
  const Result<double> time_s = parse_time_s("--time", options.time);
  if (!time_s) return time_s.error();
  const Result<PlannedUnit> unit = planned_unit(options.site);
  if (!unit) return unit.error();
  const Result<Sequence> reference = parse_sequence(std::string(builtin_sequence_text), "fourteen_step.seq");
  if (!reference) return reference.error();
  const Result<Sequence> start = options.start.empty() ? *reference : read_sequence(options.start);
  if (!start) return start.error();

  DesignTask task;
  task.limits = plan_limits(unit->station, unit->info.sample_period_s);
  task.info = unit->info;
  task.predict.noise = noise_model(options.site);
  task.predict.unit = unit->parameters;
  task.predict.effects = !options.effects.empty();
  task.time_s = *time_s;
  task.acceleration_degps2 = options.acceleration_degps2;
  task.least_rest_s = options.least_rest_s;
  task.effects = options.effects;
  task.seed = static_cast<std::uint64_t>(options.seed);
  task.tries = options.tries;
  task.criterion = options.criterion == "worst" ? AimAt::worst : AimAt::mean;
  const auto predicted = [&](const Sequence& sequence) {
    const Plan plan = make_plan(sequence, task.limits);
    return NamedPrediction{sequence.name, predict(unit->info, planned_motion(sequence, plan), task.predict),
                           plan.station_s};
  };
  std::vector<NamedPrediction> columns{predicted(*reference)};
  task.aim = columns.front().prediction.sigma;
  for (int k = 0; k < parameter_count; ++k)
    if (const std::optional<double> most = unit->station.limits.sigma_max[static_cast<std::size_t>(k)])
      task.aim[k] = *most;
  task.effect_aims = columns.front().prediction.effects;
  task.start = walk_of(*start);
  if (Status status = choose(options, task); !status) return status;

  const double began_s = steady_wall_s();
  double told_s = began_s;
  const Result<Design> found = design_walk(task, [&](const DesignProgress& progress) {
    const double now_s = steady_wall_s();
    if (now_s - told_s < 5.0 && progress.done < progress.tries) return true;
    told_s = now_s;
    const double left_s = (now_s - began_s) / progress.done * (progress.tries - progress.done);
    char text[160];
    std::snprintf(text, sizeof text, "tried %d of %d  cost %.4f  %zu legs  %s left\n", progress.done, progress.tries,
                  progress.cost, progress.legs, format_duration(left_s).c_str());
    context.err << text << std::flush;
    return true;
  });
  if (!found) return found.error();

  WalkHeader header;
  header.name = name_of(options.out);
  header.comments = {"Found by turncal design for " + format_number(task.time_s) + " s: see docs/design.md."};
  header.rate_degps = task.rates_degps.front();
  header.acceleration_degps2 = task.acceleration_degps2;
  const std::string text = sequence_text(found->walk, header);
  const Result<Sequence> sequence = parse_sequence(text, options.out);
  if (!sequence) return Error{ErrorKind::internal, sequence.error().message};
  if (Status status = write_file_atomically(options.out, text); !status) return status;
  columns.push_back(predicted(*sequence));
  print_premises(options.site, unit->info, context.out);
  print_sigmas(columns, unit->info, context.out);
  print_undetermined(columns, context.out);
  if (task.predict.effects) print_effects(columns, context.out);
  context.out << "sequence    " << options.out << std::endl;
  return {};
}

}  // namespace

void add_design_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<DesignOptions>();
  const Command command = line.command("design", "find a sequence with small sigmas in a given time; nothing moves");
  command.option("--time", options->time, "length of the run: 40min, 2h, 2400").required();
  command.option("--out", options->out, "the sequence file to write").required();
  add_site_options(command, options->site);
  command.option("--start", options->start, "sequence whose turns the search begins with; default: the fourteen steps");
  command.option("--aim", options->criterion, "make the mean of all sigmas small, or the worst")
      .one_of({"mean", "worst"})
      .default_in_help();
  command.option("--effects", options->effects, "effects of the catalogue that it should show");
  command.option("--axes", options->axes, "axes that may turn: heading, pitch, roll; default: all");
  command.option("--rate", options->rates, "rates to choose from, deg/s; default: 10");
  command.option("--acceleration", options->acceleration_degps2, "deg/s^2").positive().default_in_help();
  command.option("--least-rest", options->least_rest_s, "of a rest, s").range(2.0, 3600.0).default_in_help();
  command.option("--seed", options->seed, "of the search").range(0, 1000000000).default_in_help();
  command.option("--tries", options->tries, "walks to judge").range(1, 1000000).default_in_help();
  command.runs(context, [options, &context] { return design(*options, context); });
}

}  // namespace turncal
