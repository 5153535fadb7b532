#include "orchestrator/station/verdict.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();

// Returns the distance to the nearer limit, negative outside.
double margin_to(const Limit& limit, double value) {
  return std::min(limit.min ? value - *limit.min : infinite, limit.max ? *limit.max - value : infinite);
}

std::string number(std::optional<double> value) { return value ? format_number(*value) : "none"; }

void judge_into(VerdictReport& report, std::string key, std::optional<double> value, std::optional<double> sigma,
                const Limit& limit, double guard_factor) {
  if (!limit.min && !limit.max) return;
  JudgedValue judged{std::move(key), value, limit, 2.0 * guard_factor * sigma.value_or(0.0), UnitVerdict::fail};
  if (value) judged.verdict = judge_value(*value, sigma, limit, guard_factor);
  report.verdict = std::max(report.verdict, judged.verdict);
  report.values.push_back(std::move(judged));
}

// Returns "a" or "a (and 2 more)". REQUIRES lines >= 1.
std::string and_more(const std::string& line, std::size_t lines) {
  return lines > 1 ? line + " (and " + std::to_string(lines - 1) + " more)" : line;
}

// "pass, limits -0.01 .. none, guard band 0.002"
std::string judgement_text(const JudgedValue& judged) {
  return std::string(to_string(judged.verdict)) + ", limits " + number(judged.limit.min) + " .. " +
         number(judged.limit.max) + ", guard band " + format_number(judged.guard_band);
}

bool read_judgement(const std::string& text, JudgedValue& judged) {
  const std::vector<std::string_view> parts = split(text, ',');
  const std::optional<UnitVerdict> verdict = enum_from<UnitVerdict>(parts[0]);
  constexpr std::string_view before_limits = "limits ", between_limits = " .. ", before_band = "guard band ";
  if (parts.size() != 3 || !verdict || !parts[1].starts_with(before_limits) || !parts[2].starts_with(before_band))
    return false;
  const std::string_view limits = parts[1].substr(before_limits.size());
  const std::size_t gap = limits.find(between_limits);
  const std::optional<double> band = parse_number(parts[2].substr(before_band.size()));
  if (gap == std::string_view::npos || !band) return false;
  judged.limit = {parse_number(limits.substr(0, gap)), parse_number(limits.substr(gap + between_limits.size()))};
  judged.verdict = *verdict;
  judged.guard_band = *band;
  return judgement_text(judged) == text;
}

// Returns the sigma at which the guard band ends at the nearer limit.
double clear_of(const Limit& limit, double guard_factor, double value) {
  if (!limit.min && !limit.max) return infinite;
  const double margin = margin_to(limit, value);
  if (margin < 0.0) return 0.0;
  return guard_factor > 0.0 ? margin / (2.0 * guard_factor) : infinite;
}

void take_in(UnitVerdict found, const std::string& why, VerdictReport& report) {
  report.reason += (report.reason.empty() ? "" : "; ") + why;
  if (found != UnitVerdict::pass) report.verdict = std::max(report.verdict, found);
}

}  // namespace

std::optional<double> residual_of(const ParameterFile& file) {
  const std::string* const value = find_further(file, "quality.normalised_rms");
  return value ? parse_number(*value) : std::nullopt;
}

Field verdict_field(const std::string& key, UnitVerdict& verdict) {
  return chosen(key, verdict, {enum_words<UnitVerdict>.begin(), enum_words<UnitVerdict>.end()}, "a verdict");
}

Fields fields_of(VerdictReport& report) {
  return {verdict_field("result", report.verdict),
          {"rule", &report.rule},
          {"diagnosis", &report.diagnosis},
          {"verification", &report.verification},
          {"reason", &report.reason}};
}

bool VerdictLimits::any() const {
  const auto set = [](const Limit& limit) { return limit.min || limit.max; };
  return std::ranges::any_of(parameter, set) || set(temperature_c) || residual_max ||
         std::ranges::any_of(sigma_max, [](const auto& limit) { return limit.has_value(); });
}

VerdictLimits read_limits(KeyValueFile& file) {
  VerdictLimits limits;
  KeyTable keys(file);
  const auto read = [&file, &keys](const std::string& key, Limit& limit, NumberRange range) {
    keys.number(key + ".min", limit.min, range);
    keys.number(key + ".max", limit.max, range);
    if (limit.min && limit.max && !(*limit.min < *limit.max))
      file.reject(key + ".min", "a number below " + key + ".max (" + format_number(*limit.max) + ")");
  };
  for (const int i : free_parameters()) {  // a limit on the others, 0 by the choice of the body frame, is a mistake
    const std::string key = "limit." + parameter_key(i);
    read(key, limits.parameter[i], between(-limit_range.max, limit_range.max));
    keys.number(key + ".sigma_max", limits.sigma_max[i], limit_range);
  }
  keys.number("limit.residual_max", limits.residual_max, limit_range);
  read("limit.temperature_c", limits.temperature_c, between(-273.15, 500.0));
  keys.number("limit.heading_deg", limits.heading_deg, between(1e-6, 180.0));
  keys.number("limit.level_deg", limits.level_deg, between(1e-6, 180.0));
  keys.number("limit.guard_factor", limits.guard_factor, zero_or(0.001, 10.0));
  return limits;
}

