#include "orchestrator/fleet/fleet_members.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <span>

#include "calib/fleet/fleet_prior.h"
#include "calib/model/effects.h"
#include "calib/model/limits.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"
#include "orchestrator/records/output_folder.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

namespace fs = std::filesystem;

namespace {

constexpr double day_s = 86400.0;

std::string level_of(const ParameterFile& file, const std::string& factor, const std::string& measured) {
  if (factor == "version") return file.software_version;
  if (factor == "month") return measured.substr(0, 7);
  const std::string* const value = find_further(file, "record." + factor);
  return value && !value->empty() ? *value : "?";
}

// Returns "2026-01-31" for days since 1970-01-01.
std::string date_of(double day) { return format_utc(day * day_s).substr(0, 10); }

// Receives each file that earlier calibrations have left: below a folder (of runs, or a store of `turncal recalibrate`), or in the
// rows of a results database. `where`: the file, or the database and its row.
using EachKeptFile = std::function<void(const std::string& where, const Result<std::string>& contents)>;

Status in_database(const std::string& source, const std::string& name, const EachKeptFile& each) {
  const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(source));
  const bool statistics = name == statistics_name;
  return database.each_calibration(statistics, [&](const StoredCalibration& row) {
    const std::string where = source + ": row " + std::to_string(row.id);
    if (!statistics) return each(where, row.parameter_file);
    const auto* const bytes = reinterpret_cast<const char*>(row.statistics.data());
    if (!row.statistics.empty()) each(where, std::string(bytes, row.statistics.size()));
  });
}

// Reads every file `name`, parameters.conf or statistics.tcs: below a folder in the order of paths, except in folders that begin with a dot; from a
// database the newest of each recording. Errors: an unreadable source.
Status each_kept_file(const std::string& source, const std::string& name, const EachKeptFile& each) {
  if (names_a_database(source)) return in_database(source, name, each);
  std::vector<std::string> paths;
  std::error_code error;
  for (fs::recursive_directory_iterator at(source, error), end; at != end && !error; at.increment(error))
    if (at->path().filename() == name && !at->path().parent_path().filename().string().starts_with('.'))
      paths.push_back(at->path().string());
  if (error) TRY(expect_file(source, FileKind::database));
  if (error) return input_error(source + ": cannot read: " + error.message());
  std::ranges::sort(paths);
  for (const std::string& path : paths) each(path, read_whole_file(path));
  return {};
}

}  // namespace

Result<FleetSource> read_fleet(const std::string& from, const std::vector<std::string>& factors) {
  FleetSource source;
  struct One {
    std::string time_utc;
    FleetMember member;
  };
  std::map<std::string, One> by_recording;
  bool real = false;
  const auto take = [&](const std::string& where, const Result<std::string>& bytes) {
    Result<StatisticsFile> statistics =
        bytes ? parse_statistics(std::as_bytes(std::span(*bytes)), where) : Result<StatisticsFile>(bytes.error());
    if (!statistics) {
      source.skipped.push_back(statistics.error().message);
      return;
    }
    const ParameterFile& file = statistics->file;
    (file.simulated ? source.simulated : real) = true;
    One one{file.time_utc, {}};
    const std::string* const record = find_further(file, "record.measured_utc");
    const std::string measured = record ? *record : file.time_utc;
    one.member.unit = file.unit_serial;
    for (const std::string& factor : factors) one.member.level.push_back(level_of(file, factor, measured));
    const std::optional<double> time = parse_utc(measured);
    one.member.day = time ? *time / day_s : std::numeric_limits<double>::quiet_NaN();
    one.member.statistics = std::move(statistics->statistics);
    const auto [place, is_new] = by_recording.try_emplace(file.recording_hash, std::move(one));
    if (!is_new && place->second.time_utc < one.time_utc) place->second = std::move(one);
  };
  TRY(each_kept_file(from, statistics_name, take));
  if (by_recording.empty())
    return input_error(
        from + ": expected " + std::string(statistics_name) + " of runs or of `turncal recalibrate` in it, found " +
        (source.skipped.empty() ? std::string("none") : "none that can be read: " + source.skipped.front()));
  if (source.simulated && real)
    return input_error(from + ": simulated and real units together: expected one or the other");
  double first = std::numeric_limits<double>::infinity();
  for (const auto& [hash, one] : by_recording)
    if (one.member.day < first) first = std::floor(one.member.day);
  source.first_day = std::isfinite(first) ? first : 0.0;
  std::vector<One> all;
  for (auto& [hash, one] : by_recording) all.push_back(std::move(one));
  std::ranges::stable_sort(all, [](const One& a, const One& b) { return a.member.unit < b.member.unit; });
  for (One& one : all) {
    one.member.day -= source.first_day;
    source.members.push_back(std::move(one.member));
  }
  return source;
}

