// `turncal certificate RUN... --station FILE --out HTML [--pdf FILE] [--specimen]`: the paper that goes to the customer (docs/certificate.md).
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/certificate_job.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/report/report_page.h"

namespace turncal {

namespace {

struct CertificateOptions {
  CertificateRequest request;
  std::string html;
  std::string pdf;
};

Status certify(const CertificateOptions& options, CommandContext& context) {
  if (Status s = check_apart({{"--station", options.request.station}, {"--out", options.html}, {"--pdf", options.pdf}});
      !s)
    return s;
  const Result<std::string> page = make_certificate(options.request);
  if (!page) return page.error();
  constexpr std::size_t alike = 100;
  if (Status s = check_replaceable(options.html, std::string_view(*page).substr(0, alike)); !s) return s;
  if (!options.pdf.empty()) {
    if (Status s = check_replaceable(options.pdf, "%PDF-"); !s) return s;
    if (Status s = write_pdf(*page, options.pdf); !s) return s;
  }
  if (Status s = write_file_atomically(options.html, *page); !s) return s;
  context.out << "certificate  " << options.html << '\n';
  if (!options.pdf.empty()) context.out << "pdf          " << options.pdf << '\n';
  return {};
}

}  // namespace

void add_certificate_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<CertificateOptions>();
  CertificateRequest& request = options->request;
  const Command command = line.command("certificate", "the calibration certificate of a unit, for its customer");
  command.option("run", request.runs, "folders of runs of one unit, oldest first; the last one is certified")
      .required();
  command.option("--station", request.station, "station configuration, with laboratory.* and customer.*").required();
  command.option("--out", options->html, "HTML file to write").required();
  command.option("--pdf", options->pdf, "PDF file to write, by weasyprint");
  command.flag("--specimen", request.specimen, "a specimen with a watermark, also of simulated and untrusted results");
  command.runs(context, [options, &context] { return certify(*options, context); });
}

}  // namespace turncal
