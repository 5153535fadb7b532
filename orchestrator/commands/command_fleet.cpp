// `turncal fleet diagnose FROM`: what many units show together (calib/fleet/fleet_diagnosis.h). Exit code 20 where something is common to units
// that no unit shows by itself, or is left unexplained.
#include <algorithm>
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/data_text.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/fleet/fleet_document.h"
#include "orchestrator/fleet/fleet_members.h"

namespace turncal {
namespace {

struct FleetCommandOptions {
  std::string action, from, format, page;
  std::vector<std::string> by = {"station"};
};

Status diagnose(const FleetCommandOptions& options, CommandContext& context) {
  for (std::size_t k = 0; k < options.by.size(); ++k)
    if (std::find(options.by.begin(), options.by.begin() + static_cast<std::ptrdiff_t>(k), options.by[k]) !=
        options.by.begin() + static_cast<std::ptrdiff_t>(k))
      return input_error("--by " + options.by[k] + ": is given twice");
  const FleetSource source = TRY(read_fleet(options.from, options.by));
  FleetOptions wanted;
  wanted.factors = options.by;
  wanted.summary = !options.page.empty();
  const FleetDiagnosis diagnosis = diagnose_fleet(source.members, wanted);
  const Document document = fleet_document(diagnosis, source, options.by);
  if (!options.page.empty()) {
    TRY(check_replaceable(options.page, "<!DOCTYPE html>"));
    TRY(write_file_atomically(options.page, as_page(document).html));
  }
  if (!options.format.empty()) {
    context.out << table_of(diagnosis, source).as(options.format);
  } else {
    context.out << as_text(document);
    if (!options.page.empty()) context.out << "page  " << options.page << '\n';
  }
  if (!diagnosis.effects.empty() || !diagnosis.explained())
    return Error{ErrorKind::unit_failed, options.from + ": the fleet has what its units do not show by themselves"};
  return {};
}

}  // namespace

void add_fleet_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<FleetCommandOptions>();
  const Command command = line.command("fleet", "what many units show together: common to a station, a lot, a month");
  command.option("action", options->action, "diagnose").required().one_of({"diagnose"});
  command
      .option("from", options->from,
              "a results database, a store of `turncal recalibrate`, or a folder with runs below it")
      .required();
  command.option("--by", options->by, "what units may have in common; several times")
      .one_of(fleet_factors)
      .one_word_each()
      .default_in_help();
  command.option("--page", options->page, "write a page (HTML)");
  command.option("--format", options->format, "print a table for other programs").one_of(data_formats);
  command.runs(context, [options, &context] { return diagnose(*options, context); });
}

}  // namespace turncal
