#include "orchestrator/line/line_yield.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "calib/statistics/distributions.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

namespace {

bool is_figure(std::string_view word) {
  while (!word.empty() && std::string_view(",;:()").find(word.back()) != std::string_view::npos) word.remove_suffix(1);
  while (!word.empty() && word.front() == '(') word.remove_prefix(1);
  return !word.empty() && std::string_view("+-.0123456789").find(word.front()) != std::string_view::npos &&
         word.find_first_of("0123456789") != std::string_view::npos;
}

}  // namespace

std::pair<double, double> Share::interval() const {
  if (all == 0) return {0.0, 1.0};
  const auto n = static_cast<double>(all);
  const double z2 = normal_95 * normal_95, middle = (value() + z2 / (2.0 * n)) / (1.0 + z2 / n);
  const double half = normal_95 / (1.0 + z2 / n) * std::sqrt(value() * (1.0 - value()) / n + z2 / (4.0 * n * n));
  return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

AttemptKind kind_of(const AttemptRecord& attempt) {
  if (attempt.outcome == "dropped") return AttemptKind::failed;
  const std::optional<UnitVerdict> verdict = verdict_from(attempt.outcome);
  if (!verdict || *verdict == UnitVerdict::not_judged) return AttemptKind::says_nothing;
  return is_accepted(*verdict) ? AttemptKind::passed : AttemptKind::failed;
}

double hours_of(const AttemptRecord& attempt) {
  const std::optional<double> began = parse_utc(attempt.began_utc), ended = parse_utc(attempt.time_utc);
  return began && ended ? std::max(0.0, (*ended - *began) / 3600.0) : 0.0;
}

std::string reason_class(const AttemptRecord& attempt) {
  std::string text;
  const std::string first = attempt.reason.substr(0, attempt.reason.find(';'));
  const std::size_t figures = first.find(" = ");
  for (const std::string_view word : split(std::string_view(first).substr(0, figures), ' ')) {
    if (word.empty() || is_figure(word)) break;
    if (word.starts_with(attempt.unit)) continue;
    text += (text.empty() ? "" : " ") + std::string(word);
  }
  while (!text.empty() && std::string_view(",:( ").find(text.back()) != std::string_view::npos) text.pop_back();
  return in_words(attempt.outcome) + (text.empty() ? "" : ": " + text);
}

LineYield line_yield(const std::vector<AttemptRecord>& all, const std::set<std::int64_t>& chosen) {
  LineYield line;
  struct Visit {
    bool counts = false, passed = false;
  };
  std::map<std::string, Visit> open;  // by unit: the visit that goes on
  std::map<std::string, LossReason> reasons;
  std::set<std::string> units;
  const auto close = [&line](const Visit& visit) {
    if (!visit.counts) return;
    ++line.final_pass.all;
    if (visit.passed) ++line.final_pass.part;
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
    const auto found = open.find(attempt.unit);
    const bool begins = found == open.end();
    Visit& visit = begins ? open[attempt.unit] : found->second;
    if (begins) visit.counts = reported;
    visit.passed = kind == AttemptKind::passed;
    if (begins && reported) {
      ++line.first_pass.all;
      if (visit.passed) ++line.first_pass.part;
    }
    if (visit.passed) {
      close(visit);
      open.erase(attempt.unit);
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
    reason.share = static_cast<double>(reason.attempts) / static_cast<double>(lost);
    reason.cumulated = cumulated += reason.share;
  }
  return line;
}

}  // namespace turncal