UnitVerdict judge_value(double value, std::optional<double> sigma, const Limit& limit, double guard_factor) {
  if (!std::isfinite(value) || (sigma && !std::isfinite(*sigma))) return UnitVerdict::fail;
  const double margin = margin_to(limit, value);
  if (!sigma) return margin >= 0.0 ? UnitVerdict::conditional_pass : UnitVerdict::fail;
  const double guard_band = 2.0 * guard_factor * *sigma;
  if (margin >= guard_band) return UnitVerdict::pass;
  if (margin >= 0.0) return UnitVerdict::conditional_pass;
  return margin >= -guard_band ? UnitVerdict::conditional_fail : UnitVerdict::fail;
}

VerdictReport judge(const ParameterFile& file, const Limit& temperature_range_c, const VerdictLimits& limits,
                    const std::optional<ClockLimit>& clock) {
  VerdictReport report;
  if (!limits.any()) return report;
  report.rule = "ILAC-G8:09/2019 4.2.3, U = 2 sigma, guard band " + format_number(limits.guard_factor) + " U";
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    const std::string key(parameter_keys[i]);
    judge_into(report, key, file.parameters[Eigen::Index(i)], file.sigma[i], limits.parameter[i], limits.guard_factor);
    judge_into(report, "sigma." + key, file.sigma[i], 0.0, {std::nullopt, limits.sigma_max[i]}, 0.0);
  }
  judge_into(report, "residual", residual_of(file), 0.0, {std::nullopt, limits.residual_max}, 0.0);
  if (limits.temperature_c.min || limits.temperature_c.max) {
    judge_into(report, "temperature_c.min", temperature_range_c.min, 0.0, limits.temperature_c, 0.0);
    judge_into(report, "temperature_c.max", temperature_range_c.max, 0.0, limits.temperature_c, 0.0);
  }
  if (clock)
    judge_into(report, "clock_ppm", clock->clock.ppm, clock->clock.uncertainty_ppm, {-clock->max_ppm, clock->max_ppm},
               limits.guard_factor);
  if (const std::vector<std::string> lines = judged_lines(report); !lines.empty()) {
    const auto worst = std::ranges::find(report.values, report.verdict, &JudgedValue::verdict);
    report.reason = and_more(judged_words(*worst), lines.size());
  }
  return report;
}

DiagnosisPolicy read_diagnosis_policy(KeyValueFile& file) {
  DiagnosisPolicy policy;
  if (file.has("diagnosis.extended")) {
    const std::string word = file.one_of("diagnosis.extended", {"pass", "hold", "fail"});
    policy.extended = word == "pass" ? UnitVerdict::pass : word == "fail" ? UnitVerdict::fail : UnitVerdict::hold;
  }
  KeyTable(file).chosen("diagnosis.parameters", policy.load_extended, {"base", "extended"});
  return policy;
}

void judge_diagnosis(const std::string& diagnosis, const std::string& finding, const std::string& distrust,
                     const DiagnosisPolicy& policy, VerdictReport& report) {
  report.diagnosis = diagnosis;
  if (diagnosis != "clean" && diagnosis != "not_made")
    take_in(diagnosis == "extended" ? policy.extended : UnitVerdict::hold,
            "diagnosis " + in_words(diagnosis) + (finding.empty() ? "" : ": " + finding), report);
  if (!distrust.empty()) take_in(UnitVerdict::hold, "not trusted: " + distrust, report);
}

void judge_verification(UnitVerdict found, const std::string& words, const std::string& reason, VerdictReport& report) {
  report.verification = std::string(to_string(found)) + ": " + words;
  report.verdict = std::max(report.verdict, found);
  if (found != UnitVerdict::pass && !reason.empty()) take_in(found, "verification: " + reason, report);
}

void add_verdict(const VerdictReport& report, ParameterFile& file) {
  const auto add = [&file](const std::string& key, const std::string& value) {
    if (find_further(file, key) == nullptr && is_plain_text(value)) file.add_further(key, value);
  };
  if (report.verdict == UnitVerdict::not_judged && report.diagnosis == "not_made") return;
  add("verdict.result", std::string(to_string(report.verdict)));
  add("verdict.reason", report.reason);
  add("verdict.diagnosis", report.diagnosis);
  add("verdict.rule", report.rule);
  add("verdict.verification", report.verification);
  for (const JudgedValue& judged : report.values) add("verdict." + judged.key, judgement_text(judged));
}

