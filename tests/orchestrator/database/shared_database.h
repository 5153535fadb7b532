// For tests: a station that keeps its results on a server, or on one that is not there.
#pragma once

#include "orchestrator/records/results_database.h"
#include "tests/orchestrator/program.h"

namespace turncal {

// Nobody listens there: a port that only root could have.
inline constexpr const char* server_away = "postgresql://east@127.0.0.1:1/turncal";

class SharedDatabase : public Program {
 protected:
  std::string station(const std::string& database, const std::string& name = "east") const {
    return write(name + ".station",
                 station_head + "station.name = " + name +
                     "\nmotion.settle_s = 0.5\nlimit.residual_max = 2\nrecord.database = " + database + "\n");
  }
  Arguments dry_run(const std::string& unit, const std::string& name = "east") const {
    return Program::dry_run(name + "/" + unit, {"--station", path(name + ".station")}, unit);
  }
  std::vector<AttemptRecord> attempts(const std::string& name, const RecordFilter& filter = {}) const {
    const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(name);
    EXPECT_TRUE(database.ok()) << database.error().message;
    return database.ok() ? *database->attempts(filter) : std::vector<AttemptRecord>();
  }
  std::size_t calibrations(const std::string& name, const RecordFilter& filter = {}) const {
    const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(name);
    EXPECT_TRUE(database.ok()) << database.error().message;
    return database.ok() ? database->list(filter, "N01")->size() : 0;
  }
};

}  // namespace turncal
