#include "orchestrator/report/verification_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "calib/model/parameters.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/key_value.h"
#include "orchestrator/station/fields.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

void add_figure(const std::string& key, NorthFigure& figure, Fields& fields) {
  fields.push_back({key + "_deg", &figure.value_deg});
  fields.push_back({key + "_sigma_deg", &figure.sigma_deg, not_negative});
}

std::string angle_name(std::size_t a) { return std::string(north_angle_names[a]) + "_deg"; }

// Returns the fields of verification.conf, in order; for lists, positions and readings as many as there is room for.
Fields fields_of(VerificationReport& report) {
  Fields fields = {{"unit_serial", &report.info.unit_serial},
                   {"simulated", &report.info.simulated},
                   {"recording_hash", &report.recording_hash},
                   {"latitude_deg", &report.info.latitude_deg, site_latitude_deg},
                   {"parameters", &report.parameters},
                   {"calibration_hash", &report.calibration_hash},
                   {"trusted", &report.trusted},
                   {"trusted.reason", &report.why_not_trusted, {}, true},
                   {"align_s", &report.align_s, positive},
                   {"damage", &report.damage, {}, true},
                   {"filled_samples", &report.filled_samples, not_negative}};
  add_list("fault", report.faults, fields);
  add_list("left_out", report.left_out, fields);
  NorthSeeking& found = report.found;
  fields.push_back({"zero_deg", &found.zero_deg});
  for (std::size_t p = 0; p < found.positions.size(); ++p) {
    NorthPosition& position = found.positions[p];
    const std::string prefix = "position." + std::to_string(p + 1) + ".";
    fields.push_back({prefix + "table_deg", &position.table_deg});
    for (std::size_t k = 0; k < position.readings.size(); ++k)
      for (std::size_t a = 0; a < 3; ++a)
        fields.push_back({prefix + std::to_string(k + 1) + "." + angle_name(a), &position.readings[k].angle_deg[a]});
    for (std::size_t a = 0; a < 3; ++a) {
      fields.push_back({prefix + "mean." + angle_name(a), &position.mean_deg[a]});
      fields.push_back({prefix + "deviation." + angle_name(a), &position.deviation_deg[a], not_negative});
      fields.push_back({prefix + "sigma." + angle_name(a), &position.noise_sigma_deg[a], not_negative});
    }
  }
  for (std::size_t a = 0; a < 3; ++a)
    add_figure(std::string("deviation.") + north_angle_names[a], found.deviation[a], fields);
  add_figure("mean.heading", found.mean_heading, fields);
  const Fields rest = {{"worst.heading_error_deg", &found.worst_heading_error_deg},
                       {"felt_latitude_deg", &report.felt.latitude_rad, any_number, false, rad_per_deg},
                       {"felt_latitude_sigma_deg", &report.felt.sigma_rad, not_negative, false, rad_per_deg},
                       {"gravity_mps2", &report.info.gravity_mps2, positive},
                       {"felt_gravity_mps2", &report.felt.gravity_mps2, not_negative},
                       chosen("noise", report.noise_assumed, {"file", "assumed"}, "file or assumed"),
                       {"limit.heading_deg", &report.heading_limit_deg, positive},
                       {"limit.level_deg", &report.level_limit_deg, positive},
                       {"limit.guard_factor", &report.guard_factor, not_negative},
                       {"false_fail", &report.false_fail, between(0.0, 1.0)},
                       {"would_do.align_s", &report.would_do_s, not_negative, true},
                       {"undecided.level", &report.level_undecided, {}, true},
                       verdict_field("verdict.heading", report.heading),
                       verdict_field("verdict.level", report.level),
                       verdict_field("verdict.latitude", report.latitude),
                       verdict_field("verdict.gravity", report.gravity),
                       verdict_field("verdict.result", report.verdict)};
  fields.insert(fields.end(), rest.begin(), rest.end());
  return fields;
}

