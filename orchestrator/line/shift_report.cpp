#include "orchestrator/line/shift_report.h"

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>

#include "calib/statistics/numerics.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

namespace {

// Returns a figure as an ellipsis, with the marks around it; a word is empty.
std::string masked(std::string_view word) {
  constexpr std::string_view marks = ",;:()", digits = "0123456789";
  const std::size_t begin = word.find_first_not_of('('), end = word.find_last_not_of(marks);
  if (end == word.npos || word.find_first_of(digits) == word.npos) return "";
  if (("+-." + std::string(digits)).find(word[begin]) == std::string::npos) return "";
  return std::string(word.substr(0, begin)) + "…" + std::string(word.substr(end + 1));
}

constexpr double day_s = 86400.0;

std::string words_of(const std::string& name, const RecordFilter& filter) {
  std::string text = name;
  for (const auto& [word, value] : texts_of(filter)) text += ", " + word + " " + value;
  return text;
}

ChartedQuantity charted(const std::string& key, const std::vector<AttemptRecord>& attempts,
                        const std::function<std::optional<double>(const AttemptRecord&)>& value_of) {
  ChartedQuantity quantity;
  quantity.key = key;
  quantity.unit = quantity_unit(key);
  for (const AttemptRecord& attempt : attempts) {
    const std::optional<double> value = value_of(attempt);
    if (!value || !attempt.calibration) continue;
    quantity.units.push_back(attempt.unit);
    quantity.times.push_back(attempt.time_utc);
    quantity.values.push_back(*value);
    quantity.sigmas.emplace_back();
  }
  quantity.chart = control_chart(quantity.values, quantity.limit);
  return quantity;
}

std::vector<YieldOf> yields_by(const std::vector<AttemptRecord>& all, const std::vector<AttemptRecord>& chosen,
                               const std::function<std::string(const AttemptRecord&)>& name_of) {
  std::map<std::string, YieldOf> parts;
  std::map<std::string, std::set<std::int64_t>> ids;
  for (const AttemptRecord& attempt : chosen) {
    const std::string name = name_of(attempt);
    ids[name].insert(attempt.id);
    YieldOf& part = parts[name];
    part.name = name;
    part.mean_residual += attempt.residual.value_or(0.0);
    part.calibrated += attempt.residual.has_value();
  }
  std::vector<YieldOf> list;
  for (auto& [name, part] : parts) {
    part.yield = line_yield(all, ids[name]);
    if (part.calibrated > 0) part.mean_residual /= double(part.calibrated);
    list.push_back(part);
  }
  return list;
}

std::vector<YieldOf> yield_over_time(const std::vector<AttemptRecord>& all, const std::vector<AttemptRecord>& chosen) {
  constexpr std::size_t most = 31, month = 7, day = 10, hour = 13;
  const auto of = [&](std::size_t length) {
    return yields_by(all, chosen, [length](const AttemptRecord& a) { return a.time_utc.substr(0, length); });
  };
  std::vector<YieldOf> days = of(day);
  return days.size() < 2 ? of(hour) : days.size() > most ? of(month) : days;
}

struct Moments {
  double mean = 0.0, squares = 0.0, variance_of_mean = 0.0;  // squares: sum of (value - mean)^2
};

Moments moments(const std::vector<double>& values) {
  const auto n = double(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0.0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, squares, squares / (n - 1.0) / n};
}

struct AtStation {
  std::map<std::string, std::vector<double>> by_unit;
  std::vector<double> days, values;
};

std::vector<double> unit_means(const AtStation& at) {
  std::vector<double> means;
  for (const auto& [unit, values] : at.by_unit) means.push_back(moments(values).mean);
  return means;
}

// Returns the slope per day and its variance.
std::optional<std::pair<double, double>> slope(const AtStation& at) {
  const std::size_t n = at.days.size();
  if (n < least_units) return std::nullopt;
  const Moments t = moments(at.days), y = moments(at.values);
  if (std::sqrt(t.squares / double(n)) < 1.0) return std::nullopt;
  double ty = 0.0;
  for (std::size_t i = 0; i < n; ++i) ty += (at.days[i] - t.mean) * (at.values[i] - y.mean);
  const double k = ty / t.squares, residual_square = std::max(0.0, y.squares - k * ty);
  return std::pair(k, residual_square / double(n - 2) / t.squares);
}

std::optional<StationDifference> compare(const AtStation& a, const AtStation& b) {
  StationDifference d;
  std::vector<double> differences;
  for (const auto& [unit, values] : a.by_unit) {
    const auto other = b.by_unit.find(unit);
    if (other == b.by_unit.end()) continue;
    differences.push_back(moments(other->second).mean - moments(values).mean);
  }
  if (differences.size() >= least_units) {
    const Moments m = moments(differences);
    d.of_the_same_units = true;
    d.count_a = d.count_b = differences.size();
    d.difference = m.mean;
    d.sigma = std::sqrt(m.variance_of_mean);
  } else {
    const std::vector<double> of_a = unit_means(a), of_b = unit_means(b);
    d.count_a = of_a.size();
    d.count_b = of_b.size();
    if (d.count_a < least_units || d.count_b < least_units) return std::nullopt;
    const Moments at_a = moments(of_a), at_b = moments(of_b);
    d.difference = at_b.mean - at_a.mean;
    d.sigma = std::sqrt(at_a.variance_of_mean + at_b.variance_of_mean);
  }
  const auto slope_a = slope(a), slope_b = slope(b);
  constexpr double month_days = 30.0;
  if (slope_a && slope_b) {
    d.drift = month_days * (slope_b->first - slope_a->first);
    d.drift_sigma = month_days * std::sqrt(slope_a->second + slope_b->second);
  }
  return d;
}

}  // namespace