// ---- earlier calibrations as a prior ----

namespace {

constexpr const char* source_key = "quality.prior.calibrations_of_others";

bool counts(const ParameterFile& file, const StoredCovariance& stored) {
  for (std::size_t k = 0; k < parameter_keys.size(); ++k)
    if (parameter_is_free[k] && !(file.sigma[k].value_or(0.0) > 0.0)) return false;
  return stored.source == std::string_view("covariance") && is_trusted(file) && !find_further(file, source_key);
}

std::string keys_of(const std::vector<int>& parameters) {
  std::string text;
  for (const int k : parameters) text += (text.empty() ? "" : " ") + parameter_key(k);
  return text;
}

// Repeats the estimate with the noise of the part as a prior. Empty: too few units report theirs, or the recording leaves directions undetermined.
std::optional<NoiseOfClass> use_noise(const FleetPrior& prior, const LoadedRecording& recording,
                                      CalibrationOutput& output) {
  if (!prior.noise || !output.fit->noise_fit || !output.fit->undetermined.empty()) return std::nullopt;
  const NoiseOfClass noise = noise_of_class(*prior.noise, *output.fit->noise_fit);
  JointResult again = estimate_with_noise(recording.data, *output.fit, noise.noise);
  if (!again.converged) return std::nullopt;
  *output.fit = std::move(again);
  return noise;
}

void describe_noise(const NoiseOfClass& noise, ParameterFile& file, std::vector<std::string>& notes) {
  constexpr const char* names[] = {"angle_random_walk", "velocity_random_walk"};
  constexpr const char* words[] = {"angle random walk", "velocity random walk"};
  for (const int k : {0, 1}) file.add_further(std::string("quality.prior.share.") + names[k], noise.share[k]);
  notes.push_back(
      fmt::format("prior: its share of the noise: angle random walk {:.0f} %, velocity random walk {:.0f} %",
                  100.0 * noise.share[0], 100.0 * noise.share[1]));
  for (const int k : noise.changed)
    notes.push_back(
        fmt::format("prior: NOT USED for the {}: it differs from the others' by {:.1f} sigma", words[k], noise.z[k]));
}

Result<std::vector<EarlierCalibration>> read_history(const PriorSource& source, const std::string& recording_hash,
                                                     bool simulated) {
  struct One {
    std::string time_utc;
    EarlierCalibration earlier;
  };
  std::map<std::string, One> by_recording;
  const auto take = [&](const std::string& where, const Result<std::string>& text) {
    const Result<ParameterFile> file = text ? parse_parameter_file(*text, where) : Result<ParameterFile>(text.error());
    if (!file || file->simulated != simulated || file->recording_hash == recording_hash) return;
    const std::string* const part = find_further(*file, "record.part");
    if (!source.part.empty() && (!part || *part != source.part)) return;
    const Result<StoredCovariance> stored = stored_covariance(*file, where);
    if (!stored || !counts(*file, *stored)) return;
    const std::string* const measured = find_further(*file, "record.measured_utc");
    One one{file->time_utc,
            {file->unit_serial, measured ? *measured : file->time_utc, file->parameters, stored->covariance, {}}};
    if (const Result<NoiseModel> noise = stored_noise(*file, where); noise && has_noise(*file))
      one.earlier.noise = *noise;
    const auto [place, is_new] = by_recording.try_emplace(file->recording_hash, one);
    if (!is_new && place->second.time_utc < one.time_utc) place->second = one;
  };
  TRY(each_kept_file(source.from, parameters_name, take));
  std::vector<EarlierCalibration> history;
  for (auto& [hash, one] : by_recording) history.push_back(std::move(one.earlier));
  return history;
}

}  // namespace

