#include "orchestrator/records/unit_queue.h"

#include <algorithm>

#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {

bool holds(const std::vector<std::string>& list, const std::string& unit) {
  return std::ranges::find(list, unit) != list.end();
}

namespace {

constexpr const char* again_outcome = "again";

std::string state_path(const std::string& path) { return path + ".state"; }

// Removes a comment, which begins the line or follows a blank: "SN#3" is not unit SN.
std::string serial_in(std::string_view line) {
  for (std::size_t mark = 0; (mark = line.find('#', mark)) != std::string_view::npos; ++mark)
    if (mark == 0 || line[mark - 1] == ' ' || line[mark - 1] == '\t') line = line.substr(0, mark);
  return std::string(trimmed(line));
}

Status write_outcomes(const std::string& path, const std::vector<UnitOutcome>& outcomes) {
  std::string text;
  for (const UnitOutcome& o : outcomes)
    text += o.outcome + " " + o.time_utc + " " + o.unit + (o.reason.empty() ? "" : " # " + o.reason) + "\n";
  return write_file_atomically(state_path(path), text);
}

}  // namespace

Fields fields_of(UnitOutcome& o) {
  return {{"unit", &o.unit}, {"outcome", &o.outcome}, {"time_utc", &o.time_utc}, {"reason", &o.reason}};
}

Result<std::vector<std::string>> read_queue(const std::string& path) {
  const std::string text = TRY(read_whole_file(path));
  std::vector<std::string> units;
  std::string_view remaining = text;
  for (int line = 1; !remaining.empty(); ++line) {
    const std::string unit = serial_in(next_line(remaining));
    if (unit.empty()) continue;
    const std::string where = path + ":" + std::to_string(line) + ": ";
    TRY(check_serial(unit, path + ":" + std::to_string(line) + ":"));
    if (unit.find(" = ") != std::string::npos)
      return input_error(where + turncal::quoted(unit) +
                         ": expected a serial number, found the key and value of another file");
    if (holds(units, unit)) return input_error(where + turncal::quoted(unit) + ": is in the queue already");
    units.push_back(unit);
  }
  return units;
}

Result<std::vector<UnitOutcome>> read_outcomes(const std::string& path) {
  std::vector<UnitOutcome> outcomes;
  const std::string state = state_path(path);
  if (!path_exists(state)) return outcomes;
  const std::string text = TRY(read_whole_file(state));
  std::string_view remaining = text;
  for (int number = 1; !remaining.empty(); ++number) {
    std::string line(next_line(remaining)), reason;
    if (const std::size_t mark = line.find(" # "); mark != std::string::npos) {
      reason = line.substr(mark + 3);
      line.resize(mark);
    }
    const std::size_t time = line.find(' '), unit = time == std::string::npos ? time : line.find(' ', time + 1);
    if (unit == std::string::npos || unit + 1 >= line.size() || !parse_utc(line.substr(time + 1, unit - time - 1)))
      return input_error(state + ":" + std::to_string(number) + ": " + turncal::quoted(line) +
                         ": expected outcome, time (2026-01-31T12:00:00Z) and serial number");
    outcomes.push_back({line.substr(unit + 1), line.substr(0, time), line.substr(time + 1, unit - time - 1), reason});
  }
  return outcomes;
}

const UnitOutcome* find_outcome(const std::vector<UnitOutcome>& outcomes, const std::string& unit) {
  const auto found = std::ranges::find(outcomes, unit, &UnitOutcome::unit);
  return found == outcomes.end() ? nullptr : &*found;
}

Standing standing_of(const UnitOutcome* outcome) {
  const auto is = [outcome](const char* word) { return outcome->outcome == word; };
  if (!outcome || is(again_outcome)) return Standing::waits;
  if (is("not_judged") || is("captured")) return Standing::unjudged;
  return is("pass") || is("conditional_pass") ? Standing::passed : Standing::not_passed;
}

std::vector<std::string> next_units(const std::vector<std::string>& queue, const std::vector<UnitOutcome>& outcomes,
                                    std::size_t most) {
  std::vector<std::string> units;
  for (const std::string& unit : queue)
    if (units.size() < most && standing_of(find_outcome(outcomes, unit)) == Standing::waits) units.push_back(unit);
  return units;
}

Result<LockFile> hold_queue(const std::string& path) { return LockFile::acquire(path + ".batch.lock"); }

std::string mounting_file(const std::string& path) { return path + ".mounting"; }

Status record_outcome(const std::string& path, const UnitOutcome& outcome) {
  const LockFile lock = TRY(LockFile::acquire(path + ".lock", LockFile::change_s));
  std::vector<UnitOutcome> outcomes = TRY(read_outcomes(path));
  std::erase_if(outcomes, [&](const UnitOutcome& o) { return o.unit == outcome.unit; });
  outcomes.push_back(outcome);
  std::replace(outcomes.back().reason.begin(), outcomes.back().reason.end(), '\n', ' ');
  return write_outcomes(path, outcomes);
}

Status change_queue(const std::string& path, const QueueChange& change) {
  const LockFile lock = TRY(LockFile::acquire(path + ".lock", LockFile::change_s));
  const std::string old = TRY(path_exists(path) ? read_whole_file(path) : Result<std::string>(""));
  const std::vector<std::string> units =
      TRY(path_exists(path) ? read_queue(path) : Result<std::vector<std::string>>(std::vector<std::string>{}));
  for (const std::string& unit : change.remove) TRY(check_known(path, "unit", unit, units));
  std::string text;
  std::string_view remaining = old;
  while (!remaining.empty()) {
    const std::string_view line = next_line(remaining);
    const std::string unit = serial_in(line);
    if (unit.empty() || !holds(change.remove, unit)) text += std::string(line) + "\n";
  }
  for (std::size_t i = 0; i < change.add.size(); ++i) {
    const std::string& unit = change.add[i];
    const bool twice = holds({change.add.begin(), change.add.begin() + std::ptrdiff_t(i)}, unit);
    if (twice || (holds(units, unit) && !holds(change.remove, unit)))
      return input_error(path + ": holds unit '" + unit + "' already");
    TRY(check_serial(unit, "--add"));
    text += unit + "\n";
  }
  if (!change.again.empty()) {
    std::vector<UnitOutcome> outcomes = TRY(read_outcomes(path));
    std::vector<std::string> known = units;
    for (const UnitOutcome& outcome : outcomes) known.push_back(outcome.unit);
    for (const std::string& unit : change.again) {
      TRY(check_known(path, "unit", unit, known));
      if (!find_outcome(outcomes, unit)) return input_error(path + ": unit '" + unit + "' has no outcome yet");
      for (UnitOutcome& outcome : outcomes)
        if (outcome.unit == unit) outcome = {unit, again_outcome, outcome.time_utc, ""};
    }
    TRY(write_outcomes(path, outcomes));
  }
  if (text == old) return {};
  return write_file_atomically(path, text);
}

}  // namespace turncal