// Returns why heading or level is undecided; empty when both are decided.
std::string undecided_words(const VerificationReport& report) {
  const std::string level =
      report.level_undecided ? "level undecided: the noise of this unit is as large as the limit" : "";
  if (report.would_do_s <= 0.0) return level;
  const std::string heading = fmt::format(
      "heading undecided: within the noise; these gyros cannot keep {:g} deg with alignments of {:.0f} s, {:.0f} s "
      "would suffice",
      report.heading_limit_deg, report.align_s, report.would_do_s);
  return level.empty() ? heading : heading + "; " + level;
}

// Returns how near the worst figure is to a limit, with its guard band: "heading 33 % of its limit (91 % with the guard band)".
std::string nearness_words(const VerificationReport& report) {
  const auto words = [&](const char* name, double limit_deg, const NorthFigure& a, const NorthFigure& b) {
    const auto guarded = [&](const NorthFigure& f) { return f.value_deg + 2.0 * report.guard_factor * f.sigma_deg; };
    return fmt::format("{} {:.0f} % of its limit ({:.0f} % with the guard band)", name,
                       100.0 * std::max(a.value_deg, b.value_deg) / limit_deg,
                       100.0 * std::max(guarded(a), guarded(b)) / limit_deg);
  };
  const NorthSeeking& found = report.found;
  return words("heading", report.heading_limit_deg, found.deviation[0], found.mean_heading) + ", " +
         words("level", report.level_limit_deg, found.deviation[1], found.deviation[2]) +
         (report.latitude == UnitVerdict::fail ? ", latitude fails" : "") +
         (report.gravity == UnitVerdict::fail ? ", gravity fails" : "") +
         (report.trusted ? "" : ", parameters not trusted: " + report.why_not_trusted);
}

std::string words_of(const NorthFigure& figure) { return quantity(figure.value_deg, figure.sigma_deg, "deg"); }

std::string heading_words(const VerificationReport& report) {
  return fmt::format("largest deviation {}, means differ from the table by {} (rms); limit {:g}",
                     words_of(report.found.deviation[0]), words_of(report.found.mean_heading),
                     report.heading_limit_deg);
}

std::string level_words(const VerificationReport& report) {
  return fmt::format("largest deviation of roll {}, of pitch {}; limit {:g}", words_of(report.found.deviation[1]),
                     words_of(report.found.deviation[2]), report.level_limit_deg);
}

// Adds heading, roll and pitch, degrees. Sigmas of 0 are unknown.
void add_angles(const std::string& name, const std::array<double, 3>& angles_deg, Table& table,
                const std::array<double, 3>& sigmas_deg = {}) {
  std::vector<Cell> row = {cell::text(name)};
  for (std::size_t a = 0; a < angles_deg.size(); ++a)
    row.push_back(sigmas_deg[a] > 0.0 ? cell::with_sigma(angles_deg[a], sigmas_deg[a]) : cell::fixed(angles_deg[a], 6));
  table.row(std::move(row));
}

// Draws the readings in order, with their sigmas from noise, as they are judged: headings minus the table's angle, roll and pitch minus the
// mean of their position.
Figure angle_figure(const VerificationReport& report) {
  Figure figure =
      small_panels("angles", "Headings minus the angle of the table; roll and pitch minus the mean of their position");
  for (std::size_t a = 0; a < north_angle_names.size(); ++a) {
    const double limit_deg = a == 0 ? report.heading_limit_deg : report.level_limit_deg;
    Series readings{"one alignment", Series::Style::dot, Colour::after, {}},
        bars{"one sigma (noise)", Series::Style::line, Colour::after, {}};
    double x = 0.0;
    for (const NorthPosition& position : report.found.positions)
      for (const NorthReading& reading : position.readings) {
        const double from_deg = a == 0 ? position.table_deg : position.mean_deg[a];
        const double error = near(reading.angle_deg[a] - from_deg, 0.0), sigma = position.noise_sigma_deg[a];
        readings.points.emplace_back(++x, error);
        for (const double end : {error - sigma, error + sigma, no_point}) bars.points.emplace_back(x, end);
      }
    Panel panel{.title = std::string(north_angle_names[a]) + (a == 0 ? " minus the table's" : " minus its mean"),
                .x_label = "alignment",
                .y_label = "difference, °",
                .series = {readings, bars}};
    for (const double limit : {-limit_deg, limit_deg})
      panel.series.push_back({"limit of the standard deviation in a position",
                              Series::Style::dashed,
                              Colour::before,
                              {{0.5, limit}, {x + 0.5, limit}}});
    figure.panels.push_back(std::move(panel));
  }
  return figure;
}

}  // namespace