Status add_prior(const PriorSource& source, const LoadedRecording& recording, const CalibrationRequest& request,
                 CalibrationOutput& output) {
  const std::string& unit = recording.data.info.unit_serial;
  const auto history = TRY(read_history(source, recording.hash, recording.data.info.simulated));
  const std::optional<FleetPrior> prior = fleet_prior(history, unit);
  if (!prior)
    return input_error("{}: expected trusted calibrations of {} other units{}, found {} calibrations", source.from,
                       fleet_limits.least_prior_units, source.part.empty() ? "" : " of part " + source.part,
                       history.size());
  if (!output.fit) return input_error(recording.path + ": a prior: expected a recording with table angles");
  if (!output.fit->undetermined.empty()) {  // its own fit ended anywhere along the undetermined directions
    CalibrationRequest beside = request;
    beside.known = from_vector(prior->mean);
    output = TRY(calibrate_recording(recording, beside));
  }
  const std::optional<NoiseOfClass> noise = use_noise(*prior, recording, output);
  const PriorEffect effect = use_prior(*prior, *output.fit);
  ParameterFile& file = output.file;
  const std::string why_not = why_not_trusted(file);
  std::erase_if(file.further,
                [](const auto& key) { return key.first.starts_with("noise.") || key.first.starts_with("quality."); });
  describe_trust(why_not, file);
  describe_estimate(*output.fit, recording.data, false, file);
  file.add_further(source_key, double(prior->units));
  file.add_further("quality.prior.calibrations_of_unit", double(prior->own));
  if (noise) describe_noise(*noise, file, output.notes);
  if (!effect.changed.empty()) {
    file.add_further("quality.prior.not_used", keys_of(effect.changed));
    std::string line =
        std::string("prior: NOT USED: ") +
        (prior->own > 0 ? "the unit has changed since its last calibration:" : "the unit differs from the others:");
    for (const int k : effect.changed)
      line += fmt::format(" {} by {:.1f} sigma", parameter_key(k), effect.from_prior[k]);
    output.notes.push_back(line);
    return {};
  }
  std::string shares = "prior: its share of the information:";
  for (const int k : free_parameters()) {
    const double share = effect.share[k];
    file.add_further(fmt::format("quality.prior.share.{}", parameter_keys[k]), share);
    shares += fmt::format(" {} {:.0f} %", parameter_keys[k], 100.0 * share);
  }
  output.notes.push_back(fmt::format("prior: {}, {} of this one", counted(prior->units, "other unit"),
                                     counted(prior->own, "earlier calibration")));
  if (prior->own == 0 && prior->pairs < fleet_limits.least_prior_pairs)
    output.notes.push_back(
        "prior: the unit's own history is not used: too few units were calibrated twice to tell how much a unit "
        "changes");
  output.notes.push_back(shares);
  return {};
}

// ---- the diagnosis as a document and a table ----