std::optional<JudgedValue> recorded_judgement(const ParameterFile& file, const std::string& key) {
  const std::string* const text = find_further(file, "verdict." + key);
  JudgedValue judged{.key = key, .value = std::nullopt, .limit = {}};
  return text && read_judgement(*text, judged) ? std::optional(judged) : std::nullopt;
}

Result<VerdictReport> judge_again(const ParameterFile& file, const std::array<double, parameter_count>& sigma) {
  const auto place = [](std::string_view key) {
    return std::size_t(std::ranges::find(parameter_keys, key) - parameter_keys.begin());
  };
  VerdictReport report, worse;
  const Fields words = fields_of(report);
  for (const auto& [name, text] : file.further) {
    if (!name.starts_with("verdict.")) continue;
    const std::string key = name.substr(8);
    const auto word = std::ranges::find(words, key, &Field::key);
    if (word != words.end()) {
      static_cast<void>(set_text(*word, text));
      continue;
    }
    std::optional<JudgedValue> judged = recorded_judgement(file, key);
    if (!judged)
      return input_error("key 'verdict." + key + "' = " + turncal::quoted(text) +
                         ": expected a verdict, its limits and its guard band");
    // Judgements of sigmas, and of values other than parameters, are kept as they are.
    if (key == "residual") judged->value = residual_of(file);
    if (key.starts_with("sigma.") && place(key.substr(6)) < parameter_count)
      judged->value = file.sigma[place(key.substr(6))];
    if (const std::size_t i = place(key); i < parameter_count) {
      const double value = file.parameters[Eigen::Index(i)];
      judged->value = value;
      if (const double own = file.sigma[i].value_or(0.0); own > 0.0) {
        const double guard_factor = judged->guard_band / (2.0 * own);
        judged->guard_band = 2.0 * guard_factor * sigma[i];
        const UnitVerdict again = judge_value(value, sigma[i], judged->limit, guard_factor);
        if (again > judged->verdict) {
          judged->verdict = again;
          worse.values.push_back(*judged);
        }
      }
    }
    report.values.push_back(std::move(*judged));
  }
  for (const JudgedValue& judged : report.values) report.verdict = std::max(report.verdict, judged.verdict);
  if (const std::vector<std::string> lines = judged_lines(worse); !lines.empty())
    report.reason += (report.reason.empty() ? "" : "; ") + and_more(judged_words(worse.values.front()), lines.size());
  return report;
}

std::string judged_words(const JudgedValue& judged) {
  const std::string name = quantity_name(judged.key), unit = quantity_unit(judged.key);
  const std::string_view key = std::string_view(judged.key).substr(judged.key.starts_with("sigma.") ? 6 : 0);
  const bool has_key = std::ranges::find(parameter_keys, key) != parameter_keys.end();
  return name + (has_key ? " (" + std::string(key) + ") " : " ") +
         (judged.value ? value_with_sigma(*judged.value,
                                          judged.guard_band > 0.0 ? judged.guard_band : 0.01 * std::abs(*judged.value))
                       : "not known") +
         (unit.empty() ? ", " : " " + unit + ", ") + limits_words(judged.limit) +
         (judged.guard_band > 0.0 ? ", guard band " + significant(judged.guard_band, 2) : "");
}

std::string limits_words(const Limit& limit) {
  if (limit.min && limit.max) return "limits " + number(limit.min) + " .. " + number(limit.max);
  return limit.min ? "at least " + number(limit.min) : "at most " + number(limit.max);
}

std::vector<std::string> judged_lines(const VerdictReport& report) {
  std::vector<std::string> lines;
  for (const JudgedValue& judged : report.values) {
    if (judged.verdict == UnitVerdict::pass) continue;
    lines.push_back(judged_words(judged) + ": " + in_words(to_string(judged.verdict)));
  }
  return lines;
}

StopSigmas read_stop_sigmas(KeyValueFile& file) {
  StopSigmas stop{};
  KeyTable keys(file);
  for (const int i : free_parameters()) keys.number("stop.sigma." + parameter_key(i), stop[i], limit_range);
  return stop;
}

bool says_when(const StopSigmas& stop, const VerdictLimits& limits) {
  for (std::size_t i = 0; i < parameter_count; ++i)
    if (stop[i] || limits.sigma_max[i] || limits.parameter[i].min || limits.parameter[i].max) return true;
  return false;
}

double NeededSigma::ratio() const { return needed > 0.0 ? sigma / needed : infinite; }

std::vector<NeededSigma> needed_sigmas(const ParameterFile& file, const StopSigmas& stop, const VerdictLimits& limits) {
  std::vector<NeededSigma> sigmas;
  for (const int i : free_parameters()) {
    const double value = file.parameters(i);
    const double needed = std::min({stop[i].value_or(infinite), limits.sigma_max[i].value_or(infinite),
                                    clear_of(limits.parameter[i], limits.guard_factor, value)});
    if (needed < infinite) sigmas.push_back({std::size_t(i), file.sigma[i].value_or(infinite), needed});
  }
  return sigmas;
}

}  // namespace turncal
