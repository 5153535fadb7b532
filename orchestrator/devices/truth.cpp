#include "orchestrator/devices/truth.h"

#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

std::string format_truth(const Rig& rig, std::optional<double> reference_c) {
  std::string text =
      "# [dry run] What the rig was given. Units as in the parameter file; effects: docs/effect-components.md.\n";
  const auto line = [&text](std::string_view key, double value) {
    text += std::string(key) + " = " + format_number(value) + "\n";
  };
  const std::array<double, 24> truth = reference_c ? rig.truth_at_reference(*reference_c) : rig.truth();
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) line(parameter_keys[i], truth[i]);
  for (const auto& [name, value] : rig.truth_effects()) line("effect." + name, value);
  if (reference_c) line("reference_temperature_c", *reference_c);
  for (const auto& [name, value] : rig.table_errors()) line("table." + name, value);
  if (const RigLot& lot = rig.config().lot; lot.seed) {
    text += std::string("lot.fault = ") + to_string(lot.fault) + "\n";
    text += std::string("lot.fault_shows = ") + (lot.fault_shows ? "true" : "false") + "\n";
  }
  return text;
}

Result<ParameterVector> read_truth(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  ParameterVector truth;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    truth[static_cast<Eigen::Index>(i)] = file.number(parameter_keys[i]);
  }
  TRY(file.status());
  return truth;
}

}  // namespace turncal
