#include "orchestrator/devices/dry_run_devices.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/data_text.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {

namespace {

constexpr double same_period = 1e-6;  // tolerance between two files written by people

}  // namespace

Result<RigConfig> rig_of(const StationConfig& station, const std::string& file) {
  RigConfig rig = default_rig_config();
  rig.site.latitude_deg = station.latitude_deg;
  rig.site.gravity_mps2 = station.gravity_mps2;
  if (station.imu) {
    rig.sample_period_s = station.imu->frame.sample_period_s;
    if (station.imu->frame.accel().pulses) rig.accel_pulse_mps = station.imu->frame.accel_pulse_mps;
  }
  const std::string& path = file.empty() ? station.rig_file : file;
  if (path.empty()) return rig;
  const double period_s = rig.sample_period_s;
  Result<RigConfig> read = read_rig_config(path, rig);
  if (!read) return read;
  if (station.imu && std::abs(read->sample_period_s / period_s - 1.0) > same_period)
    return input_error(path + ": sample_period_s = " + format_number(read->sample_period_s) + ": expected " +
                       format_number(period_s) + ", as frame " + station.imu->frame.name + " of the station has it");
  if (read->quantisation == RigQuantisation::off)
    return input_error(path + ": quantisation = off: expected floor or round: a unit counts whole pulses");
  return read;
}

std::string format_truth(const Rig& rig, std::optional<double> reference_c) {
  KeyValues lines("# [dry run] What the rig was given. Units as in the parameter file; effects: docs/diagnosis.md.\n");
  const std::array<double, 24> truth = reference_c ? rig.truth_at_reference(*reference_c) : rig.truth();
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) lines.number(parameter_keys[i], truth[i]);
  for (const auto& [name, value] : rig.truth_effects()) lines.number("effect." + name, value);
  if (reference_c) lines.number("reference_temperature_c", *reference_c);
  for (const auto& [name, value] : rig.table_errors()) lines.number("table." + name, value);
  if (const RigLot& lot = rig.config().lot; lot.seed) {
    lines.text("lot.fault", to_string(lot.fault));
    lines.flag("lot.fault_shows", lot.fault_shows);
  }
  return lines.take();
}

Result<ParameterVector> read_truth(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  ParameterVector truth;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) truth[Eigen::Index(i)] = file.number(parameter_keys[i]);
  TRY(file.status());
  return truth;
}

StationDevices DryRunDevices::devices() {
  const auto wait = [this](double seconds) {  // passes time while nobody reads the unit
    group.pass_until(group.now_s() + std::max(seconds, rig.config().sample_period_s));
  };
  return by_hand_ ? StationDevices{by_hand_->limited, by_hand_->watched, clock, wait}
                  : StationDevices{table, imu, clock, wait};
}

Status DryRunDevices::put_back(std::span<const TableCommand> commands, double until_s) {
  TRY(table.connect());
  TRY(table.enable());
  for (const TableCommand& command : by_hand_ ? std::span<const TableCommand>() : commands) {
    group.pass_until(command.time_s);
    TRY(command.move ? table.move_absolute(command.move->axis, command.move->target_deg, command.move->rate_degps,
                                           command.move->acceleration_degps2)
                     : table.home());
  }
  group.pass_until(until_s);
  const Result<AxisStatus> status = table.status(Axis::heading);  // a table updates only when it is asked
  return status ? Status{} : Status{status.error()};
}

DryRunDevices::ByHand::ByHand(DryRunDevices& rig, const StationConfig& station, int input, std::ostream& out)
    : watched(rig.imu, rig.rig.config().sample_period_s),
      manual(station.table.manual, rig.clock, input, out, [this] { return watched.mean(); }),
      limited(manual, station.axis),
      prompts(manual) {
  manual.rehearse_on(rehearsed_table(rig.rig));
  manual.feel_turns([this] { return watched.turned_deg(); });
}

void DryRunDevices::rehearse(const StationConfig& station, int input, std::ostream& out) {
  by_hand_ = std::make_unique<ByHand>(*this, station, input, out);
}

}  // namespace turncal
