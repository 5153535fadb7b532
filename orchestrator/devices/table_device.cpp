#include "orchestrator/devices/table_device.h"

#include <poll.h>

#include <cassert>

#include "imu_io/base/clock.h"
#include "turntable_drivers/ascii/serial_turntable.h"
#include "turntable_drivers/modbus/modbus_turntable.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

Status TableDevice::leave() {
  if (left_) return {};
  left_ = true;
  const auto wait = [](double seconds) { ::poll(nullptr, 0, static_cast<int>(1e3 * seconds)); };
  return leave_off(limited_, {.now_s = monotonic_s, .wait = wait, .standing_rate_degps = standing_rate_degps_});
}

TableDevice::~TableDevice() {
  // Whoever could be told of a failure has read of it where the run's own stop failed.
  static_cast<void>(leave().ok());
}

Status TableDevice::commission(const AxisTriple& known_deg, double tolerance_deg) {
  if (auto* described = dynamic_cast<DescribedTurntable*>(driver_.get()))
    return described->commission(known_deg, tolerance_deg);
  return input_error("this table has nothing to commission");
}

std::array<MotionLimits, 3> motion_limits(const StationConfig& station) {
  std::array<MotionLimits, 3> limits;
  for (std::size_t i = 0; i < limits.size(); ++i) {
    const AxisLimits& axis = station.axis[i];
    limits[i] = {axis.soft_min_deg, axis.soft_max_deg, axis.max_rate_degps, axis.max_acceleration_degps2,
                 axis.wrap_deg};
  }
  return limits;
}

Result<std::unique_ptr<TableDevice>> make_table(const StationConfig& station, const TableContext& context) {
  std::unique_ptr<Turntable> driver;
  switch (station.table.driver) {
    case TableDriver::mock:
      return input_error("station '" + station.name +
                         "': table.driver = mock has no table to turn: expected modbus, serial or manual");
    case TableDriver::modbus:
      assert(station.table.map);
      driver = std::make_unique<ModbusTurntable>(*station.table.map, context.clock, context.stop_requests);
      break;
    case TableDriver::serial:
      assert(station.table.dialect);
      driver = std::make_unique<SerialTurntable>(*station.table.dialect, context.clock, context.stop_requests);
      break;
    case TableDriver::manual:
      assert(context.operator_output);
      driver = std::make_unique<ManualTurntable>(station.table.manual, context.clock, context.operator_input,
                                                 *context.operator_output, context.gravity);
      break;
  }
  return std::make_unique<TableDevice>(std::move(driver), motion_limits(station), station.motion.settle_rate_degps);
}

}  // namespace turncal
