#include "orchestrator/report/report_tables.h"

#include <algorithm>
#include <cmath>

#include "orchestrator/figures/diagnosis_figures.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/report/diagnosis_text.h"
#include "orchestrator/report/html_table.h"

namespace turncal {

using namespace html;

namespace {

// A number and its percent sign stay on one line.
std::string unbroken_percent(std::string html) {
  for (std::size_t at = html.find(" %"); at != std::string::npos; at = html.find(" %", at))
    html.replace(at, 1, "&nbsp;");
  return html;
}

}  // namespace

std::string html_identity(const DiagnosisContext& context) {
  const CompressedRecording& r = context.recording;
  std::string html = "<h1>Calibration diagnosis, unit " + html_escape(r.info.unit_serial) + "</h1>\n";
  double still_s = 0.0;
  double low = 1e300;
  double high = -1e300;
  for (const Block& block : r.blocks) {
    if (block.whole_second) still_s += block.duration_s;
    if (!std::isnan(block.temperature_c)) {
      low = std::min(low, static_cast<double>(block.temperature_c));
      high = std::max(high, static_cast<double>(block.temperature_c));
    }
  }
  std::string line = "Recording " + context.recording_path;
  if (!context.recording_hash.empty()) line += " (content " + context.recording_hash + ")";
  line += ": " + std::to_string(r.samples) + " samples, " +
          clock_time(static_cast<double>(r.samples) * r.info.sample_period_s) + " h, of which " + clock_time(still_s) +
          " at rest; latitude " + significant(r.info.latitude_deg, 6) + "°, gravity " +
          significant(r.info.gravity_mps2, 7) + " m/s²";
  if (low <= high) line += "; " + significant(low, 3) + " to " + significant(high, 3) + " °C";
  html += paragraph(line + ".", "soft");
  html += paragraph("Held-out data: " +
                        (!context.holdout_path.empty() ? context.holdout_path
                         : context.hand_turned         ? "rests and rotations of the same recording, left out in turn"
                                                       : "dwells of the same recording, left out in turn") +
                        ".",
                    "soft");
  if (r.info.simulated) html += "<p><b>Simulated data: these are not the parameters of a real unit.</b></p>\n";
  for (const std::string& note : context.notes) html += paragraph("Note: " + note + ".", "soft");
  return html;
}

std::string html_verdict(const Diagnosis& diagnosis, const std::string& sentence, const std::string& reason) {
  const std::size_t colon = sentence.find(':');
  return "<div class=\"verdict " + std::string(to_string(diagnosis.verdict)) + "\"><p><b>" +
         html_escape(sentence.substr(0, colon + 1)) + "</b>" +
         unbroken_percent(html_escape(sentence.substr(colon + 1))) + "</p></div>\n" +
         (reason.empty() ? "" : paragraph("Reason: " + reason + ".", "soft"));
}

std::string html_errors(const Diagnosis& diagnosis, const std::vector<ErrorRow>& rows) {
  const bool both = has_after(diagnosis);
  std::vector<Cell> head = {text(""), number(both ? "before" : "value")};
  if (both) {
    head.push_back(number("after"));
    head.push_back(number("change"));
  }
  head.insert(head.begin() + 1, text(""));
  HtmlTable table(head);
  for (const ErrorRow& row : rows) {
    const Cell unit = {"<span class=\"soft\">" +
                           html_escape(row.normalised && row.unit.empty() ? "1 is what the noise explains"
                                                                          : unit_text(row.unit, typo)) +
                           "</span>",
                       ""};
    std::vector<Cell> cells = {text(row.what), unit};
    const auto value = [&](double v) {
      return Cell{"<span class=\"big\">" + html_escape(error_text(row, v)) + "</span>", "n"};
    };
    cells.push_back(value(row.before));
    if (both) {
      cells.push_back(value(row.after));
      cells.push_back(number(percent_change(row.before, row.after)));
    }
    table.row(cells);
  }
  std::string html = table.finish();
  html += paragraph(
      "Held-out source: " + (diagnosis.holdout_source.empty() ? "none" : diagnosis.holdout_source) +
          (both ? ". Before: the 24 parameters alone; after: with the effects added; the noise is the same in both."
                : ". The model is that of the 24 parameters."),
      "soft");
  if (diagnosis.verdict == Verdict::unexplained && diagnosis.extended.noise_fit)
    html += paragraph(
        "The noise was measured on the same data and may have taken up a part of the residual: a normalised residual "
        "near 1 "
        "does not clear it.",
        "soft");
  return html;
}

std::string html_faults(const Diagnosis& diagnosis, const DiagnosisContext& context) {
  constexpr std::size_t most = 40;
  const std::vector<Fault>& faults = diagnosis.base.faults;
  if (faults.empty()) return paragraph("None found: no lost sample, no glitch, no second that noise cannot explain.");
  HtmlTable table({number("samples"), number("time, s"), text("what"), text("what was done")});
  const std::int64_t start = context.recording.blocks.empty() ? 0 : context.recording.blocks.front().start_sample;
  for (std::size_t k = 0; k < std::min(most, faults.size()); ++k) {
    const Fault& f = faults[k];
    table.row(
        {number(std::to_string(f.first_sample) +
                (f.last_sample > f.first_sample ? " to " + std::to_string(f.last_sample) : "")),
         number(significant(static_cast<double>(f.first_sample - start) * context.recording.info.sample_period_s, 5)),
         long_text(f.what), long_text(f.action)});
  }
  return table.finish() +
         (faults.size() > most ? paragraph("And " + std::to_string(faults.size() - most) + " more.") : std::string());
}

}  // namespace turncal
