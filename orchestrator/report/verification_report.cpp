#include "orchestrator/report/verification_report.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "calib/model/parameters.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/figures/report_format.h"

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

// A list in a file: key.1, key.2 and so on.
void add_list(const std::string& key, const std::vector<std::string>& values, std::string& text) {
  for (std::size_t k = 0; k < values.size(); ++k) add_key(key + "." + std::to_string(k + 1), values[k], text);
}
std::vector<std::string> read_list(KeyValueFile& conf, const std::string& key) {
  std::vector<std::string> values;
  for (std::string at = key + ".1"; conf.has(at); at = key + "." + std::to_string(values.size() + 1))
    values.push_back(conf.text(at));
  return values;
}

}  // namespace

std::string gravity_words(const FeltSite& felt, double of_recording_mps2) {
  char text[120];
  std::snprintf(text, sizeof text, "%.5f m/s^2 felt, the recording says %.5f", felt.gravity_mps2, of_recording_mps2);
  return text;
}

void print_faults(const std::vector<std::string>& faults, std::ostream& out) {
  constexpr std::size_t most = 5;
  for (std::size_t k = 0; k < std::min(faults.size(), most); ++k) out << faults[k] << ": set aside\n";
  if (faults.size() > most) out << "and " << faults.size() - most << " more like it\n";
}

std::string latitude_words(const FeltSite& felt, double of_recording_deg) {
  char text[120];
  std::snprintf(text, sizeof text, "%.3f +- %.3f deg felt, the recording says %.4f", felt.latitude_rad / rad_per_deg,
                felt.sigma_rad / rad_per_deg, of_recording_deg);
  return text;
}

std::string undecided_words(const VerificationReport& report) {
  const std::string level =
      report.level_undecided ? "level undecided: the noise of this unit is as large as its limit" : "";
  if (report.would_do_s <= 0.0) return level;
  char text[160];
  std::snprintf(text, sizeof text,
                "heading undecided: no more than noise; these gyros cannot keep %g deg in %.0f s, %.0f s would do",
                report.heading_limit_deg, report.align_s, report.would_do_s);
  return level.empty() ? text : std::string(text) + "; " + level;
}

std::string format_verification(const VerificationReport& report) {
  std::string text = report.info.simulated ? "# Simulated data: a dry run, or a twin.\n" : "";
  add_key("format", 1.0, text);
  add_key("unit_serial", report.info.unit_serial, text);
  add_key("simulated", report.info.simulated ? "true" : "false", text);
  add_key("recording_hash", report.recording_hash, text);
  add_key("latitude_deg", report.info.latitude_deg, text);
  add_key("parameters", report.parameters, text);
  add_key("calibration_hash", report.calibration_hash, text);
  add_key("trusted", report.trusted ? "true" : "false", text);
  add_key("align_s", report.align_s, text);
  if (!report.damage.empty()) add_key("damage", report.damage, text);
  add_key("filled_samples", static_cast<double>(report.filled_samples), text);
  add_list("fault", report.faults, text);
  add_list("left_out", report.left_out, text);
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
  add_key("gravity_mps2", report.info.gravity_mps2, text);
  add_key("felt_gravity_mps2", report.felt.gravity_mps2, text);
  add_key("noise", report.noise_assumed ? "assumed" : "file", text);
  add_key("limit.heading_deg", report.heading_limit_deg, text);
  add_key("limit.level_deg", report.level_limit_deg, text);
  add_key("limit.guard_factor", report.guard_factor, text);
  add_key("false_fail", report.false_fail, text);
  if (report.would_do_s > 0.0) add_key("would_do.align_s", report.would_do_s, text);
  if (report.level_undecided) add_key("undecided.level", "true", text);
  add_key("verdict.heading", std::string(to_string(report.heading)), text);
  add_key("verdict.level", std::string(to_string(report.level)), text);
  add_key("verdict.latitude", std::string(to_string(report.latitude)), text);
  add_key("verdict.gravity", std::string(to_string(report.gravity)), text);
  add_key("verdict.result", std::string(to_string(report.verdict)), text);
  return with_checksum(std::move(text));
}