Status write_verification(const std::string& path, const VerificationReport& report) {
  TRY(write_file_atomically(path, format_verification(report)));
  return write_file_atomically(std::filesystem::path(path).replace_extension("html"),
                               as_page(verification_document(report)).html);
}

std::string gravity_words(const FeltSite& felt, double of_recording_mps2) {
  return fmt::format("{:.5f} m/s² estimated, the recording says {:.10g}", felt.gravity_mps2, of_recording_mps2);
}

void add_faults(const std::vector<std::string>& faults, Document& document) {
  constexpr std::size_t most = 5;
  for (std::size_t k = 0; k < std::min(faults.size(), most); ++k) document.text(faults[k] + ": set aside");
  if (faults.size() > most) document.text(fmt::format("and {} more like it", faults.size() - most));
}

std::string latitude_words(const FeltSite& felt, double of_recording_deg) {
  return fmt::format("{} estimated, the recording says {:.10g}",
                     quantity(felt.latitude_rad / rad_per_deg, felt.sigma_rad / rad_per_deg, "deg"), of_recording_deg);
}

std::string format_verification(VerificationReport report) {
  return with_checksum(
      (report.info.simulated ? "# Simulated data: a dry run, or a twin.\nformat = 1\n" : "format = 1\n") +
      key_value_lines(texts_of(fields_of(report))));
}

Result<VerificationReport> read_verification(const std::string& path) {
  const std::string text = TRY(read_whole_file(path));
  const std::string_view above = TRY(without_checksum(text, path));
  KeyValueFile conf = TRY(KeyValueFile::parse(above, path));
  VerificationReport report;
  conf.integer("format", 1, 1);
  report.faults.resize(count_numbered(conf, "fault."));
  report.left_out.resize(count_numbered(conf, "left_out."));
  report.found.positions.resize(std::max<std::size_t>(1, count_numbered(conf, "position.", ".table_deg")));
  for (std::size_t p = 0; p < report.found.positions.size(); ++p)
    report.found.positions[p].readings.resize(
        count_numbered(conf, "position." + std::to_string(p + 1) + ".", ".heading_deg"));
  read_fields(conf, fields_of(report));
  for (NorthPosition& position : report.found.positions)
    for (NorthReading& reading : position.readings) reading.table_deg = position.table_deg;
  TRY(conf.check_all_used());
  return report;
}

UnitVerdict verdict_of_figures(const VerificationReport& report) {
  return std::max({report.heading, report.level, report.latitude, report.gravity});
}

std::string figures_words(const VerificationReport& report) {
  std::string words = plain("heading: " + heading_words(report) + "; level: " + level_words(report));
  if (const std::string undecided = undecided_words(report); !undecided.empty()) words += "; " + undecided;
  if (report.latitude == UnitVerdict::fail)
    words += "; latitude " + plain(latitude_words(report.felt, report.info.latitude_deg));
  if (report.gravity == UnitVerdict::fail)
    words += "; gravity " + plain(gravity_words(report.felt, report.info.gravity_mps2));
  return words;
}

std::string verification_words(const VerificationReport& report) {
  return figures_words(report) + (report.trusted ? "" : "; parameters not trusted: " + report.why_not_trusted);
}

