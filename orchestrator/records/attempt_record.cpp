#include "orchestrator/records/attempt_record.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>

#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/records/database_rows.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

namespace {

// Of a day that there is.
bool begins_a_time(const std::string& text) {
  constexpr std::string_view first = "0001-01-01T00:00:00Z";
  constexpr std::size_t shortest = 4;  // a year
  if (text.empty()) return true;
  if (text.size() < shortest || text.size() > first.size() || text.back() == '-' || text.back() == ':') return false;
  return parse_utc(text + std::string(first.substr(text.size()))).has_value();
}

// What is the same for the same row, wherever it comes from; a refusal before there was a run has nothing but its moment.
std::string key_of(const AttemptRecord& a, const SqlRow& row) {
  const std::string whose = a.unit + "|" + a.station + "|";
  if (a.run.empty()) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return "refused|" + whose + std::to_string(std::chrono::nanoseconds(now).count()) + "|" +
           std::to_string(::getpid());
  }
  std::string all;
  for (std::size_t i = 0; i + 1 < row.size(); ++i) {  // without its calibration, which has another number elsewhere
    const std::optional<double> number = as_number(row[i]);
    all += (number ? format_number(*number) : as_text(row[i])) + '\x1f';
  }
  return a.run + "|" + whose + hash_of_text(all);
}

Status expect_one_of(const std::string& option, const std::string& word, const std::vector<std::string>& there) {
  if (word.empty() || std::find(there.begin(), there.end(), word) != there.end()) return {};
  constexpr std::size_t shown = 14;
  std::string some;
  for (std::size_t i = 0; i < std::min(shown, there.size()); ++i) some += (i > 0 ? ", " : "") + there[i];
  return input_error("--" + option + " " + quoted(word) + ": no row has it: expected " +
                     (there.empty() ? "none" : "one of " + some) + (there.size() > shown ? ", ..." : ""));
}

}  // namespace

Fields fields_of(AttemptRecord& a) {
  return {{"run", &a.run},
          {"unit", &a.unit},
          {"began_utc", &a.began_utc},
          {"time_utc", &a.time_utc},
          {"outcome", &a.outcome},
          {"reason", &a.reason},
          {"simulated", &a.simulated},
          {"station", &a.station},
          {"operator", &a.operator_name},
          {"part", &a.part},
          {"revision", &a.revision},
          {"ambient", &a.ambient},
          {"temperature_min_c", &a.temperature_min_c},
          {"temperature_max_c", &a.temperature_max_c},
          {"residual", &a.residual},
          {"diagnosis", &a.diagnosis},
          {"recorded_s", &a.recorded_s},
          {"sessions", &a.sessions},
          {"repeated_dwells", &a.repeated_dwells},
          {"lost_samples", &a.lost_samples},
          {"folder", &a.folder},
          {"calibration", &a.calibration}};
}

Status check(const RecordFilter& filter) {
  for (const auto& [option, text] : {std::pair{"--from", &filter.from}, std::pair{"--to", &filter.to}})
    if (!begins_a_time(*text))
      return input_error(std::string(option) + " " + quoted(*text) +
                         ": expected a date or a time as 2026-01-31 or 2026-01-31T12:00:00Z");
  std::vector<std::string> verdicts = {"captured",    "dropped", "refused",      "aborted",
                                       "interrupted", "failed",  outcome_running};
  for (int v = 0; v <= static_cast<int>(UnitVerdict::fail); ++v)
    verdicts.emplace_back(to_string(static_cast<UnitVerdict>(v)));
  TRY(expect_one_of("verdict", filter.verdict, verdicts));
  if (!filter.to.empty() && filter.from.substr(0, filter.to.size()) > filter.to)
    return input_error("--from " + quoted(filter.from) + ": is after --to " + quoted(filter.to));
  return {};
}

Status ResultsDatabase::check_known(const RecordFilter& filter) const {
  const std::pair<std::string, const std::string*> words[] = {
      {"unit", &filter.unit}, {"station", &filter.station}, {"part", &filter.part}};
  for (const auto& [column, wanted] : words) {
    if (wanted->empty()) continue;
    std::vector<std::string> there;
    Status status =
        connection_->run("SELECT " + column + " FROM attempt UNION SELECT " + column + " FROM calibration ORDER BY 1",
                         {}, [&](const SqlRow& row) { there.push_back(as_text(row.front())); });
    if (!status) return status;
    std::erase(there, "");
    if (status = expect_one_of(column, *wanted, there); !status) return status;
  }
  return {};
}

Status ResultsDatabase::note(AttemptRecord a) {
  SqlRow row = row_of(fields_of(a));
  if (a.run.empty()) row.front() = {};
  static_cast<void>(TRY(add_attempt_row(*connection_, key_of(a, row), row)));
  return {};
}

Result<std::vector<AttemptRecord>> ResultsDatabase::attempts(const RecordFilter& filter) const {
  std::vector<AttemptRecord> found;
  const auto take = [&](const SqlRow& row) {
    AttemptRecord& attempt = found.emplace_back();
    Fields fields = fields_of(attempt);
    fields.push_back({"id", &attempt.id});
    take_row(row, fields);
  };
  const Status status = connection_->run(
      "SELECT " + attempt_columns() + ", id FROM attempt WHERE " + where("outcome") +
          (filter.newest > 0 ? " ORDER BY time_utc DESC, id DESC LIMIT " + std::to_string(filter.newest)
                             : " ORDER BY time_utc, id"),
      values_of(filter), take);
  if (!status) return status.error();
  if (filter.newest > 0) std::reverse(found.begin(), found.end());
  return found;
}

}  // namespace turncal
