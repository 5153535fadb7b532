#include "orchestrator/report/verification_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "calib/model/parameters.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/posix_file.h"

namespace turncal {
namespace {

// The fields of verification.conf, in its order: read where there is a file, else written.
class VerificationFields {
 public:
  explicit VerificationFields(KeyValueFile* file = nullptr) : file_(file) {}
  void number(const std::string& key, double& value, NumberRange range = any_number) {
    file_ ? void(value = file_->number(key, range)) : lines.number(key, value);
  }
  void angle(const std::string& key, double& rad, NumberRange range = any_number) {
    double deg = rad / rad_per_deg;
    number(key, deg, range);
    if (file_) rad = deg * rad_per_deg;
  }
  void text(const std::string& key, std::string& value) {
    file_ ? void(value = file_->text(key)) : lines.text(key, value);
  }
  void flag(const std::string& key, bool& value) {
    file_ ? void(value = file_->boolean_or(key, false)) : lines.flag(key, value);
  }
  void choice(const std::string& key, std::string& value, std::initializer_list<std::string_view> choices) {
    file_ ? void(value = file_->one_of(key, choices)) : lines.text(key, value);
  }
  void count(const std::string& key, std::int64_t& value) {
    file_ ? void(value = file_->integer(key, 0)) : lines.number(key, static_cast<double>(value));
  }
  void verdict(const std::string& key, UnitVerdict& value) {
    std::string word(to_string(value));
    text(key, word);
    if (file_ && !verdict_from(word)) file_->reject(key, "a verdict");
    value = verdict_from(word).value_or(UnitVerdict::fail);
  }
  void texts(const std::string& key, std::vector<std::string>& values) {
    for (std::size_t k = 0; next(fmt::format("{}.{}", key, k + 1), k, values); ++k)
      text(fmt::format("{}.{}", key, k + 1), values[k]);
  }
  // Whether there is another element, which `key` tells; room for it.
  template <class Element>
  bool next(const std::string& key, std::size_t k, std::vector<Element>& elements) {
    if (file_ && file_->has(key)) elements.emplace_back();
    return k < elements.size();
  }
  // Whether the key stands in the file: optional ones are written where they say something.
  bool stands(const std::string& key, bool says_something) const { return file_ ? file_->has(key) : says_something; }
  KeyValues lines;