Result<VerificationReport> read_verification(const std::string& path) {
  const std::string text = TRY(read_whole_file(path));
  const std::string_view above = TRY(without_checksum(text, path));
  KeyValueFile parsed = TRY(KeyValueFile::parse(above, path));
  KeyValueFile& conf = parsed;
  VerificationReport report;
  conf.integer("format", 1, 1);
  report.info.unit_serial = conf.text("unit_serial");
  report.info.simulated = conf.boolean_or("simulated", false);
  report.info.latitude_deg = conf.number("latitude_deg", site_latitude_deg);
  report.recording_hash = conf.text("recording_hash");
  report.parameters = conf.text("parameters");
  report.calibration_hash = conf.text("calibration_hash");
  report.trusted = conf.boolean_or("trusted", false);
  report.align_s = conf.number("align_s", positive);
  report.damage = conf.text_or("damage", "");
  report.filled_samples = conf.integer("filled_samples", 0);
  report.faults = read_list(conf, "fault");
  report.left_out = read_list(conf, "left_out");
  report.found.zero_deg = conf.number("zero_deg");
  std::vector<NorthPosition>& positions = report.found.positions;
  do {
    const std::string prefix = "position." + std::to_string(positions.size() + 1) + ".";
    NorthPosition position;
    position.table_deg = conf.number(prefix + "table_deg");
    const auto reading = [&] { return prefix + std::to_string(position.readings.size() + 1) + "."; };
    while (conf.has(reading() + "heading_deg")) {
      NorthReading one{.table_deg = position.table_deg};
      for (std::size_t a = 0; a < 3; ++a) one.angle_deg[a] = conf.number(reading() + north_angle_names[a] + "_deg");
      position.readings.push_back(one);
    }
    for (std::size_t a = 0; a < 3; ++a) {
      const std::string name = std::string(north_angle_names[a]) + "_deg";
      position.mean_deg[a] = conf.number(prefix + "mean." + name);
      position.deviation_deg[a] = conf.number(prefix + "deviation." + name, not_negative);
      position.noise_sigma_deg[a] = conf.number(prefix + "sigma." + name, not_negative);
    }
    positions.push_back(std::move(position));
  } while (conf.has("position." + std::to_string(positions.size() + 1) + ".table_deg"));
  const auto figure = [&conf](const std::string& key) {
    return NorthFigure{conf.number(key + "_deg"), conf.number(key + "_sigma_deg", not_negative)};
  };
  for (std::size_t a = 0; a < 3; ++a)
    report.found.deviation[a] = figure(std::string("deviation.") + north_angle_names[a]);
  report.found.mean_heading = figure("mean.heading");
  report.found.worst_heading_error_deg = conf.number("worst.heading_error_deg");
  report.felt = {conf.number("felt_latitude_deg") * rad_per_deg,
                 conf.number("felt_latitude_sigma_deg", not_negative) * rad_per_deg,
                 conf.number("felt_gravity_mps2", not_negative)};
  report.info.gravity_mps2 = conf.number("gravity_mps2", positive);
  report.noise_assumed = conf.one_of("noise", {"file", "assumed"}) == "assumed";
  report.heading_limit_deg = conf.number("limit.heading_deg", positive);
  report.level_limit_deg = conf.number("limit.level_deg", positive);
  report.guard_factor = conf.number("limit.guard_factor", not_negative);
  report.false_fail = conf.number("false_fail", between(0.0, 1.0));
  report.would_do_s = conf.number_or("would_do.align_s", 0.0, not_negative);
  report.level_undecided = conf.boolean_or("undecided.level", false);
  for (const auto& [key, verdict] :
       {std::pair{"verdict.heading", &report.heading}, std::pair{"verdict.level", &report.level},
        std::pair{"verdict.latitude", &report.latitude}, std::pair{"verdict.gravity", &report.gravity},
        std::pair{"verdict.result", &report.verdict}}) {
    const std::optional<UnitVerdict> word = verdict_from(conf.text(key));
    if (!word) conf.reject(key, "a verdict");
    *verdict = word.value_or(UnitVerdict::fail);
  }
  TRY(conf.check_all_used());
  return report;
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
  if (report.gravity == UnitVerdict::fail) words += "; gravity " + gravity_words(report.felt, report.info.gravity_mps2);
  if (!report.trusted) words += "; parameters not trusted";
  return words;
}

