// Every recording of an archive calibrated and diagnosed again with this version, once, into a store:
//
//   STORE/<version>/<hash of the recording>/parameters.conf, statistics.tcs, diagnosis.conf
//   STORE/<version>/<hash of the recording>/failure.txt      what cannot be calibrated, and why
//   STORE/<version>/recordings.csv                           what became of each recording of the last archive, and why. What cannot be
//                                                            read has no hash: it is tried again each time
//
// A folder of a recording is made whole and renamed: whoever is killed, or works on the same recording at the same time, loses and doubles
// nothing. What is there is not done again. Chunk k of n is every n-th entry from k on: n processes, anywhere, share a list and a store.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/fleet/archive.h"

namespace turncal {

struct RecalibrationRequest {
  std::string store;
  std::string version;  // software_version()
  std::string time_utc;
  bool diagnose = true;
  int threads = 1;
  int chunk = 0, chunks = 1;
  std::string outcome;  // the file of outcomes; empty: recordings.csv, of a chunk recordings.K-of-N.csv
};

struct RecalibrationCounts {
  std::size_t entries = 0, done = 0, there = 0, failed = 0, unreadable = 0;
  std::string waiting;  // of an engine: how its queue stands
  std::size_t finished() const { return done + there + failed + unreadable; }
};
using RecalibrationProgress = std::function<void(const RecalibrationCounts&)>;

// An error of kind device where the store cannot be written. `progress` is told from any thread, one at a time.
Result<RecalibrationCounts> recalibrate(const std::vector<ArchiveEntry>& archive, const RecalibrationRequest& request,
                                        const RecalibrationProgress& progress);

// A file of outcomes: a row each, `done`, `there`, `failed` or `unreadable` first.
inline constexpr const char* outcome_header = "outcome,recording,hash,reason\n";
inline constexpr const char* outcome_name = "recordings.csv";
void count_outcomes(std::string_view rows, RecalibrationCounts& counts);

inline constexpr const char* failure_name = "failure.txt";

}  // namespace turncal
