// `turncal apply RECORDING --parameters FILE --out CSV`: calibrated increments of every sample,
//   dtheta = n counts_gyro - N0 dt  [rad],   dv = a counts_accel - A0 dt  [m/s],   dt the sample period.
// Refused: a wrong checksum, a missing key, parameters of another unit, simulated parameters on a real unit's recording.
// Effects beyond the 24 parameters are taken off as the estimate modelled them (effect_terms.h).
#pragma once

#include "orchestrator/commands/command_line.h"

namespace turncal {

void add_apply_command(CLI::App& app, CommandContext& context);

}  // namespace turncal
