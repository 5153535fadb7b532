// Recalibrates and diagnoses every recording of an archive with this version, once, into a store:
//
//   STORE/<version>/<hash of the recording>/parameters.conf, statistics.tcs, diagnosis.conf
//   STORE/<version>/<hash of the recording>/failure.txt      what cannot be calibrated, and why
//   STORE/<version>/recordings.csv                           what became of each recording of the last archive, and why. What cannot be
//                                                            read has no hash: it is tried again each time
//
// A folder of a recording is made whole and renamed: whoever is killed, or works on the same one at the same time, loses and doubles nothing.
// What is there is not done again. Chunk k of n is every n-th entry from k on: n processes, anywhere, share a list and a store.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/report/document.h"

namespace turncal {

// The recordings of an archive: those of a list, all below a folder, or those of a results database, where its rows say that they are.
//
// A list is CSV with a header: `recording`, a path (relative ones from the list's folder), and, where they are known, `station`, `lot`, `part`,
// `revision` and `measured_utc`. Below a folder every recording counts: a .tcr file, or a folder in text form. What a run says of itself
// in the parameters.conf beside its recording is taken over where the list does not say it, when its turn has come.
struct ArchiveEntry {
  std::string recording;
  std::map<std::string, std::string> record;  // "station" -> "line 1", ...: record.* keys of the parameter file
};

// In the order of the list or of the rows, or by path. Errors: no such file, a header without `recording`, a column that is not known, a row that is too long
// or too short, not one recording.
Result<std::vector<ArchiveEntry>> read_archive(const std::string& path);

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

// The archive in chunks, each a task of one Slurm array job.
//
//   STORE/.jobs/XXXXXX/archive.csv      the list as it was when the job was submitted; every task reads the same one
//   STORE/.jobs/XXXXXX/K.csv, K.log     what became of the recordings of chunk K; what its task said
//
// A chunk is finished when its K.csv is there. Slurm itself puts tasks of a node that went away back into the queue; one that has left the
// queue without its K.csv (cancelled, killed, could not write) is submitted again, `most_attempts` times in all. The folder is removed when
// all is finished. Whoever waits may be killed: the job goes on, and the same command later does only what is not there.
struct SlurmOptions {
  int chunks = 0;  // 0: hundred recordings in each, at most 1000 (Slurm's MaxArraySize)
  int most_attempts = 3;
};

// Paths of archive and store must be the same on every node. request.threads: of each task. Errors: Slurm is not there or refuses (device); chunks
// that failed too often: which, and the last line of their log (device).
Result<RecalibrationCounts> recalibrate_on_slurm(const std::vector<ArchiveEntry>& archive,
                                                 const RecalibrationRequest& request, const SlurmOptions& options,
                                                 const RecalibrationProgress& progress);

// What changed from one version of a store to another: parameter by parameter in sigmas, verdict by verdict.
struct ParameterChange {
  std::string key;
  std::size_t recordings = 0;
  double mean = 0.0, rms = 0.0, largest = 0.0;  // new minus old, in sigmas of the new
  std::string largest_unit, largest_recording;  // its hash
  double sigma_ratio = 1.0;                     // new over old, the median
};

struct VersionChanges {
  std::string from, to;
  std::size_t both = 0, only_from = 0, only_to = 0;  // recordings
  std::vector<ParameterChange> parameters;
  // Of the diagnosis, or `failed`: (old, new) -> recordings.
  std::map<std::pair<std::string, std::string>, std::size_t> verdicts;
};

Result<VersionChanges> compare_versions(const std::string& store, const std::string& from, const std::string& to);
Document changes_document(const VersionChanges& changes);

}  // namespace turncal