namespace {

using namespace cell;

// Returns the unit, "ug/g^2"; for parameters that of the parameter file.
std::string unit_of_component(const std::string& component) {
  if (const EffectEntry* const entry = find_effect(component.substr(0, component.find('.'))))
    return std::string(entry->unit);
  constexpr std::string_view of_parameter = "parameter ";
  if (!component.starts_with(of_parameter)) return "";
  const std::string unit = parameter_unit(component.substr(of_parameter.size()), IncrementKind::physical);
  return unit == "-" ? "" : unit;
}

constexpr std::size_t most_components = 12;  // in the table of levels, the most conspicuous ones
constexpr std::size_t most_levels = 12;

Cell display_unit(const std::string& component, const char* more = "") {
  return text(unit_text(unit_of_component(component)) + more);
}

Cell with_error(double value, double sigma) { return number(plus_minus(value, sigma, Alphabet::typographic), value); }

Table effect_table(const FleetDiagnosis& d, const FleetSource& source) {
  Table table{{text("common to"), name("effect"), number("value"), text("unit"), number("sigmas"), number("recordings"),
               text("since (95 %)"), wide("confounded with"), wide("what to check")}};
  for (const FleetEffect& e : d.effects) {
    const auto date = [&](double day) { return date_of(source.first_day + day); };
    const bool ramp = e.shape == FleetShape::ramp;
    const std::string since = e.shape == FleetShape::constant
                                  ? "always"
                                  : fmt::format("{}{} ({} to {})", ramp ? "growing from " : "", date(e.begin_day),
                                                date(e.begin_low), date(e.begin_high));
    table.row({text(e.factor.empty() ? "all units" : e.factor + " " + e.level), name(e.component),
               with_error(e.value, e.sigma), display_unit(e.component, ramp ? " per day" : ""),
               number(std::abs(e.z), 2), count(e.recordings), text(since), wide(join(e.rivals)),
               wide(e.factor == "station" ? cause_at_station(e.component) : "")},
              Table::Emphasis::hit);
  }
  return table;
}

Table unit_table(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  Table table{{name("unit")}};
  for (const std::string& factor : factors) table.head.push_back(text(factor));
  for (const Cell& column : {name("effect"), number("value"), text("in"), number("sigmas")})
    table.head.push_back(column);
  for (const OutstandingUnit& u : d.units) {
    const FleetMember& m = source.members[u.member];
    std::vector<Cell> row = {name(m.unit)};
    for (const std::string& level : m.level) row.push_back(text(level));
    for (const Cell& column :
         {name(u.component), with_error(u.value, u.sigma), display_unit(u.component), number(std::abs(u.z), 2)})
      row.push_back(column);
    table.row(std::move(row));
  }
  return table;
}

// Returns the most conspicuous components, by level of one factor, after removing the effects found.
Table level_table(const FleetDiagnosis& d, std::size_t factor) {
  const auto worst_z = [](const ComponentSummary& c) {
    double worst = 0.0;
    for (const auto& levels : c.levels)
      for (const FleetEstimate& level : levels) worst = std::max(worst, std::abs(level.z));
    return worst;
  };
  std::vector<const ComponentSummary*> chosen;
  for (const ComponentSummary& c : d.components) chosen.push_back(&c);
  std::ranges::stable_sort(chosen, [&](const auto* a, const auto* b) { return worst_z(*a) > worst_z(*b); });
  chosen.resize(std::min(chosen.size(), most_components));
  Table table{
      {name("effect"), text("unit"), number("one recording"), number("scatter of units"), number("scatter of levels")}};
  const std::size_t levels = std::min(d.levels[factor].size(), most_levels);
  for (std::size_t l = 0; l < levels; ++l) table.head.push_back(number(d.levels[factor][l]));
  for (const ComponentSummary* c : chosen) {
    const std::string key = c->component.substr(c->component.find(' ') + 1), meaning = quantity_name(key);
    std::vector<Cell> row = {name(c->component + (meaning == key ? "" : ", " + meaning)), display_unit(c->component),
                             number(c->one_unit, 2), number(c->unit_scatter, 2),
                             c->factor_scatter.empty() ? number("") : number(c->factor_scatter[factor], 2)};
    for (std::size_t l = 0; l < levels; ++l) {
      const FleetEstimate& level = c->levels[factor][l];
      row.push_back(number(significant(level.value, 2) + " (" + significant(level.z, 2) + ")", level.value));
    }
    table.row(std::move(row));
  }
  return table;
}

// Draws one panel for each level, with one point for each recording.
Figure figure_of(const FleetEffect& effect, const FleetSource& source, const std::vector<std::string>& factors,
                 const FleetDiagnosis& d, std::size_t place_in_list) {
  const auto place = std::ranges::find(factors, effect.factor.empty() ? factors.front() : effect.factor);
  const auto f = std::size_t(place - factors.begin());
  Figure figure = small_panels("effect" + std::to_string(place_in_list),
                               effect.component + ", " + unit_of_component(effect.component),
                               "A point is a recording, over days since " + date_of(source.first_day) +
                                   "; the line is the effect that was found.");
  double last = 0.0;
  std::vector<double> sizes;
  std::vector<std::vector<std::pair<double, double>>> points(d.levels[f].size());
  for (const FleetMember& m : source.members) {
    const auto column = std::ranges::find(m.statistics.columns, effect.component);
    if (column == m.statistics.columns.end() || !std::isfinite(m.day)) continue;
    const auto k = column - m.statistics.columns.begin();
    const double Q = double(m.statistics.Q(k, k));
    if (!(Q > 0.0)) continue;
    const auto level = std::ranges::find(d.levels[f], m.level[f]) - d.levels[f].begin();
    points[std::size_t(level)].emplace_back(m.day, m.statistics.s[k] / Q);
    sizes.push_back(std::abs(m.statistics.s[k] / Q));
    last = std::max(last, m.day);
  }
  if (sizes.empty()) return figure;
  std::ranges::sort(sizes);
  const double limit = 1.3 * sizes[sizes.size() * 98 / 100];
  for (std::size_t l = 0; l < std::min(points.size(), most_levels); ++l) {
    const bool here = effect.factor.empty() || d.levels[f][l] == effect.level;
    Panel panel{.title = factors[f] + " " + d.levels[f][l], .x_label = "day", .y_limit = limit, .whole_frame = true};
    panel.series.push_back({"", Series::Style::dot, here ? Colour::before : Colour::after, points[l]});
    if (here) {
      const double begin = effect.shape == FleetShape::constant ? 0.0 : effect.begin_day;
      const double end = effect.shape == FleetShape::ramp ? effect.value * (last - begin) : effect.value;
      const double first = effect.shape == FleetShape::ramp ? 0.0 : effect.value;
      panel.series.push_back({"", Series::Style::line, Colour::neutral, {{begin, first}, {last, end}}});
    }
    figure.panels.push_back(std::move(panel));
  }
  return figure;
}

std::string head_text(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  std::string of;
  for (std::size_t f = 0; f < factors.size(); ++f) of += ", " + counted(std::ssize(d.levels[f]), factors[f]);
  std::size_t units = 0;
  for (std::size_t k = 0; k < source.members.size(); ++k)
    units += k == 0 || source.members[k].unit != source.members[k - 1].unit;
  return counted(std::ssize(source.members), "recording") + " of " + counted(units, "unit") + of +
         (source.simulated ? "; simulated" : "");
}

}  // namespace

