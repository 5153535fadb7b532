#include "orchestrator/report/certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/model/effects.h"
#include "calib/navigation/north_seeking.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/document.h"
#include "orchestrator/watch/page_server.h"

namespace turncal {

extern const std::string_view certificate_css;  // certificate.css

namespace {

using namespace cell;

std::string of_record(const ParameterFile& file, const std::string& key, const std::string& otherwise = "-") {
  const std::string* const value = find_further(file, key);
  return value ? *value : otherwise;
}

std::string or_dash(const std::string& text) { return text.empty() ? "-" : text; }

std::string section(const std::string& title, const std::string& inner) {
  return fmt::format("<section><h2>{}</h2>\n{}</section>\n", title, inner);
}
std::string fact_section(const std::string& title, std::vector<std::pair<std::string, std::string>> rows) {
  return section(title, html(Facts{std::move(rows)}));
}

std::string effect_names(const ParameterFile& file) {
  std::vector<std::string> names;
  for (const EffectValue& effect : file.effects)
    if (std::ranges::find(names, effect.name) == names.end()) names.push_back(effect.name);
  return join(names);
}

// Returns what is known about effects beyond the parameters.
std::string effects_found(const ParameterFile& file) {
  const std::string diagnosis = of_record(file, "verdict.diagnosis", "not_made");
  std::string words = "not examined";
  if (diagnosis == "unexplained")
    words = "a residual is left that no effect explains";
  else if (!file.effects.empty())
    words = "those found are in the model: " + effect_names(file);
  else if (diagnosis == "extended")
    words = "those found are not in the model";
  else if (diagnosis == "clean")
    words = "none was found";
  if (diagnosis != "unexplained" && !is_trusted(file))
    words += ", and the standard deviations are not trusted: " + why_not_trusted(file);
  return words + ".";
}

// Returns the words at the top of the page; empty for a unit that keeps its limits, or has none.
std::string not_conforming(UnitVerdict verdict) {
  switch (verdict) {
    case UnitVerdict::fail: return "NOT CONFORMING: the unit does not keep its limits (see Conformity)";
    case UnitVerdict::conditional_fail:
      return "NOT CONFORMING: outside the limits by less than the uncertainty (see Conformity)";
    case UnitVerdict::hold:
      return "NO STATEMENT OF CONFORMITY: the unit is held until somebody decides (see Conformity)";
    default: return "";
  }
}

// Returns the judgements of a value and of its sigma, with the limits.
std::string judged_of(const Certificate& c, const std::string& key) {
  std::vector<std::string> words;
  for (const JudgedValue& one : c.conformity.values)
    if (one.key == key || one.key == "sigma." + key)
      words.push_back((one.key == key ? "" : "sigma: ") + in_words(to_string(one.verdict)) + ", " +
                      limits_words(one.limit));
  return words.empty() ? "-" : join(words, "; ");
}

// Returns the judgements of other values: the residual, the temperature, the clock.
std::string judged_beside(const Certificate& c) {
  std::vector<std::string> words;
  for (const JudgedValue& one : c.conformity.values) {
    const bool of_parameter = std::ranges::any_of(parameter_keys, [&one](std::string_view key) {
      return one.key == key || one.key == "sigma." + std::string(key);
    });
    if (!of_parameter) words.push_back(judged_words(one) + ": " + in_words(to_string(one.verdict)));
  }
  return join(words, "; ");
}

// Drops the budget columns from `first` to the last but `after` that are zero in every row, and returns their names.
std::string drop_empty(Table& table, std::size_t first, std::size_t after) {
  std::vector<std::string> left_out;
  for (std::size_t column = table.head.size() - after; column-- > first;) {
    if (std::ranges::any_of(table.rows, [column](const Table::Row& row) { return row.cells[column].value > 0.0; }))
      continue;
    left_out.insert(left_out.begin(), table.head[column].words);
    table.drop(column);
  }
  return join(left_out);
}

Table result_table(const Certificate& c) {
  Table table{{text("parameter"), text("quantity"), text("unit"), number("value"), number("U (k = 2)"),
               number("estimate"), number("confounding"), number("gravity"), number("latitude"),
               number("repeatability"), text("limits")}};
  for (const int i : free_parameters()) {
    const std::string key(parameter_keys[i]);
    const UncertaintyBudget& u = c.budget[i];
    const double expanded = u.expanded();
    const std::string unit = unit_text(parameter_unit(key, c.file.gyro_increment));
    table.row({name(key), text(quantity_name(key)), text(unit == "-" ? "1" : unit),
               with_sigma(c.file.parameters[Eigen::Index(i)], expanded), number(expanded, 2), number(u.estimate, 2),
               number(u.alias, 2), number(u.gravity, 2), number(u.latitude, 2), number(u.repeatability, 2),
               text(judged_of(c, key))});
  }
  return table;
}

// Returns the unit. A constant that was given and not estimated (a time constant, a width) has no sigma; its name ends in its unit.
std::string effect_unit(const EffectValue& effect) {
  if (!effect.sigma) return effect.component.substr(effect.component.rfind('_') + 1);
  const EffectEntry* const entry = find_effect(effect.name);
  return entry ? unit_text(entry->unit) : "-";
}

std::string effect_table(const Certificate& c) {
  if (c.file.effects.empty()) return "";
  Table table{{text("effect"), text("unit"), number("value"), number("U (k = 2)"), number("estimate, confounding"),
               number("repeatability")}};
  for (std::size_t i = 0; i < c.file.effects.size(); ++i) {
    const EffectValue& effect = c.file.effects[i];
    const UncertaintyBudget& u = c.effect_budget[i];
    table.row({name(effect.name + "." + effect.component), text(effect_unit(effect)),
               with_sigma(effect.value, u.expanded()), effect.sigma ? number(u.expanded(), 2) : number("given"),
               effect.sigma ? number(u.estimate, 2) : number("-"), number(u.repeatability, 2)});
  }
  return html(table);
}

std::string north_section(const VerificationReport& v) {
  Table table{{text("table, °")}};
  for (const char* angle : north_angle_names)
    for (const char* what : {"mean", "deviation"})
      table.head.push_back(number(std::string(angle) + " " + what + ", °"));
  for (const NorthPosition& position : v.found.positions) {
    std::vector<Cell> cells = {text(format_number(position.table_deg))};
    for (std::size_t a = 0; a < north_angle_names.size(); ++a)
      for (const double value : {position.mean_deg[a], position.deviation_deg[a]})
        cells.push_back(with_sigma(value, position.noise_sigma_deg[a]));
    table.row(std::move(cells));
  }
  return section(
      "Verification: north seeking",
      html(table) +
          html(Paragraph{fmt::format(
              "Alignments of {} s; limits {} ° for the heading's deviation and mean, {} ° for roll and pitch: {}. The "
              "limit for roll and pitch applies to deviations, which an error common to all readings does not change.",
              format_number(v.align_s), format_number(v.heading_limit_deg), format_number(v.level_limit_deg),
              in_words(to_string(v.verdict)))}));
}

std::string without_hash(std::string text, const std::string& hash) {
  for (std::size_t at = 0; (at = text.find(hash, at)) != std::string::npos;) text.erase(at, hash.size());
  return text;
}

constexpr std::string_view before_hash = "<p class=\"hash\">hash ", after_hash = "</p>\n</body></html>\n";

}  // namespace

double UncertaintyBudget::expanded() const {
  const double of_fit = std::hypot(estimate, alias.value_or(0.0));
  return 2.0 * std::hypot(std::hypot(of_fit, gravity), std::hypot(latitude, repeatability.value_or(0.0)));
}

UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, std::size_t parameter, const Parties& parties) {
  const ParameterFile& file = runs.back();
  const auto at = Eigen::Index(parameter);
  const double value = file.parameters[at];
  UncertaintyBudget budget;
  const double sigma = file.sigma[parameter].value_or(0.0);
  const std::string diagnosis = of_record(file, "verdict.diagnosis", "");
  const std::string* const alias = find_further(file, alias_key_prefix + parameter_key(parameter));
  if (diagnosis == "clean" || diagnosis == "extended" || alias)
    budget.alias = std::min(sigma, alias ? parse_number<double>(*alias).value_or(0.0) : 0.0);
  budget.estimate = std::sqrt(sigma * sigma - std::pow(budget.alias.value_or(0.0), 2));
  const bool of_accelerometer = (parameter >= 3 && parameter < 6) || parameter >= 15;
  if (of_accelerometer) budget.gravity = std::abs(value) * parties.gravity_uncertainty_mps2 / file.gravity_mps2;
  if (parameter < 3)
    budget.latitude = earth_rate_radps / radps_per_degph * parties.latitude_uncertainty_deg * rad_per_deg;
  if (runs.size() > 1) {
    std::vector<double> values;
    for (const ParameterFile& run : runs) values.push_back(run.parameters[at]);
    budget.repeatability = spread_of(values).deviation;
  }
  return budget;
}

UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, const EffectValue& effect) {
  UncertaintyBudget budget;
  budget.estimate = effect.sigma.value_or(0.0);
  std::vector<double> values;
  for (const ParameterFile& run : runs)
    for (const EffectValue& other : run.effects)
      if (other.name == effect.name && other.component == effect.component) values.push_back(other.value);
  if (effect.sigma && runs.size() > 1 && values.size() == runs.size())
    budget.repeatability = spread_of(values).deviation;
  return budget;
}

std::vector<std::string> missing_keys(const ParameterFile& file, const Parties& parties) {
  std::vector<std::string> keys;
  for (const auto& [key, value] :
       {std::pair{"laboratory.name", &parties.laboratory_name},
        std::pair{"laboratory.address", &parties.laboratory_address},
        std::pair{"laboratory.signatory", &parties.laboratory_signatory},
        std::pair{"customer.name", &parties.customer_name}, std::pair{"customer.address", &parties.customer_address}})
    if (value->empty()) keys.emplace_back(key);
  for (const auto& [key, of_run] :
       {std::pair{"record.table_id", "table.id"}, std::pair{"record.table_calibration_due", "table.calibration_due"}})
    if (find_further(file, key) == nullptr) keys.push_back(std::string(of_run) + " (when it was measured)");
  return keys;
}

