// ModbusTwin: three simulated drives behind the registers of a RegisterMap, over Modbus TCP or (on a pseudo-terminal) RTU. For
// rehearsals with real links (`turncal twin`) and for the tests of the driver. line_server.h shows how to run it.
//
// The axes are those of any Turntable (the rig's mock), so the twin has its behaviour and its faults. Status registers are made from its
// status at each reading. A list of writes of the map, received completely and in order, is carried out when its last register is
// written. A refusal of the table gives exception 4, an unknown register exception 2.
//
// - Operations are recognised by address and constants; operands are read on the way. Several lists may share registers.
// - The first heartbeat of a drive arms its watchdog: after watchdog_s without one every axis is stopped, the drive shows
//   a fault and refuses moves until the fault is cleared. A drive that is off has nothing to stop: it does not trip, and the next
//   heartbeat arms it again. Enabling any drive enables all and restarts the time. Call tick() often; time is the clock's.
// Not modelled: parameters of a drive (writes are stored and read back), torque, a power-on delay.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "imu_io/base/clock.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/twins/line_server.h"
#include "turntable_drivers/twins/told_table.h"

namespace turncal {

class ModbusTwin : public LineServer {
 public:
  // The table and the clock must outlive the twin.
  ModbusTwin(RegisterMap map, Turntable& table, const Clock& clock)
      : map_(std::move(map)), table_(table), clock_(clock) {}

  Status power_on();  // connects to the table and enables it if the map has no enable write
  struct Answer {
    int exception = 0;                  // 0: no exception
    std::vector<std::uint16_t> values;  // of a read request
  };
  Answer handle(const ModbusRequest& request);
  void tick() override;  // the watchdog
  bool watchdog_tripped(Axis axis) const { return tripped_[index(axis)]; }
  std::function<void(const ModbusRequest&, AnswerPlan&)> disturb;

 private:
  // The quantities of a move, for axis 0 to 2, or 3 for the axis that is written to.
  using Operands = std::map<std::pair<MoveQuantity, int>, double>;
  struct Progress {
    std::size_t step = 0;  // index of the expected step of the list
    Operands operands;
  };
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  Answer read(const ModbusRequest& request);
  Answer write(const ModbusRequest& request);
  std::optional<std::vector<std::uint16_t>> registers_of(const StatusBlock& block, Axis axis);
  // True if the request is the step; its operands are added to `operands`.
  bool matches(const WriteStep& step, TableOperation operation, Axis axis, const ModbusRequest& request,
               Operands& operands) const;
  Status carry_out(Axis axis, TableOperation operation, const Operands& operands);
  bool beats(const ModbusRequest& request, Axis axis);  // true: the heartbeat of this axis

  RegisterMap map_;
  ToldTable table_;
  const Clock& clock_;
  std::map<std::pair<int, int>, std::uint16_t> written_;  // by unit and address
  std::array<std::array<Progress, table_operation_count>, 3> progress_;
  std::array<std::optional<double>, 3> heartbeat_s_;
  std::array<std::optional<std::uint16_t>, 3> heartbeat_value_;
  std::array<bool, 3> tripped_{};
};

}  // namespace turncal
