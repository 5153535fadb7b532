// Recalibrates and diagnoses every recording of an archive with this version, once, into a store:
//
//   STORE/<version>/<hash of the recording>/parameters.conf, statistics.tcs, diagnosis.conf
//   STORE/<version>/<hash of the recording>/failure.txt      why the recording cannot be calibrated
//   STORE/<version>/recordings.csv                           outcome of each recording of the last archive, with reason. An unreadable
//                                                            recording has no hash: it is tried again each time
//
// The folder of a recording is completed and then renamed, so that processes that are killed, or work on the same one, lose and double nothing.
// Existing results are not made again. Chunk k of n is every n-th entry from k on: n processes, anywhere, share a list and a store.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/report/document.h"

namespace turncal {

// The recordings of an archive: those of a list, all below a folder, or those of a results database, in the folders that its rows name.
//
// A list is CSV with a header: `recording`, a path (relative ones from the list's folder), and, where known, `station`, `lot`, `part`,
// `revision` and `measured_utc`. Below a folder every recording counts: a .tcr file, or a folder in text form. What the list does not give
// is taken from the parameters.conf beside the recording, when the recording is processed.
struct ArchiveEntry {
  std::string recording;
  std::map<std::string, std::string> record;  // "station" -> "line 1", ...: record.* keys of the parameter file
};

// Returns the entries in the order of the list or of the rows, or by path. Errors: no such file, a header without `recording`, an unknown column,
// a row that is too long or too short, no recording.
Result<std::vector<ArchiveEntry>> read_archive(const std::string& path);

struct RecalibrationRequest {
  std::string store;
  std::string version;  // software_version()
  std::string time_utc;
  bool diagnose = true;
  int threads = 1;
  int chunk = 0, chunks = 1;
  std::string outcome;  // file of outcomes; empty: recordings.csv, for a chunk recordings.K-of-N.csv
};

struct RecalibrationCounts {
  std::size_t entries = 0, done = 0, there = 0, failed = 0, unreadable = 0;
  std::string waiting;  // state of an engine's queue
  std::size_t finished() const { return done + there + failed + unreadable; }
};
using RecalibrationProgress = std::function<void(const RecalibrationCounts&)>;

// Recalibrates the archive. An error of kind device when the store cannot be written. Any thread may call `progress`, but only one at a time.
Result<RecalibrationCounts> recalibrate(const std::vector<ArchiveEntry>& archive, const RecalibrationRequest& request,
                                        const RecalibrationProgress& progress);

// Recalibrates the archive in chunks, each a task of one Slurm array job.
//
//   STORE/.jobs/XXXXXX/archive.csv      the list at the time of submission; every task reads the same one
//   STORE/.jobs/XXXXXX/K.csv, K.log     outcomes of chunk K; output of its task
//
// A chunk is finished when its K.csv exists. Slurm itself requeues the tasks of a node that went away. A task that left the queue
// without its K.csv (cancelled, killed, could not write) is submitted again, `most_attempts` times in all. The folder is removed when
// everything is finished. The waiting process may be killed: the job goes on, and the same command later does only the rest.
struct SlurmOptions {
  int chunks = 0;  // 0: a hundred recordings in each, at most 1000 chunks (Slurm's MaxArraySize)
  int most_attempts = 3;
};

// Paths of archive and store must be the same on every node. request.threads: of each task. Errors of kind device: Slurm is missing or refuses;
// chunks failed too often: which, and the last line of their log.
Result<RecalibrationCounts> recalibrate_on_slurm(const std::vector<ArchiveEntry>& archive,
                                                 const RecalibrationRequest& request, const SlurmOptions& options,
                                                 const RecalibrationProgress& progress);

// Changes from one version of a store to another: parameters in sigmas, and verdicts.
struct ParameterChange {
  std::string key;
  std::size_t recordings = 0;
  double mean = 0.0, rms = 0.0, largest = 0.0;  // new minus old, in new sigmas
  std::string largest_unit, largest_recording;  // largest_recording: its hash
  double sigma_ratio = 1.0;                     // median of new over old
};

struct VersionChanges {
  std::string from = {}, to = {};
  std::size_t both = 0, only_from = 0, only_to = 0;  // recordings
  std::vector<ParameterChange> parameters = {};
  // Verdicts of the diagnosis, or `failed`: (old, new) -> recordings.
  std::map<std::pair<std::string, std::string>, std::size_t> verdicts = {};
};

Result<VersionChanges> compare_versions(const std::string& store, const std::string& from, const std::string& to);
Document changes_document(const VersionChanges& changes);

}  // namespace turncal
