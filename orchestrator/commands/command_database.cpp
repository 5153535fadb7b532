// `turncal database check|backup|copy|roles DB`: whether the results database is whole; a copy of it while others write; its rows, once each,
// in another one; the roles of a server.
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/records/database_schema.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/database_name.h"

namespace turncal {

namespace {

struct DatabaseOptions {
  std::string action, database, other, out;
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
  TRY(check_replaceable(options.out, "SQLite format 3"));
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  const std::string image = TRY(database.image());
  // What is kept is what was checked.
  const ResultsDatabase copy = TRY(ResultsDatabase::of_image(image, options.database));
  TRY(copy.check());
  TRY(write_file_atomically(options.out, image));
  out << "backup of " << contents_of(database) << " in " << options.out << '\n';
  return {};
}

Status copy_rows(const DatabaseOptions& options, std::ostream& out) {
  if (options.other.empty())
    return input_error("database copy: expected a second database, which the rows are added to");
  if (Status s = check_apart({{"database", options.database}, {"other", options.other}}); !s) return s;
  const ResultsDatabase from = TRY(ResultsDatabase::open_to_read(options.database));
  ResultsDatabase to = TRY(ResultsDatabase::open(options.other));
  const CopiedRows copied = TRY(from.copy_to(to));
  out << options.other << ": " << copied.calibrations << " calibrations and " << copied.attempts
      << " notes of attempts are new\n";
  return {};
}

Status make_roles(const DatabaseOptions& options, std::ostream& out) {
  if (!names_a_server(options.database))
    return input_error(options.database + ": a file has no roles: expected postgresql://USER@HOST/NAME");
  ResultsDatabase database = TRY(ResultsDatabase::open(options.database));
  TRY(database.make_roles());
  out << options.database << ": turncal_station adds and reads, turncal_reader reads\n";
  return {};
}

Status run_database(const DatabaseOptions& options, std::ostream& out) {
  if (options.action == "backup") return backup(options, out);
  if (!options.out.empty()) return input_error("--out " + options.out + ": expected with backup only");
  if (options.action == "copy") return copy_rows(options, out);
  if (!options.other.empty()) return input_error(options.other + ": expected a second database with copy only");
  if (options.action == "roles") return make_roles(options, out);
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  TRY(database.check());
  out << options.database << ": whole, " << contents_of(database) << '\n';
  return {};
}

}  // namespace

void add_database_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<DatabaseOptions>();
  const Command command =
      line.command("database", "check, back up or copy a results database; make the roles of a server");
  command.option("action", options->action, "check, backup, copy or roles")
      .required()
      .one_of({"check", "backup", "copy", "roles"});
  command.option("database", options->database, "the station's record.database: a file, or postgresql://USER@HOST/NAME")
      .required();
  command.option("other", options->other, "for copy: the database that the rows are added to, each once");
  command.option("--out", options->out, "file for the backup");
  command.prints(context, [options, &context] { return run_database(*options, context.out); });
}

}  // namespace turncal
