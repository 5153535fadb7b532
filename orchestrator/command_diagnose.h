// `turncal diagnose RECORDING [--holdout RECORDING] --out DIR`: does the data hold an effect beyond the 24 parameters? Fits, scores
// every effect of the catalogue, adds what stands the test on held-out data, and writes DIR/parameters.conf,
// DIR/diagnosis.conf and DIR/report.html. Exit code 0 when the verdict is clean, 20 when it is not.
#pragma once

#include "calib/compression.h"
#include "imu_io/recording_source.h"
#include "orchestrator/command_line.h"

namespace turncal {

void add_diagnose_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
