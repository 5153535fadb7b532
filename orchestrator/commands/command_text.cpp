#include "orchestrator/commands/command_text.h"

#include <memory>

#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/command_segment.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct TextOptions {
  std::string source;
  std::string out;
  std::string map;  // import: of a CSV that is not ours
};

Status finish(RecordingSource& source, OutputFolder& folder, const char* what, CommandContext& context) {
  const Result<std::string> hash = source.content_hash();
  if (!hash) return hash.error();
  folder.keep();
  if (const std::string damage = describe(source.damage()); !damage.empty()) context.out << damage << '\n';
  context.out << what << ' ' << folder.path() << ": " << source.segments().size() << " segments, content " << *hash
              << std::endl;
  return {};
}

Status import_text(const TextOptions& options, CommandContext& context) {
  if (!options.map.empty()) return import_mapped_csv(options.map, options.source, options.out, context);
  Result<std::unique_ptr<RecordingSource>> source = open_text_recording(options.source);
  if (!source) return source.error();
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {binary_recording_name});
  if (!folder) return folder.error();
  if (Status status = import_binary(**source, folder->file(binary_recording_name)); !status) return status;
  return finish(**source, *folder, "imported into", context);
}

Status export_recording(const TextOptions& options, CommandContext& context) {
  Result<std::unique_ptr<RecordingSource>> source = RecordingSource::open(options.source);
  if (!source) return source.error();
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {"recording.conf", "imu.csv", "segments.csv"});
  if (!folder) return folder.error();
  if (Status status = export_text(**source, folder->path()); !status) return status;
  return finish(**source, *folder, "exported to", context);
}

std::shared_ptr<TextOptions> add(CLI::App& app, CommandContext& context, const char* name, const char* help,
                                 const char* source_help, Status (*command)(const TextOptions&, CommandContext&)) {
  const auto options = std::make_shared<TextOptions>();
  CLI::App* sub = app.add_subcommand(name, help);
  sub->add_option("source", options->source, source_help)->required();
  sub->add_option("--out", options->out, "folder to write to; must not hold a recording yet")->required();
  sub->callback([options, command, &context] {
    if (Status status = command(*options, context); !status) context.fail(status.error());
  });
  return options;
}

}  // namespace

void add_import_command(CLI::App& app, CommandContext& context) {
  const auto options = add(app, context, "import", "read the text form of a recording or any CSV, write the binary one",
                           "folder with recording.conf, imu.csv, segments.csv; with --map a CSV file", import_text);
  app.get_subcommand("import")->add_option("--map", options->map, "file on the columns of the CSV, docs/hand-data.md");
}

void add_export_command(CLI::App& app, CommandContext& context) {
  add(app, context, "export", "write a recording in text form", "recording: a folder or a .tcr file", export_recording);
}

}  // namespace turncal
