// `turncal certificate RUN... --station FILE --out HTML [--pdf FILE] [--specimen]`: the paper that goes to the customer (docs/certificate.md);
// `--check HTML`: whether one is as it was issued.
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/certificate_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/certificate.h"
#include "orchestrator/report/pdf.h"

namespace turncal {

namespace {

struct CertificateOptions {
  CertificateRequest request;
  std::string html;
  std::string pdf;
  std::string check;
};

Status check(const std::string& path, CommandContext& context) {
  std::string page = TRY(read_whole_file(path));
  const std::string hash = TRY(check_certificate(std::move(page), path));
  context.out << path << ": as it was issued, hash " << hash << '\n';
  return {};
}

Status certify(const CertificateOptions& options, CommandContext& context) {
  const CertificateRequest& request = options.request;
  if (!options.check.empty()) {
    if (!request.runs.empty() || !request.station.empty() || !options.html.empty() || !options.pdf.empty())
      return input_error("--check: expected nothing beside it: it reads a certificate that was issued");
    return check(options.check, context);
  }
  if (request.runs.empty() || request.station.empty() || options.html.empty())
    return input_error("expected the folder of a run, --station and --out; or --check alone");
  if (Status s = check_apart({{"--station", options.request.station}, {"--out", options.html}, {"--pdf", options.pdf}});
      !s)
    return s;
  const std::string page = TRY(make_certificate(options.request));
  constexpr std::size_t alike = 100;
  TRY(check_replaceable(options.html, std::string_view(page).substr(0, alike)));
  if (!options.pdf.empty()) {
    TRY(check_replaceable(options.pdf, "%PDF-"));
    const std::string warning = TRY(write_pdf(page, options.pdf));
    if (!warning.empty()) context.out << options.pdf << ": " << warning << '\n';
  }
  TRY(write_file_atomically(options.html, page));
  context.out << "certificate  " << options.html << '\n';
  if (!options.pdf.empty()) context.out << "pdf          " << options.pdf << '\n';
  return {};
}

}  // namespace

void add_certificate_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<CertificateOptions>();
  CertificateRequest& request = options->request;
  const Command command = line.command("certificate", "the calibration certificate of a unit, for its customer");
  command.option("run", request.runs, "folders of runs of one unit, oldest first; the last one is certified");
  command.option("--station", request.station, "station configuration, with laboratory.* and customer.*");
  command.option("--out", options->html, "HTML file to write");
  command.option("--check", options->check, "HTML file that was issued: whether it is as it was");
  command.option("--pdf", options->pdf, "PDF file to write, by weasyprint");
  command.flag("--specimen", request.specimen, "a specimen with a watermark, also of simulated and untrusted results");
  command.runs(context, [options, &context] { return certify(*options, context); });
}

}  // namespace turncal