Document verification_document(const VerificationReport& report, const std::string& verdict_name) {
  const NorthSeeking& found = report.found;
  const auto judged = [](const std::string& figures, UnitVerdict verdict) {
    return figures + ": " + in_words(to_string(verdict));
  };
  const std::string heading = "Verification, unit " + report.info.unit_serial;
  Document document{"turncal: " + heading, heading};
  document.soft(
      fmt::format("North seeking with {}; recording with content {}.", report.parameters, report.recording_hash));
  if (report.info.simulated)
    document.add(Paragraph{"Simulated data: this is no verification of a real unit.", "loud"}, Scope::page);
  const std::string verdict = in_words(to_string(report.verdict)) + ": " + nearness_words(report);
  document.add(Paragraph{verdict + ".", "verdict " + std::string(to_string(tone_of(report.verdict)))}, Scope::page);
  Facts facts;
  facts.add("heading", judged(heading_words(report), report.heading));
  facts.add("level", judged(level_words(report), report.level));
  facts.add("", "a tilt common to all readings (an accelerometer bias) is not visible");
  facts.add("latitude", judged(latitude_words(report.felt, report.info.latitude_deg), report.latitude));
  facts.add("gravity", judged(gravity_words(report.felt, report.info.gravity_mps2), report.gravity));
  if (report.noise_assumed) facts.add("noise", assumed_noise_words);
  facts.add("", fmt::format("noise alone would exceed a limit in {} of 100 verifications",
                            report.false_fail < 1e-3 ? "less than 0.1" : with_decimals(100.0 * report.false_fail, 1)));
  if (const std::string undecided = undecided_words(report); !undecided.empty()) facts.add("", undecided);
  if (!report.trusted) facts.add("not trusted", report.why_not_trusted);
  document.add(facts, Scope::page);
  document.figure(angle_figure(report));
  document.add(Heading{2, "readings", "Readings"}, Scope::page);
  if (!report.damage.empty()) document.text(report.damage);
  if (report.filled_samples > 0)
    document.text(counted(report.filled_samples, "sample") + " lost or bad, filled in from their neighbours");
  add_faults(report.faults, document);
  for (const std::string& alignment : report.left_out) document.text("left out: " + alignment);
  document.text(fmt::format(
      "Unit {}, alignments of {:.0f} s; the table's zero is at a heading of {} deg. Angles in deg:",
      report.info.unit_serial, report.align_s, value_with_sigma(found.zero_deg, found.mean_heading.sigma_deg)));
  for (const NorthPosition& position : found.positions) {
    Table table{{cell::text(fmt::format("table at {:.1f}", position.table_deg)), cell::number("heading"),
                 cell::number("roll"), cell::number("pitch")}};
    for (std::size_t k = 0; k < position.readings.size(); ++k)
      add_angles(std::to_string(k + 1), position.readings[k].angle_deg, table, position.noise_sigma_deg);
    add_angles("mean", position.mean_deg, table, position.noise_sigma_deg);
    add_angles("deviation", position.deviation_deg, table, position.noise_sigma_deg);
    add_angles("sigma, noise", position.noise_sigma_deg, table, position.noise_sigma_deg);
    document.add(std::move(table));
  }
  facts.add(verdict_name, verdict);
  document.add(std::move(facts), Scope::terminal);
  return document;
}

std::string format_references(const ReferenceReport& report) {
  KeyValues lines;
  lines.number("format", 1.0);
  lines.text("references", report.file);
  for (std::size_t row = 0; row < report.found.error_deg.size(); ++row)
    for (std::size_t a = 0; a < 3; ++a)
      lines.number(fmt::format("error.{}.{}_deg", row + 1, north_angle_names[a]), report.found.error_deg[row][a]);
  for (std::size_t a = 0; a < 3; ++a) {
    const std::string name = std::string(north_angle_names[a]) + "_deg";
    lines.number("worst." + name, report.found.worst_deg[a]);
    lines.number("rms." + name, report.found.rms_deg[a]);
    lines.number("limit." + name, report.limit_deg[a]);
  }
  lines.text("verdict.result", report.pass ? "pass" : "fail");
  return lines.take();
}

Document reference_document(const ReferenceReport& report) {
  Document document{"", "Readings of " + report.file};
  document.text("Error of each reading, deg; the first relates the references to the unit.");
  Table table{{cell::text("reading"), cell::number("heading"), cell::number("roll"), cell::number("pitch")}};
  for (std::size_t row = 0; row < report.found.error_deg.size(); ++row)
    add_angles(std::to_string(row + 1), report.found.error_deg[row], table);
  add_angles("worst", report.found.worst_deg, table);
  add_angles("rms", report.found.rms_deg, table);
  add_angles("limit", report.limit_deg, table);
  document.add(std::move(table));
  document.add(Facts{{{"verdict", report.pass ? "pass" : "fail"}}});
  return document;
}

}  // namespace turncal
