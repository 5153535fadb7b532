// `turncal import TEXTDIR --out DIR` and `turncal export RECORDING --out DIR`: between the text form of a recording and the
// binary one; `--out FILE.npy` or `.mat` of export: its samples as a matrix. Nothing is overwritten, and a failure leaves nothing behind.
#include <filesystem>
#include <memory>

#include "imu_io/recordings/matrix_writer.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/command_segment.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct TextOptions {
  std::string source;
  std::string out;
  // import of a table that is not ours
  std::string map;
  std::string accel;
  bool skip_bad_rows = false;
};

Status say(RecordingSource& source, const char* what, const std::string& out, CommandContext& context) {
  const std::string hash = TRY(source.content_hash());
  if (const std::string damage = describe(source.damage()); !damage.empty()) context.out << damage << '\n';
  context.out << what << ' ' << out << ": " << source.segments().size() << " segments, content " << hash << std::endl;
  return {};
}

Status finish(RecordingSource& source, OutputFolder& folder, const char* what, CommandContext& context) {
  if (const Result<std::string> hash = source.content_hash(); !hash) return hash.error();
  folder.keep();
  return say(source, what, folder.path(), context);
}

Status import_text(const TextOptions& options, CommandContext& context) {
  if (!options.map.empty())
    return import_mapped_csv({options.map, options.source, options.accel, options.skip_bad_rows}, options.out, context);
  if (options.skip_bad_rows)
    return input_error("--skip-bad-rows: expected --map; a recording in our own text form is whole or is refused");
  std::unique_ptr<RecordingSource> source = TRY(open_text_recording(options.source));
  TRY(check_not_source(options.out, options.source));
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {binary_recording_name});
  if (!folder) return folder.error();
  TRY(import_binary(*source, folder->file(binary_recording_name)));
  return finish(*source, *folder, "imported into", context);
}

Status export_recording(const TextOptions& options, CommandContext& context) {
  std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(options.source));
  TRY(check_not_source(options.out, options.source));
  // A folder has no ending that says "file".
  if (const std::string ending = std::filesystem::path(options.out).extension().string();
      ending == ".csv" || ending == ".tcr" || ending == ".NPY" || ending == ".MAT")
    return input_error(options.out + ": expected a folder (its text form), or a file that ends in .npy or .mat");
  if (names_matrix(options.out)) {
    std::error_code none;
    if (std::filesystem::is_directory(options.out, none))
      return input_error(options.out + ": expected a file name, found a folder");
    TRY(write_recording_columns(*source, options.out));
    return say(*source, "exported to", options.out, context);
  }
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {"recording.conf", "imu.csv", "segments.csv"});
  if (!folder) return folder.error();
  TRY(export_text(*source, folder->path()));
  return finish(*source, *folder, "exported to", context);
}

// What both commands take.
Command add(CommandLine& line, CommandContext& context, const char* name, const char* help, const char* source_help,
            const char* help_out, const std::shared_ptr<TextOptions>& options,
            Status (*job)(const TextOptions&, CommandContext&)) {
  const Command command = line.command(name, help);
  command.option("source", options->source, source_help).required();
  command.option("--out", options->out, help_out).required();
  command.runs(context, [options, job, &context] { return job(*options, context); });
  return command;
}

}  // namespace

void add_import_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<TextOptions>();
  const Command command =
      add(line, context, "import", "read the text form of a recording or any table of numbers, write the binary one",
          "folder with recording.conf, imu.csv, segments.csv; with --map a CSV, .npy or .mat file",
          "folder to write to; must not hold a recording yet", options, import_text);
  const Option map = command.option("--map", options->map, "file on the columns of the table, docs/hand-data.md");
  command.option("--accel", options->accel, "the accelerometers' file, where they have one of their own").needs(map);
  command.flag("--skip-bad-rows", options->skip_bad_rows, "leave out rows with a defect, and count them");
}

void add_export_command(CommandLine& line, CommandContext& context) {
  add(line, context, "export", "write a recording in text form, or its samples as .npy or .mat",
      "recording: a folder or a .tcr file", "folder to write to, must not hold a recording yet; or a .npy or .mat file",
      std::make_shared<TextOptions>(), export_recording);
}

}  // namespace turncal
