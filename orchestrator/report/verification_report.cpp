#include "orchestrator/report/verification_report.h"

#include <cstdarg>
#include <cstdio>
#include <utility>

#include "calib/model/parameters.h"
#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

void add_key(const std::string& key, const std::string& value, std::string& text) {
  text += key + " = " + value + "\n";
}
void add_key(const std::string& key, double value, std::string& text) { add_key(key, format_number(value), text); }

void add_figure(const std::string& key, const NorthFigure& figure, std::string& text) {
  add_key(key + "_deg", figure.value_deg, text);
  add_key(key + "_sigma_deg", figure.sigma_deg, text);
}

[[gnu::format(printf, 2, 3)]] void print_text(std::ostream& out, const char* format, ...) {
  char text[240];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  out << text;
}

}  // namespace

std::string latitude_words(const RestLatitude& felt, double of_recording_deg) {
  char text[120];
  std::snprintf(text, sizeof text, "%.3f +- %.3f deg felt, the recording says %.4f", felt.latitude_rad / rad_per_deg,
                felt.sigma_rad / rad_per_deg, of_recording_deg);
  return text;
}

std::string undecided_words(const VerificationReport& report) {
  if (report.would_do_s <= 0.0) return "";
  char text[160];
  std::snprintf(text, sizeof text,
                "undecided: no more than noise; these gyros cannot keep %g deg in %.0f s, %.0f s would do",
                report.heading_limit_deg, report.align_s, report.would_do_s);
  return text;
}

std::string format_verification(const VerificationReport& report) {
  std::string text = report.info.simulated ? "# Simulated data: a dry run, or a twin.\n" : "";
  add_key("format", 1.0, text);
  add_key("unit_serial", report.info.unit_serial, text);
  add_key("simulated", report.info.simulated ? "true" : "false", text);
  add_key("recording_hash", report.recording_hash, text);
  add_key("parameters", report.parameters, text);
  add_key("trusted", report.trusted ? "true" : "false", text);
  add_key("align_s", report.align_s, text);
  if (!report.damage.empty()) add_key("damage", report.damage, text);
  add_key("filled_samples", static_cast<double>(report.filled_samples), text);
  for (std::size_t k = 0; k < report.left_out.size(); ++k)
    add_key("left_out." + std::to_string(k + 1), report.left_out[k], text);
  add_key("zero_deg", report.found.zero_deg, text);
  for (std::size_t p = 0; p < report.found.positions.size(); ++p) {
    const NorthPosition& position = report.found.positions[p];
    const std::string prefix = "position." + std::to_string(p + 1) + ".";
    add_key(prefix + "table_deg", position.table_deg, text);
    for (std::size_t k = 0; k < position.readings.size(); ++k)
      for (std::size_t a = 0; a < 3; ++a)
        add_key(prefix + std::to_string(k + 1) + "." + north_angle_names[a] + "_deg", position.readings[k].angle_deg[a],
                text);
    for (std::size_t a = 0; a < 3; ++a) {
      const std::string name = std::string(north_angle_names[a]) + "_deg";
      add_key(prefix + "mean." + name, position.mean_deg[a], text);
      add_key(prefix + "deviation." + name, position.deviation_deg[a], text);
      add_key(prefix + "sigma." + name, position.noise_sigma_deg[a], text);
    }
  }
  for (std::size_t a = 0; a < 3; ++a)
    add_figure(std::string("deviation.") + north_angle_names[a], report.found.deviation[a], text);
  add_figure("mean.heading", report.found.mean_heading, text);
  add_key("worst.heading_error_deg", report.found.worst_heading_error_deg, text);
  add_key("felt_latitude_deg", report.felt.latitude_rad / rad_per_deg, text);
  add_key("felt_latitude_sigma_deg", report.felt.sigma_rad / rad_per_deg, text);
  add_key("limit.heading_deg", report.heading_limit_deg, text);
  add_key("limit.level_deg", report.level_limit_deg, text);
  add_key("limit.guard_factor", report.guard_factor, text);
  add_key("false_fail", report.false_fail, text);
  if (report.would_do_s > 0.0) add_key("would_do.align_s", report.would_do_s, text);
  add_key("verdict.heading", std::string(to_string(report.heading)), text);
  add_key("verdict.level", std::string(to_string(report.level)), text);
  add_key("verdict.latitude", std::string(to_string(report.latitude)), text);
  add_key("verdict.result", std::string(to_string(report.verdict)), text);
  return text;
}

