// `turncal navigate RECORDING --parameters FILE [--against FILE] --out DIR`: free inertial navigation with calibrated increments, and
// what it is off by. Writes DIR/navigation.conf, DIR/track.csv (and DIR/track_against.csv) and DIR/navigation.svg.
#include <algorithm>
#include <filesystem>
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/navigation/navigation_job.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

constexpr double longest_recording_s = 1e7;

struct NavigateOptions {
  NavigationRequest request;
  std::string out, format;
};

Status navigate(const NavigateOptions& options, CommandContext& context) {
  TRY(check_not_source(options.out, options.request.recording));
  // An earlier result in the folder is replaced, whole.
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {});
  if (!folder) return folder.error();
  const NavigationReport report = TRY(navigate_recording(options.request));
  const std::string conf = folder->file("navigation.conf");
  std::vector<NamedText> files = {{conf, format_navigation(report)}};
  const Result<std::string> drawing = draw_navigation(report);
  if (drawing) files.push_back({folder->file("navigation.svg"), *drawing});
  for (const NavigatedFile& file : report.files) {
    const std::string name = file.prefix.empty() ? "track.csv" : "track_against.csv";
    files.push_back({folder->file(name), format_track(report, file)});
  }
  TRY(write_files_atomically(files));
  for (const char* name : {"navigation.svg", "track_against.csv"}) {
    const std::string old = folder->file(name);
    const auto is_it = [&](const NamedText& file) { return file.path == old; };
    std::error_code none;
    if (std::find_if(files.begin(), files.end(), is_it) == files.end()) std::filesystem::remove(old, none);
  }
  folder->keep();
  if (!options.format.empty()) {
    context.out << key_values_as(options.format, files.front().content) << std::flush;
    return {};
  }
  context.out << as_text(navigation_document(report));
  if (!drawing) context.out << drawing.error().message << '\n';
  context.out << "navigation  " << conf << std::endl;
  return {};
}

}  // namespace

void add_navigate_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<NavigateOptions>();
  NavigationRequest& request = options->request;
  const Command command = line.command("navigate", "free inertial navigation of a recording: what it drifts");
  command.option("recording", request.recording, "a folder (binary or text form) or a .tcr file").required();
  command.option("--parameters", request.parameters, "parameter file; left out where `turncal apply` has been at work");
  command.option("--against", request.against, "another parameter file, navigated beside it");
  command.option("--reference", request.reference,
                 "where the unit truly was: a table of time_s, latitude_deg, longitude_deg (docs/navigation.md)");
  command.option("--out", options->out, "folder for navigation.conf, track.csv, navigation.svg").required();
  command.option("--align", request.align_s, "length of the alignment, s").range(20.0, 86400.0).default_in_help();
  command.option("--from", request.from_s, "where to begin, s from the first sample")
      .range(0.0, longest_recording_s)
      .default_in_help();
  command.option("--to", request.to_s, "where to end, s; default: the end of the recording")
      .range(0.0, longest_recording_s);
  command.option("--for", request.free_s, "length of each free navigation, s; default: an hour, or what there is")
      .range(1.0, longest_recording_s);
  command.option("--branches", request.branches, "starts, spread over the recording").range(1, 1000).default_in_help();
  command.option("--format", options->format, "print navigation.conf in this form instead of words")
      .one_of(data_formats);
  command.runs(context, [options, &context] { return navigate(*options, context); });
}

}  // namespace turncal
