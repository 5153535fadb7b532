#include "orchestrator/records/station_records.h"

#include "imu_io/base/posix_file.h"
#include "orchestrator/records/results_database.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

namespace {

constexpr SqlPatience short_patience{.wait_s = 3.0, .all_s = longest_wait_s};

}  // namespace

std::string records_file(const StationConfig& station) {
  return names_a_server(station.database) ? station.outbox : station.database;
}

std::string send_records(const StationConfig& station) {
  if (!names_a_server(station.database) || !path_exists(station.outbox)) return "";
  const Result<ResultsDatabase> kept = ResultsDatabase::open(station.outbox);
  if (!kept) return kept.error().message;
  const auto waiting = kept->attempts({});
  if (!waiting) return waiting.error().message;
  if (waiting->empty()) return "";
  Result<ResultsDatabase> server = ResultsDatabase::open(station.database, short_patience);
  const Result<CopiedRows> sent = server ? kept->copy_to(*server, true) : Result<CopiedRows>(server.error());
  if (sent) return "";
  const auto left = kept->attempts({});
  const std::size_t count = left ? left->size() : waiting->size();
  return sent.error().message + "; " + std::to_string(count) + (count == 1 ? " attempt is" : " attempts are") +
         " kept in " + station.outbox + " and sent later";
}

std::string server_trouble(const StationConfig& station) {
  if (!names_a_server(station.database)) return "";
  const Result<ResultsDatabase> server = ResultsDatabase::open_to_read(station.database, short_patience);
  return server ? "" : server.error().message;
}

Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble) {
  std::vector<AttemptRecord> all;
  const auto take = [&](const std::string& name) -> Status {
    const ResultsDatabase database = TRY(ResultsDatabase::open_to_read(name, short_patience));
    const std::vector<AttemptRecord> some = TRY(database.attempts(filter));
    all.insert(all.end(), some.begin(), some.end());
    return {};
  };
  trouble.clear();
  const std::string file = records_file(station);
  if (!file.empty() && path_exists(file)) {
    TRY(take(file));
  }
  if (!names_a_server(station.database)) return all;
  // What waits here is newer than what the server has of this station, and says that the server was away a moment ago.
  if (!all.empty())
    trouble = station.database + ": results database: not all of it: " + station.outbox + " keeps rows for it";
  else if (Status status = take(station.database); !status)
    trouble = status.error().message;
  return all;
}

}  // namespace turncal
