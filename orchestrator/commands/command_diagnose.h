// `turncal diagnose RECORDING [--holdout RECORDING] --out DIR`: does the data hold an effect beyond the 24 parameters? Fits, scores
// every effect of the catalogue, adds what stands the test on held-out data, and writes DIR/parameters.conf,
// DIR/diagnosis.conf and DIR/report.html. Exit code 0 when the verdict is clean, 20 when it is not.
#pragma once

#include <string>

#include "orchestrator/jobs/command_context.h"

namespace turncal {

// At the end of a run: diagnoses the run's recording into FOLDER/diagnosis, every line with `tag` in front; sets the exit code to 20
// when the run itself passed and the verdict is not clean. The run's own parameters.conf is not touched. A recording shorter
// than half an hour tells too little and is left alone, and so is a run that ended without parameters.
void diagnose_run(const std::string& folder, const Status& run, CommandContext& context);

}  // namespace turncal
