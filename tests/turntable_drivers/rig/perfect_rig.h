// A rig without noise, table errors, parameter errors or quantisation: what is left is geometry, gravity and earth rate.
#pragma once

#include "turntable_drivers/rig/rig_config.h"

namespace turncal {

inline RigConfig perfect_rig_config() {
  RigConfig config;
  config.random_truth = false;
  config.quantisation = RigQuantisation::off;
  config.noise = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, config.noise.flicker_longest_s};
  config.table_errors.random_arcmin = 0.0;
  return config;
}

}  // namespace turncal