std::string certificate_page(const Certificate& c) {
  const ParameterFile& f = c.file;
  const std::string serial = html_escape(f.unit_serial);
  const char* const kind = !c.specimen ? "" : f.simulated ? ": specimen, simulated data" : ": specimen";
  std::string body = c.specimen ? "<div class=\"mark\">SPECIMEN</div>\n" : "";
  body += fmt::format("<h1>Calibration certificate{}</h1>\n<p class=\"no\">No. {} / {}</p>\n", kind, serial,
                      html_escape(f.time_utc));
  if (const std::string words = not_conforming(c.conformity.verdict); !words.empty())
    body += "<p class=\"not\">" + words + "</p>\n";
  body += "<div class=\"two\">" +
          fact_section("Laboratory", {{"name", or_dash(c.parties.laboratory_name)},
                                      {"address", or_dash(c.parties.laboratory_address)},
                                      {"accreditation", or_dash(c.parties.laboratory_accreditation)}}) +
          fact_section("Customer", {{"name", or_dash(c.parties.customer_name)},
                                    {"address", or_dash(c.parties.customer_address)},
                                    {"order", or_dash(c.parties.customer_order)}}) +
          "</div>\n<div class=\"two\">";
  body +=
      fact_section("Item", {{"unit", "strapdown inertial measurement unit"},
                            {"serial number", f.unit_serial},
                            {"part, revision", of_record(f, "record.part") + ", " + of_record(f, "record.revision")}});
  body += fact_section(
              "Conditions",
              {{"measured", of_record(f, "record.began_utc", "not recorded")},
               {"evaluated", f.time_utc},
               {"operator", of_record(f, "record.operator")},
               {"temperature of the unit",
                f.reference_temperature_c ? significant(*f.reference_temperature_c, 4) + " °C (mean)" : "not measured"},
               {"ambient", of_record(f, "record.ambient")},
               {"latitude", format_number(f.latitude_deg) + "°"},
               {"gravity", format_number(f.gravity_mps2) + " m/s²"}}) +
          "</div>\n";
  body += fact_section(
      "Equipment and method",
      {{"station", of_record(f, "record.station")},
       {"table", of_record(f, "record.table_id") + ", calibration due " + of_record(f, "record.table_calibration_due") +
                     (find_further(f, "record.overdue_reason")
                          ? "; used though overdue: " + of_record(f, "record.overdue_reason")
                          : "")},
       {"method", f.method + " estimate, model " + f.model + ", sequence " + of_record(f, "record.sequence") +
                      "; w = n counts − N0 (°/h), f = a counts − A0 (g = 9.80665 m/s²)"},
       {"software", "turncal " + f.software_version},
       {"adjustment", "none: the parameters are to be loaded by the customer"}});
  Table results = result_table(c);
  const std::string left_out = drop_empty(results, 6, 1);
  body += section(
      "Results",
      html(results) + effect_table(c) +
          html(Paragraph{
              "Expanded uncertainty U = k u with the coverage factor k = 2: a coverage probability of about 95 % for a "
              "normal distribution. u combines the columns to the right of U (standard uncertainties)" +
              (left_out.empty() ? "" : "; no uncertainty is stated or added for: " + left_out) +
              ". The table's angles are not taken as truth and add nothing; the given heading enters in second order. "
              "Confounding: the spread over effects that the recording cannot tell from a parameter or from each "
              "other, and "
              "over those that may be missing (a dash where no diagnosis was made). Effects beyond the parameters: " +
              effects_found(f)}));
  if (c.verification) body += north_section(*c.verification);
  const VerdictReport& conformity = c.conformity;
  const std::string verdict = in_words(to_string(conformity.verdict));
  const std::string beside = judged_beside(c), &reason = conformity.reason;
  body += fact_section(
      "Conformity",
      {{"verdict", verdict + (reason.empty() ? "" : ": " + reason)},
       {"decision rule", !conformity.rule.empty() ? conformity.rule + "; U: that of the results above"
                         : c.verification
                             ? "no limits were agreed for the parameters; those of the verification are given there"
                             : "no limits were agreed"},
       {"further limits", beside.empty() ? "none" : beside},
       {"diagnosis", "effects beyond the parameters: " + effects_found(f)}});
  const auto with_uncertainty = [](double u, const char* unit) {
    return u > 0.0 ? "standard uncertainty " + significant(u, 2) + unit : std::string("no uncertainty stated");
  };
  const std::string clock = of_record(f, "record.clock_ppm", "");
  body += fact_section(
      "Traceability",
      {{"gravity", "value of the site, " + with_uncertainty(c.parties.gravity_uncertainty_mps2, " m/s²") +
                       "; specific force is traceable to it"},
       {"latitude", "value of the site, " + with_uncertainty(c.parties.latitude_uncertainty_deg, "°") +
                        "; rates are traceable to the Earth's rate, 15.041 °/h"},
       {"time",
        "the unit's own sample clock, " + fmt::format("{:.9g} ms a sample; ", 1e3 * f.sample_period_s) +
            (clock.empty()
                 ? "not compared with another clock on record"
                 : "against the station's clock " +
                       quantity(parse_number(clock).value_or(0.0),
                                parse_number(of_record(f, "record.clock_uncertainty_ppm", "")).value_or(0.0), "ppm"))},
       {"parameter file", c.parameters_hash},
       {"recordings", join(c.recording_hashes)}});
  body +=
      "<p class=\"small\">The results relate to this item in the state in which it was calibrated. This certificate "
      "shall not be reproduced except in full.</p>\n<div class=\"sign\"><p>Issued " +
      html_escape(c.issued_utc) + "</p><p>" + html_escape(or_dash(c.parties.laboratory_signatory)) + "</p></div>\n";
  const auto page = [&](const std::string& hash) {
    return fmt::format(
        "<!doctype html>\n<html lang=\"en\"><head>{}<title>Calibration certificate {}</title>\n<style>\n{}"
        "@page {{ @bottom-left {{ content: \"{}\"; }} }}\n</style></head>\n<body>\n{}{}{}{}",
        page_head, serial, certificate_css, hash, body, before_hash, hash, after_hash);
  };
  return page(hash_of_text(page("")));
}

Result<std::string> check_certificate(std::string page, const std::string& file_name) {
  constexpr std::size_t digits = 32;
  const std::size_t at = page.rfind(before_hash);
  if (at == std::string::npos || page.size() != at + before_hash.size() + digits + after_hash.size())
    return input_error(file_name + ": expected a complete certificate, with its hash in the last line but one");
  const std::string hash = page.substr(at + before_hash.size(), digits);
  const std::string found = hash_of_text(without_hash(std::move(page), hash));
  if (found == hash) return hash;
  return input_error(file_name + ": changed after it was issued: it states hash " + hash + ", its content has " +
                     found);
}

}  // namespace turncal
