// `turncal shift DB`: yield, reasons, hours, control charts, stations and repeatability of a shift, a week or a month.
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/line_report/history_document.h"
#include "orchestrator/line_report/shift_document.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/pdf.h"

namespace turncal {

namespace {

struct ShiftOptions {
  std::string database, out, format;
  RecordFilter filter;
  bool simulated = false, pdf = false;
};

// An earlier report in the folder is replaced, and nothing else.
Status write_shift(const ShiftOptions& options, const ShiftReport& report, const Document& document) {
  TRY(make_folder(options.out));
  const LockFile held = TRY(hold_folder(options.out));
  const std::string page = as_page(document).html;
  const std::vector<NamedText> files = {{options.out + "/shift.html", page},
                                        {options.out + "/shift.csv", shift_csv(report)},
                                        {options.out + "/signals.csv", signals_csv(report)},
                                        {options.out + "/attempts.csv", attempts_table(report.attempts).csv()}};
  constexpr std::size_t alike = 30;
  for (const NamedText& file : files) {
    TRY(check_replaceable(file.path, std::string_view(file.content).substr(0, alike)));
  }
  const std::string pdf = options.out + "/shift.pdf";
  if (options.pdf) {
    TRY(check_replaceable(pdf, "%PDF-"));
    if (const Result<std::string> warning = write_pdf(page, pdf); !warning) return warning.error();
  }
  return write_files_atomically(files);
}

Status run_shift(const ShiftOptions& options, std::ostream& out) {
  if (options.pdf && options.out.empty()) return input_error("--pdf: expected --out DIR, where it is to go");
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(options.database));
  const ShiftReport report = TRY(shift_report(database, options.database, options.filter, options.simulated));
  const Document document = shift_document(report);
  out << (options.format.empty() ? as_text(document) : as_json(document));
  if (options.out.empty()) return {};
  TRY(write_shift(options, report, document));
  if (options.format.empty())
    out << "\nreport   " << options.out << "/shift.html"
        << (options.pdf ? "\npdf      " + options.out + "/shift.pdf" : "") << '\n';
  return {};
}

}  // namespace

void add_shift_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<ShiftOptions>();
  const Command command =
      line.command("shift", "the report of a shift: yield, reasons, hours, control charts, stations");
  command.option("database", options->database, "the station's record.database").required();
  add_filter_options(command, options->filter);
  command.flag("--simulated", options->simulated, "of the dry runs, which are in no report with real units");
  command.option("--out", options->out, "folder for the report: shift.html and its tables as CSV");
  command.option("--format", options->format, "print the report in this form instead of words").one_of({"json"});
  command.flag("--pdf", options->pdf, "with --out: shift.pdf too, by weasyprint");
  command.runs(context, [options, &context] { return run_shift(*options, context.out); });
}

}  // namespace turncal
