// ModbusTwin: three simulated drives behind the registers that a RegisterMap describes, on a line: Modbus TCP or (on a pseudo-terminal)
// RTU, for a rehearsal with real links (`turncal twin`) and for the tests of the driver. line_server.h says how it is run.
//
// The axes are those of any Turntable (the rig's mock), so the twin has its manners and its lies. Status registers are made from its
// status at each reading; a list of writes of the map, seen in full and in order, is carried out when its last register is
// written. A table that refuses makes exception 4, a register that no list names and no block holds exception 2.
//
// - Operations are matched by address and constant, operands are taken on the way: the same registers may serve several lists.
// - The watchdog is armed by the first heartbeat of a drive: when none came for watchdog_s every axis is stopped, the drive shows
//   a fault and refuses moves until the fault is cleared. A drive that is off has nothing to stop: it does not trip, and the next
//   heartbeat arms it again. Its time starts anew when any drive is enabled, which enables all. Call tick() often; time is the clock's.
// Not modelled: a drive's own parameters (they take any write and read back), torque, a power-on delay.
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
  // Table and clock must outlive the twin.
  ModbusTwin(RegisterMap map, Turntable& table, const Clock& clock);

  Status power_on();  // connects to the table; drives without an enable write come up enabled
  struct Answer {
    int exception = 0;                  // 0: none
    std::vector<std::uint16_t> values;  // of a read
  };
  Answer handle(const ModbusRequest& request);
  void tick() override;  // the watchdog
  bool watchdog_tripped(Axis axis) const { return tripped_[index(axis)]; }
  std::function<void(const ModbusRequest&, AnswerPlan&)> disturb;

 private:
  // What a move was told; of which axis: 0 to 2, or 3 for the one that is written to.
  using Operands = std::map<std::pair<MoveQuantity, int>, double>;
  struct Progress {
    std::size_t step = 0;  // of the list, the next one awaited
    Operands operands;
  };
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  Answer read(const ModbusRequest& request);
  Answer write(const ModbusRequest& request);
  std::optional<std::vector<std::uint16_t>> registers_of(const StatusBlock& block, Axis axis);
  // Whether the request is the step; operands go into `operands`.
  bool matches(const WriteStep& step, TableOperation operation, Axis axis, const ModbusRequest& request,
               Operands& operands) const;
  Status carry_out(Axis axis, TableOperation operation, const Operands& operands);
  bool beats(const ModbusRequest& request, Axis axis);  // whether this is its heartbeat

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