 private:
  KeyValueFile* file_;
};

void each_field(VerificationReport& r, VerificationFields& fields) {
  fields.text("unit_serial", r.info.unit_serial);
  fields.flag("simulated", r.info.simulated);
  fields.text("recording_hash", r.recording_hash);
  fields.number("latitude_deg", r.info.latitude_deg, site_latitude_deg);
  fields.text("parameters", r.parameters);
  fields.text("calibration_hash", r.calibration_hash);
  fields.flag("trusted", r.trusted);
  fields.number("align_s", r.align_s, positive);
  if (fields.stands("damage", !r.damage.empty())) fields.text("damage", r.damage);
  fields.count("filled_samples", r.filled_samples);
  fields.texts("fault", r.faults);
  fields.texts("left_out", r.left_out);
  fields.number("zero_deg", r.found.zero_deg);
  const auto angles = [&fields](const std::string& key, std::array<double, 3>& deg, NumberRange range = any_number) {
    for (std::size_t a = 0; a < 3; ++a)
      fields.number(fmt::format("{}.{}_deg", key, north_angle_names[a]), deg[a], range);
  };
  std::vector<NorthPosition>& positions = r.found.positions;
  for (std::size_t p = 0; fields.next(fmt::format("position.{}.table_deg", p + 1), p, positions); ++p) {
    NorthPosition& position = positions[p];
    const std::string key = fmt::format("position.{}", p + 1);
    fields.number(key + ".table_deg", position.table_deg);
    for (std::size_t k = 0; fields.next(fmt::format("{}.{}.heading_deg", key, k + 1), k, position.readings); ++k) {
      position.readings[k].table_deg = position.table_deg;
      angles(fmt::format("{}.{}", key, k + 1), position.readings[k].angle_deg);
    }
    for (std::size_t a = 0; a < 3; ++a) {
      const std::string name = std::string(north_angle_names[a]) + "_deg";
      fields.number(key + ".mean." + name, position.mean_deg[a]);
      fields.number(key + ".deviation." + name, position.deviation_deg[a], not_negative);
      fields.number(key + ".sigma." + name, position.noise_sigma_deg[a], not_negative);
    }
  }
  const auto figure = [&fields](const std::string& key, NorthFigure& of) {
    fields.number(key + "_deg", of.value_deg);
    fields.number(key + "_sigma_deg", of.sigma_deg, not_negative);
  };
  for (std::size_t a = 0; a < 3; ++a) figure(std::string("deviation.") + north_angle_names[a], r.found.deviation[a]);
  figure("mean.heading", r.found.mean_heading);
  fields.number("worst.heading_error_deg", r.found.worst_heading_error_deg);
  fields.angle("felt_latitude_deg", r.felt.latitude_rad);
  fields.angle("felt_latitude_sigma_deg", r.felt.sigma_rad, not_negative);
  fields.number("gravity_mps2", r.info.gravity_mps2, positive);
  fields.number("felt_gravity_mps2", r.felt.gravity_mps2, not_negative);
  std::string noise = r.noise_assumed ? "assumed" : "file";
  fields.choice("noise", noise, {"file", "assumed"});
  r.noise_assumed = noise == "assumed";
  fields.number("limit.heading_deg", r.heading_limit_deg, positive);
  fields.number("limit.level_deg", r.level_limit_deg, positive);
  fields.number("limit.guard_factor", r.guard_factor, not_negative);
  fields.number("false_fail", r.false_fail, between(0.0, 1.0));
  if (fields.stands("would_do.align_s", r.would_do_s > 0.0))
    fields.number("would_do.align_s", r.would_do_s, not_negative);
  if (fields.stands("undecided.level", r.level_undecided)) fields.flag("undecided.level", r.level_undecided);
  fields.verdict("verdict.heading", r.heading);
  fields.verdict("verdict.level", r.level);
  fields.verdict("verdict.latitude", r.latitude);
  fields.verdict("verdict.gravity", r.gravity);
  fields.verdict("verdict.result", r.verdict);
}

}  // namespace

std::string gravity_words(const FeltSite& felt, double of_recording_mps2) {
  return fmt::format("{:.5f} m/s^2 felt, the recording says {:.5f}", felt.gravity_mps2, of_recording_mps2);
}

void add_faults(const std::vector<std::string>& faults, Document& document) {
  constexpr std::size_t most = 5;
  for (std::size_t k = 0; k < std::min(faults.size(), most); ++k) document.text(faults[k] + ": set aside");
  if (faults.size() > most) document.text(fmt::format("and {} more like it", faults.size() - most));
}

std::string latitude_words(const FeltSite& felt, double of_recording_deg) {
  return fmt::format("{:.3f} +- {:.3f} deg felt, the recording says {:.4f}", felt.latitude_rad / rad_per_deg,
                     felt.sigma_rad / rad_per_deg, of_recording_deg);
}

std::string undecided_words(const VerificationReport& report) {
  const std::string level =
      report.level_undecided ? "level undecided: the noise of this unit is as large as its limit" : "";
  if (report.would_do_s <= 0.0) return level;
  const std::string heading = fmt::format(
      "heading undecided: no more than noise; these gyros cannot keep {:g} deg in {:.0f} s, {:.0f} s would do",
      report.heading_limit_deg, report.align_s, report.would_do_s);
  return level.empty() ? heading : heading + "; " + level;
}

std::string format_verification(VerificationReport report) {
  VerificationFields fields;
  if (report.info.simulated) fields.lines.comment("Simulated data: a dry run, or a twin.");
  fields.lines.number("format", 1.0);
  each_field(report, fields);
  return with_checksum(fields.lines.take());
}

Result<VerificationReport> read_verification(const std::string& path) {
  const std::string text = TRY(read_whole_file(path));
  const std::string_view above = TRY(without_checksum(text, path));
  KeyValueFile conf = TRY(KeyValueFile::parse(above, path));
  VerificationReport report;
  conf.integer("format", 1, 1);
  VerificationFields fields(&conf);
  each_field(report, fields);
  if (report.found.positions.empty()) conf.reject("position.1.table_deg", "a number");
  TRY(conf.check_all_used());
  return report;
}

std::string verification_words(const VerificationReport& report) {
  std::string words =
      fmt::format("heading {:.4f} deg (mean {:.4f}) of {:g}, roll {:.5f} and pitch {:.5f} of {:g}",
                  report.found.deviation[0].value_deg, report.found.mean_heading.value_deg, report.heading_limit_deg,
                  report.found.deviation[1].value_deg, report.found.deviation[2].value_deg, report.level_limit_deg);
  if (const std::string undecided = undecided_words(report); !undecided.empty()) words += "; " + undecided;
  if (report.latitude == UnitVerdict::fail)
    words += "; latitude " + latitude_words(report.felt, report.info.latitude_deg);
  if (report.gravity == UnitVerdict::fail) words += "; gravity " + gravity_words(report.felt, report.info.gravity_mps2);
  if (!report.trusted) words += "; parameters not trusted";
  return words;
}

namespace {

// Heading, roll and pitch, degrees.
void add_angles(const std::string& name, const std::array<double, 3>& angles_deg, Table& table) {
  std::vector<Cell> row = {cell::text(name)};
  for (const double angle : angles_deg) row.push_back(cell::fixed(angle, 6));
  table.row(std::move(row));
}

}  // namespace

Document verification_document(const VerificationReport& report) {
  const NorthSeeking& found = report.found;
  Document document{"", "Verification of unit " + report.info.unit_serial};
  if (!report.damage.empty()) document.text(report.damage);
  if (report.filled_samples > 0)
    document.text(fmt::format("{} samples lost or bad, filled in from their neighbours", report.filled_samples));
  add_faults(report.faults, document);
  for (const std::string& alignment : report.left_out) document.text("left out: " + alignment);
  document.text(fmt::format("Unit {}, alignments of {:.0f} s; the table's zero is at a heading of {:.4f} deg. deg:",
                            report.info.unit_serial, report.align_s, found.zero_deg));
  for (const NorthPosition& position : found.positions) {
    Table table{{cell::text(fmt::format("table at {:.1f}", position.table_deg)), cell::number("heading"),
                 cell::number("roll"), cell::number("pitch")}};
    for (std::size_t k = 0; k < position.readings.size(); ++k)
      add_angles(std::to_string(k + 1), position.readings[k].angle_deg, table);
    add_angles("mean", position.mean_deg, table);
    add_angles("deviation", position.deviation_deg, table);
    add_angles("sigma, noise", position.noise_sigma_deg, table);
    document.add(std::move(table));
  }
  Facts facts;
  const auto add = [&facts](const char* label, const std::string& words) { facts.rows.emplace_back(label, words); };
  add("heading",
      fmt::format(
          "largest deviation {:.6f} +- {:.6f}, means off the table by {:.6f} +- {:.6f} deg (rms); limit {:g}: {}",
          found.deviation[0].value_deg, found.deviation[0].sigma_deg, found.mean_heading.value_deg,
          found.mean_heading.sigma_deg, report.heading_limit_deg, to_string(report.heading)));
  add("level",
      fmt::format("largest deviation of roll {:.6f}, of pitch {:.6f} deg; limit {:g}: {}", found.deviation[1].value_deg,
                  found.deviation[2].value_deg, report.level_limit_deg, to_string(report.level)));
  add("", "what turns every reading alike, as an accelerometer bias does, it cannot see");
  add("latitude",
      fmt::format("{}: {}", latitude_words(report.felt, report.info.latitude_deg), to_string(report.latitude)));
  add("gravity",
      fmt::format("{}: {}", gravity_words(report.felt, report.info.gravity_mps2), to_string(report.gravity)));
  if (report.noise_assumed) add("noise", assumed_noise_words);
  add("", fmt::format("a unit with nothing but this noise is above a limit in {:.1f} of 100 verifications",
                      100.0 * report.false_fail));
  if (const std::string undecided = undecided_words(report); !undecided.empty()) add("", undecided);
  if (!report.trusted) add("", not_trusted_words);
  add("verdict", std::string(to_string(report.verdict)));
  document.add(std::move(facts));
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
  document.text("Error of each reading, deg; the first one is bound.");
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