std::pair<double, double> Share::interval() const {
  if (all == 0) return {0.0, 1.0};
  const auto n = double(all);
  const double z2 = normal_95 * normal_95, middle = (value() + z2 / (2.0 * n)) / (1.0 + z2 / n);
  const double half = normal_95 / (1.0 + z2 / n) * std::sqrt(value() * (1.0 - value()) / n + z2 / (4.0 * n * n));
  return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

AttemptKind kind_of(const AttemptRecord& attempt) {
  if (attempt.outcome == "dropped") return AttemptKind::failed;
  const std::optional<UnitVerdict> verdict = enum_from<UnitVerdict>(attempt.outcome);
  if (!verdict || *verdict == UnitVerdict::not_judged) return AttemptKind::says_nothing;
  return is_accepted(*verdict) ? AttemptKind::passed : AttemptKind::failed;
}

double hours_of(const AttemptRecord& attempt) {
  const std::optional<double> began = parse_utc(attempt.began_utc), ended = parse_utc(attempt.time_utc);
  const auto units = double(std::max<std::int64_t>(1, attempt.units));  // none: refused before there was a run
  return began && ended ? std::max(0.0, (*ended - *began) / 3600.0 / units) : 0.0;
}

std::string reason_class(const AttemptRecord& attempt) {
  std::string text, first = attempt.reason.substr(0, attempt.reason.find(';'));
  const std::size_t place = first.find("step ");
  if (place == 0 || first.substr(0, place).ends_with(" dropped out at "))
    first.erase(0, first.find(": ", place) + 2);  // the place of the run is not a reason
  // A verdict names the quantity that decided, and then its figures; other reasons are sentences with figures in them.
  const bool judged = enum_from<UnitVerdict>(attempt.outcome).has_value();
  const std::size_t figures = judged ? first.find(" = ") : first.npos;
  for (const std::string_view word : split(std::string_view(first).substr(0, figures), ' ')) {
    const std::string figure = masked(word);
    if (word.empty() || (judged && !figure.empty())) break;
    if (word.starts_with(attempt.unit)) continue;
    text += (text.empty() ? "" : " ") + (figure.empty() ? std::string(word) : figure);
  }
  while (!text.empty() && std::string_view(",:( ").find(text.back()) != std::string_view::npos) text.pop_back();
  return in_words(attempt.outcome) + (text.empty() ? "" : ": " + text);
}

LineYield line_yield(const std::vector<AttemptRecord>& all, const std::set<std::int64_t>& chosen) {
  LineYield line;
  struct Visit {
    bool counts = false, passed = false;
  };
  std::map<std::string, Visit> open;  // open visit of each unit
  std::map<std::string, LossReason> reasons;
  std::set<std::string> units;
  const auto close = [&line](const Visit& visit) {
    line.final_pass.all += visit.counts;
    line.final_pass.part += visit.counts && visit.passed;
  };
  std::size_t lost = 0;
  for (const AttemptRecord& attempt : all) {
    const bool reported = chosen.contains(attempt.id);
    const AttemptKind kind = kind_of(attempt);
    if (reported) {
      ++line.attempts;
      units.insert(attempt.unit);
      if (attempt.outcome == outcome_running) ++line.running;
      const double hours = hours_of(attempt);
      line.hours += hours;
      const bool neither = attempt.outcome == outcome_running || attempt.outcome == "captured" ||
                           attempt.outcome == to_string(UnitVerdict::not_judged);
      if (kind != AttemptKind::passed && !neither) {
        LossReason& reason = reasons[reason_class(attempt)];
        ++reason.attempts;
        reason.hours += hours;
        reason.last_unit = attempt.unit;
        line.hours_lost += hours;
        ++lost;
      }
    }
    if (kind == AttemptKind::says_nothing) continue;
    const auto [found, begins] = open.try_emplace(attempt.unit, Visit{.counts = reported});
    Visit& visit = found->second;
    visit.passed = kind == AttemptKind::passed;
    line.first_pass.all += begins && reported;
    line.first_pass.part += begins && reported && visit.passed;
    if (visit.passed) {
      close(visit);
      open.erase(found);
    }
  }
  for (const auto& [unit, visit] : open) close(visit);
  line.units = units.size();
  for (auto& [name, reason] : reasons) {
    reason.reason = name;
    line.reasons.push_back(reason);
  }
  std::ranges::stable_sort(line.reasons,
                           [](const LossReason& a, const LossReason& b) { return a.attempts > b.attempts; });
  double cumulated = 0.0;
  for (LossReason& reason : line.reasons) {
    reason.share = double(reason.attempts) / double(lost);
    reason.cumulated = cumulated += reason.share;
  }
  return line;
}

// ---- the report ----

Result<ShiftReport> shift_report(const ResultsDatabase& database, const std::string& name, const RecordFilter& filter,
                                 bool simulated) {
  TRY(check(filter));
  TRY(database.check_known(filter));
  std::vector<AttemptRecord> all = TRY(database.attempts({}));
  ShiftReport report;
  report.attempts = TRY(database.attempts(filter));
  report.calibrations = TRY(database.list(filter, ""));
  report.source = words_of(name, filter);
  report.simulated = simulated;
  const auto of_the_other_kind = [simulated](const auto& row) { return row.simulated != simulated; };
  std::erase_if(all, of_the_other_kind);
  report.of_the_other_kind = std::erase_if(report.attempts, of_the_other_kind);
  std::erase_if(report.calibrations, of_the_other_kind);
  report.damaged = std::erase_if(report.calibrations, [](const StoredCalibration& c) { return !c.defect.empty(); });
  const auto whole = yields_by(all, report.attempts, [](const AttemptRecord&) { return std::string("all"); });
  if (!whole.empty()) report.whole = whole.front();
  report.stations = yields_by(all, report.attempts, [](const AttemptRecord& attempt) { return attempt.station; });
  report.periods = yield_over_time(all, report.attempts);
  report.charts.push_back(charted("residual", report.attempts, [](const AttemptRecord& a) { return a.residual; }));
  report.charts.push_back(
      charted("temperature", report.attempts, [](const AttemptRecord& a) { return a.temperature_max_c; }));
  report.charts.push_back(
      charted("hours", report.attempts, [](const AttemptRecord& a) { return std::optional(hours_of(a)); }));
  for (const int k : free_parameters())
    report.charts.push_back(parameter_history(report.calibrations, parameter_key(k)).charted);
  report.turn_on = repeatability(report.calibrations, 0.0, turn_on_days);
  report.month = repeatability(report.calibrations, month_from_days, month_to_days);
  report.differences = station_differences(report.calibrations);
  return report;
}

std::vector<ChartSignal> signals_of(const std::vector<ChartedQuantity>& charts) {
  std::vector<ChartSignal> found;
  for (const ChartedQuantity& chart : charts) {
    std::map<std::size_t, std::size_t> last;  // point of each rule's last signal
    for (const RunSignal& signal : chart.chart.signals) {
      const auto before = last.find(signal.rule);
      const bool goes_on = signal.rule != 1 && before != last.end() && before->second + 1 == signal.point;
      last[signal.rule] = signal.point;
      if (!goes_on) found.push_back({&chart, signal});
    }
  }
  std::ranges::stable_sort(found, [](const ChartSignal& a, const ChartSignal& b) {
    return a.chart->times[a.signal.point] < b.chart->times[b.signal.point];
  });
  return found;
}

std::optional<double> Repeatability::of_unit() const {
  const double left = spread * spread - calibration_sigma * calibration_sigma;
  return left > 0.0 ? std::optional(std::sqrt(left)) : std::nullopt;
}

std::vector<Repeatability> repeatability(const std::vector<StoredCalibration>& all, double from_days, double to_days) {
  std::vector<Repeatability> found;
  for (const int k : free_parameters()) {
    const auto [history, of] = parameter_history(all, parameter_key(k));
    Repeatability r{.key = history.key};
    std::map<std::string, std::size_t> before;  // last calibration by unit and station
    double squares = 0.0, variances = 0.0;
    for (std::size_t i = 0; i < of.size(); ++i) {
      const StoredCalibration& c = *of[i];
      const auto [last, first] = before.try_emplace(c.unit + "\n" + c.station, i);
      if (first) continue;
      const StoredCalibration& former = *of[last->second];
      const std::optional<double> now_s = parse_utc(c.time_utc), then_s = parse_utc(former.time_utc);
      const double days = now_s && then_s ? (*now_s - *then_s) / day_s : -1.0;
      if (days >= from_days && days <= to_days) {
        const double d = history.values[i] - history.values[last->second];
        ++r.pairs;
        squares += d * d;
        const double a = history.sigmas[i].value_or(0.0), b = history.sigmas[last->second].value_or(0.0);
        variances += (a * a + b * b) / 2.0;
      }
      last->second = i;
    }
    if (r.pairs == 0) continue;
    const auto pairs = double(r.pairs);
    r.spread = std::sqrt(squares / pairs / 2.0);
    r.calibration_sigma = std::sqrt(variances / pairs);
    r.low = r.spread * std::sqrt(pairs / chi_square_limit(0.025, pairs));
    r.high = r.spread * std::sqrt(pairs / chi_square_limit(0.975, pairs));
    found.push_back(r);
  }
  return found;
}

std::vector<StationDifference> station_differences(const std::vector<StoredCalibration>& all) {
  std::vector<StationDifference> found;
  for (const int k : free_parameters()) {
    const auto [history, of] = parameter_history(all, parameter_key(k));
    std::map<std::string, AtStation> stations;
    for (std::size_t i = 0; i < of.size(); ++i) {
      AtStation& at = stations[of[i]->station];
      at.by_unit[of[i]->unit].push_back(history.values[i]);
      at.days.push_back(parse_utc(of[i]->time_utc).value_or(0.0) / day_s);
      at.values.push_back(history.values[i]);
    }
    for (auto a = stations.begin(); a != stations.end(); ++a) {
      for (auto b = std::next(a); b != stations.end(); ++b) {
        std::optional<StationDifference> d = compare(a->second, b->second);
        if (!d) continue;
        d->a = a->first;
        d->b = b->first;
        d->key = history.key;
        found.push_back(std::move(*d));
      }
    }
  }
  return found;
}

}  // namespace turncal
