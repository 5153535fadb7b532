// The archive in chunks, each a task of one Slurm array job (recalibration.h says what a chunk is).
//
//   STORE/.jobs/XXXXXX/archive.csv      the list as it was when the job was submitted; every task reads the same one
//   STORE/.jobs/XXXXXX/K.csv, K.log     what became of the recordings of chunk K; what its task said
//
// A chunk is finished when its K.csv is there, which it gets at its end. Slurm itself puts tasks of a node that went away back into the queue;
// one that has left the queue without its K.csv (it was cancelled, killed, or could not write) is submitted again, `most_attempts` times in all.
// What was done is in the store, and is not done again. The folder is removed when all is finished.
//
// Whoever waits may be killed: the job goes on, and the same command later does only what is not there. No accounting of Slurm is needed.
#pragma once

#include "orchestrator/fleet/recalibration.h"

namespace turncal {

struct SlurmOptions {
  int chunks = 0;  // 0: hundred recordings in each, at most 1000 (Slurm's MaxArraySize)
  int most_attempts = 3;
};

// Paths of archive and store must be the same on every node. request.threads: of each task. Errors: Slurm is not there or refuses (device); chunks
// that failed too often: which, and the last line of their log (device).
Result<RecalibrationCounts> recalibrate_on_slurm(const std::vector<ArchiveEntry>& archive,
                                                 const RecalibrationRequest& request, const SlurmOptions& options,
                                                 const RecalibrationProgress& progress);

}  // namespace turncal
