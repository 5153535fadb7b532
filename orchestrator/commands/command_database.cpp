// `turncal database check|backup DB`: whether the results database is whole, and a copy of it while others write.
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/records/database_schema.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/results_database.h"

namespace turncal {

namespace {

struct DatabaseOptions {
  std::string action, database, out;
};

std::string contents_of(const ResultsDatabase& database) {
  const auto attempts = database.attempts({});
  const auto calibrations = database.list({}, "N01");
  if (!attempts || !calibrations) return "";
  const int version = database.stored_version();
  return std::to_string(attempts->size()) + " attempts, " + std::to_string(calibrations->size()) +
         " calibrations, schema " + std::to_string(version) +
         (version < database_version ? " (the next run makes " + std::to_string(database_version) + " of it)" : "");
}

Status backup(const DatabaseOptions& options, std::ostream& out) {
  if (options.out.empty()) return input_error("database backup: expected --out FILE, where the copy is to go");
  if (Status s = check_apart({{"database", options.database}, {"--out", options.out}}); !s) return s;
  if (Status s = check_replaceable(options.out, "SQLite format 3"); !s) return s;
  const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(options.database);
  if (!database) return database.error();
  const Result<std::string> image = database->image();
  if (!image) return image.error();
  // What is kept is what was checked.
  const Result<ResultsDatabase> copy = ResultsDatabase::of_image(*image, options.database);
  if (!copy) return copy.error();
  if (Status status = copy->check(); !status) return status;
  if (Status status = write_file_atomically(options.out, *image); !status) return status;
  out << "backup of " << contents_of(*database) << " in " << options.out << '\n';
  return {};
}

Status run_database(const DatabaseOptions& options, std::ostream& out) {
  if (options.action == "backup") return backup(options, out);
  if (!options.out.empty()) return input_error("--out " + options.out + ": expected with backup only");
  const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(options.database);
  if (!database) return database.error();
  if (Status status = database->check(); !status) return status;
  out << options.database << ": whole, " << contents_of(*database) << '\n';
  return {};
}

}  // namespace

void add_database_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<DatabaseOptions>();
  const Command command = line.command("database", "check a results database, or make a backup of it while runs go on");
  command.option("action", options->action, "check or backup").required().one_of({"check", "backup"});
  command.option("database", options->database, "the station's record.database").required();
  command.option("--out", options->out, "file for the backup");
  command.runs(context, [options, &context] { return run_database(*options, context.out); });
}

}  // namespace turncal
