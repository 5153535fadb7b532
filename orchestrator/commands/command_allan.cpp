// `turncal allan RECORDING [--against FILE] [--out DIR]`: the noise of a unit at rest (docs/allan.md), of a recording without segments, of the
// rests of a run, or with --map of any table of numbers. Writes DIR/allan.html, allan.svg, allan.csv and imu.yaml.
#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/jobs/allan_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/allan_report.h"

namespace turncal {

namespace {

struct AllanOptions {
  AllanRequest from;
  std::string out, format;
};

// An earlier result in the folder is replaced, whole.
Status write_result(const std::string& out, const AllanReport& report, const Document& document,
                    CommandContext& context) {
  OutputFolder folder = TRY(OutputFolder::prepare(out, {}));
  const HtmlPage page = as_page(document);
  std::vector<NamedText> files = {{folder.file("allan.html"), page.html},
                                  {folder.file("allan.csv"), format_allan_points(report.result)},
                                  {folder.file("imu.yaml"), format_imu_yaml(report.result, report.sample_s)}};
  Figure figure = allan_figure(report.result, report.other ? &*report.other : nullptr);
  for (Panel& panel : figure.panels) panel.legend = true;
  const Result<std::string> drawn = standalone_svg(figure);
  if (drawn) files.push_back({folder.file("allan.svg"), *drawn});
  TRY(write_files_atomically(files));
  folder.keep();
  if (!page.plot_problem.empty()) context.warn("report without plots: " + page.plot_problem);
  return {};
}

Status allan(const AllanOptions& options, CommandContext& context) {
  if (!options.out.empty()) TRY(check_not_source(options.out, options.from.source));
  const AllanReport report = TRY(allan_report(options.from));
  const Document document = allan_document(report);
  if (!options.out.empty()) TRY(write_result(options.out, report, document, context));
  context.out << as(options.format, document) << std::flush;
  return {};
}

}  // namespace

void add_allan_command(CommandLine& line) {
  const auto [command, options] = line.command<AllanOptions>(
      "allan", "report the noise of a unit at rest: Allan deviation and its coefficients", allan);
  command
      .option("source", options.from.source, "recording: a folder or a .tcr file; with --map a CSV, .npy or .mat file")
      .required();
  command.option("--map", options.from.map, "file that describes the columns (docs/import.md)");
  command.option("--against", options.from.against, "second source, or a parameter file (.conf), to compare with");
  command.option("--out", options.out, "folder for allan.html, allan.svg, allan.csv, imu.yaml");
  command.format(options.format, "print the result in this form instead of text");
}

}  // namespace turncal
