#include "turntable_drivers/rig/rig_config.h"

#include <algorithm>

namespace turncal {

const std::array<const char*, 24> rig_truth_keys = {"N01", "N02", "N03", "A01", "A02", "A03", "n11", "n12",
                                                    "n13", "n21", "n22", "n23", "n31", "n32", "n33", "a11",
                                                    "a12", "a13", "a21", "a22", "a23", "a31", "a32", "a33"};

RigConfig default_rig_config() { return {}; }

RigConfig rig_of_unit(const RigConfig& config, std::size_t unit) {
  RigConfig own = config;
  std::erase_if(own.faults, [unit](const RigFault& fault) {
    return concerns_unit(fault.kind) && fault.unit != static_cast<int>(unit) + 1;
  });
  if (unit == 0) return own;
  const std::uint64_t apart = static_cast<std::uint64_t>(unit) * 0xA0761D6478BD642FULL;  // odd: no two units the same
  own.unit_seed = config.unit_seed.value_or(config.seed) ^ apart;
  own.noise_seed = config.noise_seed.value_or(config.seed) ^ apart;
  own.unit_serial.clear();
  return own;
}

}  // namespace turncal