void print_verification(const VerificationReport& report, std::ostream& out) {
  if (!report.damage.empty()) out << report.damage << '\n';
  if (report.filled_samples > 0)
    out << report.filled_samples << " samples lost or bad, filled in from their neighbours\n";
  print_faults(report.faults, out);
  for (const std::string& alignment : report.left_out) out << "left out: " << alignment << '\n';
  out << formatted("Unit %s, alignments of %.0f s; the table's zero is at a heading of %.4f deg. deg:\n\n",
                   report.info.unit_serial.c_str(), report.align_s, report.found.zero_deg);
  for (const NorthPosition& position : report.found.positions) {
    out << formatted("%7.1f %22s %12s %12s\n", position.table_deg, "heading", "roll", "pitch");
    for (std::size_t k = 0; k < position.readings.size(); ++k) {
      const std::array<double, 3>& x = position.readings[k].angle_deg;
      out << formatted("  %-15zu %12.6f %12.6f %12.6f\n", k + 1, x[0], x[1], x[2]);
    }
    for (const auto& [name, values] :
         {std::pair{"mean", &position.mean_deg}, std::pair{"deviation", &position.deviation_deg},
          std::pair{"sigma, noise", &position.noise_sigma_deg}})
      out << formatted("  %-15s %12.6f %12.6f %12.6f\n", name, (*values)[0], (*values)[1], (*values)[2]);
    out << "\n";
  }
  const NorthSeeking& found = report.found;
  out << formatted(
      "heading  largest deviation %.6f +- %.6f, means off the table by %.6f +- %.6f deg (rms); limit %g: %s\n",
      found.deviation[0].value_deg, found.deviation[0].sigma_deg, found.mean_heading.value_deg,
      found.mean_heading.sigma_deg, report.heading_limit_deg, std::string(to_string(report.heading)).c_str());
  out << formatted("level    largest deviation of roll %.6f, of pitch %.6f deg; limit %g: %s\n",
                   found.deviation[1].value_deg, found.deviation[2].value_deg, report.level_limit_deg,
                   std::string(to_string(report.level)).c_str());
  out << "         what turns every reading alike, as an accelerometer bias does, it cannot see\n";
  out << "latitude " << latitude_words(report.felt, report.info.latitude_deg) << ": " << to_string(report.latitude)
      << "\n";
  out << "gravity  " << gravity_words(report.felt, report.info.gravity_mps2) << ": " << to_string(report.gravity)
      << "\n";
  if (report.noise_assumed) out << "noise    " << assumed_noise_words << "\n";
  out << formatted("         a unit with nothing but this noise is above a limit in %.1f of 100 verifications\n",
                   100.0 * report.false_fail);
  if (const std::string undecided = undecided_words(report); !undecided.empty())
    out << "         " << undecided << "\n";
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
  out << formatted("%-12s %12s %12s %12s   error, deg\n", "reading", "heading", "roll", "pitch");
  for (std::size_t row = 0; row < report.found.error_deg.size(); ++row) {
    const std::array<double, 3>& x = report.found.error_deg[row];
    out << formatted("%-12zu %12.6f %12.6f %12.6f%s\n", row + 1, x[0], x[1], x[2], row == 0 ? "   bound" : "");
  }
  for (const auto& [name, values] : {std::pair{"worst", &report.found.worst_deg},
                                     std::pair{"rms", &report.found.rms_deg}, std::pair{"limit", &report.limit_deg}})
    out << formatted("%-12s %12.6f %12.6f %12.6f\n", name, (*values)[0], (*values)[1], (*values)[2]);
  out << "verdict  " << (report.pass ? "pass" : "fail") << "\n";
}

}  // namespace turncal