std::string verification_words(const VerificationReport& report) {
  char text[200];
  std::snprintf(text, sizeof text, "heading %.4f deg (mean %.4f) of %g, roll %.5f and pitch %.5f of %g",
                report.found.deviation[0].value_deg, report.found.mean_heading.value_deg, report.heading_limit_deg,
                report.found.deviation[1].value_deg, report.found.deviation[2].value_deg, report.level_limit_deg);
  std::string words = text;
  if (const std::string undecided = undecided_words(report); !undecided.empty()) words += "; " + undecided;
  if (report.latitude == UnitVerdict::fail)
    words += "; latitude " + latitude_words(report.felt, report.info.latitude_deg);
  if (!report.trusted) words += "; parameters not trusted";
  return words;
}

void print_verification(const VerificationReport& report, std::ostream& out) {
  if (!report.damage.empty()) out << report.damage << '\n';
  if (report.filled_samples > 0)
    out << report.filled_samples << " samples lost or bad, filled in from their neighbours\n";
  for (const std::string& alignment : report.left_out) out << "left out: " << alignment << '\n';
  print_text(out, "Unit %s, alignments of %.0f s; the table's zero is at a heading of %.4f deg. deg:\n\n",
             report.info.unit_serial.c_str(), report.align_s, report.found.zero_deg);
  for (const NorthPosition& position : report.found.positions) {
    print_text(out, "%7.1f %22s %12s %12s\n", position.table_deg, "heading", "roll", "pitch");
    for (std::size_t k = 0; k < position.readings.size(); ++k) {
      const std::array<double, 3>& x = position.readings[k].angle_deg;
      print_text(out, "  %-15zu %12.6f %12.6f %12.6f\n", k + 1, x[0], x[1], x[2]);
    }
    for (const auto& [name, values] :
         {std::pair{"mean", &position.mean_deg}, std::pair{"deviation", &position.deviation_deg},
          std::pair{"sigma, noise", &position.noise_sigma_deg}})
      print_text(out, "  %-15s %12.6f %12.6f %12.6f\n", name, (*values)[0], (*values)[1], (*values)[2]);
    out << "\n";
  }
  const NorthSeeking& found = report.found;
  print_text(out,
             "heading  largest deviation %.6f +- %.6f, means off the table by %.6f +- %.6f deg (rms); limit %g: %s\n",
             found.deviation[0].value_deg, found.deviation[0].sigma_deg, found.mean_heading.value_deg,
             found.mean_heading.sigma_deg, report.heading_limit_deg, std::string(to_string(report.heading)).c_str());
  print_text(out, "level    largest deviation of roll %.6f, of pitch %.6f deg; limit %g: %s\n",
             found.deviation[1].value_deg, found.deviation[2].value_deg, report.level_limit_deg,
             std::string(to_string(report.level)).c_str());
  out << "latitude " << latitude_words(report.felt, report.info.latitude_deg) << ": " << to_string(report.latitude)
      << "\n";
  print_text(out, "         a unit with nothing but this noise is above a limit in %.1f of 100 verifications\n",
             100.0 * report.false_fail);
  if (const std::string undecided = undecided_words(report); !undecided.empty())
    out << "heading  " << undecided << "\n";
  if (!report.trusted) out << not_trusted_words << "\n";
  out << "verdict  " << to_string(report.verdict) << "\n";
}

std::string format_references(const ReferenceReport& report) {
  std::string text;
  add_key("format", 1.0, text);
  add_key("references", report.file, text);
  for (std::size_t row = 0; row < report.found.error_deg.size(); ++row)
    for (std::size_t a = 0; a < 3; ++a)
      add_key("error." + std::to_string(row + 1) + "." + north_angle_names[a] + "_deg", report.found.error_deg[row][a],
              text);
  for (std::size_t a = 0; a < 3; ++a) {
    const std::string name = std::string(north_angle_names[a]) + "_deg";
    add_key("worst." + name, report.found.worst_deg[a], text);
    add_key("rms." + name, report.found.rms_deg[a], text);
    add_key("limit." + name, report.limit_deg[a], text);
  }
  add_key("verdict.result", report.pass ? "pass" : "fail", text);
  return text;
}

void print_references(const ReferenceReport& report, std::ostream& out) {
  print_text(out, "%-12s %12s %12s %12s   error, deg\n", "reading", "heading", "roll", "pitch");
  for (std::size_t row = 0; row < report.found.error_deg.size(); ++row) {
    const std::array<double, 3>& x = report.found.error_deg[row];
    print_text(out, "%-12zu %12.6f %12.6f %12.6f%s\n", row + 1, x[0], x[1], x[2], row == 0 ? "   bound" : "");
  }
  for (const auto& [name, values] : {std::pair{"worst", &report.found.worst_deg},
                                     std::pair{"rms", &report.found.rms_deg}, std::pair{"limit", &report.limit_deg}})
    print_text(out, "%-12s %12.6f %12.6f %12.6f\n", name, (*values)[0], (*values)[1], (*values)[2]);
  out << "verdict  " << (report.pass ? "pass" : "fail") << "\n";
}

}  // namespace turncal