Document fleet_document(const FleetDiagnosis& d, const FleetSource& source, const std::vector<std::string>& factors) {
  Document document{"turncal: fleet", "Fleet"};
  document.soft(head_text(d, source, factors), Scope::all);
  for (const std::string& line : source.skipped) document.soft("left out: " + line, Scope::all);
  std::set<std::string> outstanding;
  for (const OutstandingUnit& u : d.units) outstanding.insert(source.members[u.member].unit);
  const bool clean = d.effects.empty() && d.units.empty() && d.explained();
  document.add(
      Paragraph{clean ? fmt::format("Clean: no common effect found in {} tests, and no unit stands out.", d.tests)
                      : fmt::format("Found: effects common to several units: {}; units that stand out: {}.",
                                    d.effects.size(), outstanding.size()),
                clean ? "verdict clean" : "verdict extended"},
      Scope::page);
  document.section("common", "Common to several units");
  if (d.effects.empty())
    document.text(fmt::format("No common effect found in {} tests.", d.tests));
  else
    document.add(effect_table(d, source));
  if (!d.explained())
    document.text("NOT EXPLAINED: the residual at " + d.lack_of_fit_at + " is more than noise, p = 10^" +
                  significant(d.lack_of_fit_log10_p, 2) + ".");
  for (std::size_t k = 0; k < d.effects.size(); ++k) {
    const Figure figure = figure_of(d.effects[k], source, factors, d, k + 1);
    if (figure.panels.empty()) continue;
    document.add(Heading{3, "", figure.label}, Scope::page);
    document.figure(figure);
  }
  for (std::size_t f = 0; f < factors.size() && !d.components.empty(); ++f) {
    document.add(Heading{2, "by-" + factors[f], "By " + factors[f] + ": remaining effects"}, Scope::page);
    document.add(level_table(d, f), Scope::page);
    document.soft("In brackets: the value in its own sigmas; of parameters, the difference from the other levels.");
  }
  document.section("units", "Units that stand out");
  if (d.units.empty())
    document.text("None.");
  else
    document.add(unit_table(d, source, factors));
  return document;
}

DataTable table_of(const FleetDiagnosis& d, const FleetSource& source) {
  DataTable table({"what", "level", "component", "shape", "value", "sigma", "unit", "z", "begin", "begin_low",
                   "begin_high", "recordings", "rivals"});
  for (const FleetEffect& e : d.effects) {
    const auto date = [&](double day) {
      return e.shape == FleetShape::constant ? DataCell() : DataCell(date_of(source.first_day + day));
    };
    table.row({e.factor.empty() ? "all" : e.factor, e.level, e.component, to_string(e.shape), e.value, e.sigma,
               unit_of_component(e.component), e.z, date(e.begin_day), date(e.begin_low), date(e.begin_high),
               e.recordings, join(e.rivals, "; ")});
  }
  for (const OutstandingUnit& u : d.units)
    table.row({"unit",
               source.members[u.member].unit,
               u.component,
               to_string(FleetShape::constant),
               u.value,
               u.sigma,
               unit_of_component(u.component),
               u.z,
               {},
               {},
               {},
               1,
               ""});
  return table;
}

}  // namespace turncal
