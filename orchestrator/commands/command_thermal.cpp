// `turncal thermal LEG... --out DIR`: parameters as functions of temperature, from calibrations of one unit at several (docs/thermal.md):
// DIR/parameters.conf, DIR/thermal.conf and DIR/thermal.html. `turncal campaign FILE --out DIR` makes those calibrations first (campaign_job.h).
#include "imu_io/base/clock.h"
#include "imu_io/base/console.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/campaign_job.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct ThermalCommandOptions {
  std::vector<std::string> legs, temperatures;
  std::string out, format;
  std::optional<double> reference_c;
};

Status write_thermal(const ThermalOutput& output, const std::string& out, const std::string& format,
                     std::ostream& terminal) {
  OutputFolder folder = TRY(OutputFolder::prepare_results(out, output.file.unit_serial));
  const std::string conf = format_thermal(output.report);
  const std::string parameters = TRY(format_parameter_file(output.file));
  const Document document = thermal_document(output.report);
  const HtmlPage page = as_page(document);
  TRY(write_files_atomically({{folder.file(thermal_name), conf},
                              {folder.file(thermal_page_name), page.html},
                              {folder.file(parameters_name), parameters}}));
  folder.keep();
  if (!format.empty()) {
    terminal << key_values_as(format, conf) << std::flush;
    return {};
  }
  terminal << as_text(document);
  if (!page.plot_problem.empty()) terminal << "page without plots: " << page.plot_problem << '\n';
  terminal << "\nparameters  " << folder.file(parameters_name) << "\nthermal     " << folder.file(thermal_name)
           << "\npage        " << folder.file(thermal_page_name) << std::endl;
  return {};
}

Status thermal(const ThermalCommandOptions& options, CommandContext& context) {
  for (const std::string& leg : options.legs) TRY(check_not_source(options.out, leg));
  Phases phases(context, !options.format.empty());
  ThermalRequest request{options.legs, options.temperatures, options.reference_c, format_utc(wall_utc_s())};
  request.phase = [&phases](const std::string& what) { phases.begin(what); };
  const ThermalOutput output = TRY(thermal_calibration(request));
  phases.clear();
  return write_thermal(output, options.out, options.format, context.out);
}

struct CampaignOptions {
  std::string file, out, format;
  bool plan = false;
  RunRequest request;
};

Status campaign(const CampaignOptions& options, CommandContext& context) {
  if (options.request.dry_run) context.tag = dry_run_tag;
  const Campaign campaign = TRY(read_campaign(options.file));
  if (options.plan) {
    context.out << as(options.format, TRY(plan_campaign(campaign))) << std::flush;
    return {};
  }
  if (options.out.empty()) return input_error("--out is required: the folder for the legs and the results (or --plan)");
  const ThermalOutput output = TRY(run_campaign(campaign, options.request, options.out, context));
  const LinePrefix marked(context.out, context.tag);
  return write_thermal(output, options.out, options.format, context.out);
}

}  // namespace

void add_thermal_command(CommandLine& line) {
  const auto [command, options] = line.command<ThermalCommandOptions>(
      "thermal", "parameters as functions of temperature, from calibrations at several temperatures", thermal);
  command
      .option("leg", options.legs,
              "a recording, a parameter file, or the folder of a run or calibration; of one unit, two temperatures at "
              "least")
      .required();
  command.option("--out", options.out, "folder for parameters.conf, thermal.conf and thermal.html").required();
  command
      .option("--temperature", options.temperatures,
              "LEG=VALUE, degrees C, for a leg without a thermometer; repeat it for more")
      .one_word_each();
  command.option("--reference", options.reference_c,
                 "temperature of the 24 parameters, degrees C; default: the middle of the range");
  command.format(options.format, "print thermal.conf in this form instead of text");
}

void add_campaign_command(CommandLine& line) {
  const auto [command, options] = line.command<CampaignOptions>(
      "campaign", "calibrate a unit at several temperatures, unattended, and over temperature", campaign);
  RunRequest& request = options.request;
  command.option("file", options.file, "campaign: unit, station, temperatures, sequences (docs/thermal.md)").required();
  command.option("--out", options.out, "folder for the legs and the results; the same folder continues what is there");
  command.flag("--plan", options.plan, "print the legs, their times and the expected sigmas; nothing moves");
  command.flag("--dry-run", request.dry_run, "simulate table, unit and chamber, in virtual time");
  command.flag("--no-diagnosis", request.no_diagnosis, "skip the diagnosis of each leg");
  add_record_options(command, request);
  add_watch_options(command, request);
  command.format(options.format, "print the plan, or thermal.conf, in this form");
}

}  // namespace turncal
