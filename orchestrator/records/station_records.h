// Where a station writes down its attempts: into its database or, where that is a server, first into a file of its own (the outbox), from
// which the rows go to the server when it answers. A run never waits longer for a server than `longest_wait_s`, and needs it for nothing.
//
// A row that is sent twice is one row: whoever is interrupted between sending and taking away sends again.
#pragma once

#include <string>
#include <vector>

#include "orchestrator/records/attempt_record.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

inline constexpr double longest_wait_s = 5.0;

// The file that is written first; empty: the station keeps no results.
std::string records_file(const StationConfig& station);

// Sends what is kept. Why something stays here, in one line; empty: nothing does, or there is no server.
std::string send_records(const StationConfig& station);
// Why the server could not be written to now; empty: it could, or there is none. Nothing is changed.
std::string server_trouble(const StationConfig& station);

// Oldest first. Where rows wait for a server they are the newest, and alone; then, and where it is away, `trouble` says so.
Result<std::vector<AttemptRecord>> recorded_attempts(const StationConfig& station, const RecordFilter& filter,
                                                     std::string& trouble);

}  // namespace turncal
