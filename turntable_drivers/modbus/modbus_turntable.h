// ModbusTurntable: three drives behind Modbus TCP or RTU, wholly described by a RegisterMap.
//
// Beside the rules of turntable.h:
// - A position is believed when the block was read whole, the number is finite, within plausible_deg, and the axis can have got
//   there since the last reading. Else the reading is repeated, and then it is an error.
// - Nothing is switched on or moves before the map is commissioned (commission() against a known angle shows what scale, sign and word order give;
//   the user then writes `commissioned = true`), before enable() was called since connect(), and while the drive's own state
//   says anything but enabled, homed, at rest, without fault, in remote.
// - stop_all() and abort_all() go to every axis at once, each waiting at most stop_ack_s for the answer; those that did not answer
//   are asked again, after the line was read empty. They also go out on a link that counts as lost, or was closed after trouble.
// - A table that takes all three angles in one block gets, with the move of one axis, the last targets of the others, or where they
//   stand once they were stopped.
// - Where a stop is of the whole table it gives way to write.abort only when all drives are off.
// - A drive that was told to go off, or last read off, gets write.abort in place of write.stop: a stop must not switch it on.
// - The heartbeat, if the map has one, is written to every drive with any status reading, when it is due.
// - homed is believed only after the homing was seen to begin, or three readings after the command.
//
// Not modelled: restarting a drive's own programs, torque limits. One thread.
#pragma once

#include <array>
#include <atomic>
#include <optional>

#include "imu_io/base/clock.h"
#include "turntable_drivers/modbus/modbus_link.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/axis_memory.h"
#include "turntable_drivers/table/stop_signal.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class ModbusTurntable : public Turntable {
 public:
  // The clock and the count must outlive the table.
  ModbusTurntable(RegisterMap map, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override;
  Status abort_all() override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;
  void set_meanwhile(std::function<void()> meanwhile) override { stop_.set_meanwhile(std::move(meanwhile)); }
  bool was_connected() const override { return was_connected_; }
  bool answers() const override { return connected_ && link_.is_open() && !link_.lost(); }
  bool can_switch_off() const override { return map_.can_switch_off; }

  // Reads every axis, which the user has put at known angles, and says which word order and sign fit. Success: those of the map
  // do, and no other would. Needs no connect(), which believes no position that is not plausible.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  Error axis_error(Axis axis, const std::string& what) const;
  Status connected() const;
  Status open_drives(bool judge_positions);
  Status commissioned() const;
  Status beat();  // to every drive whose heartbeat is due
  Result<std::vector<std::uint16_t>> read_block(Axis axis);
  double raw_counts(Axis axis, const std::vector<std::uint16_t>& block, WordLayout layout) const;
  std::optional<bool> bit(Axis axis, const std::vector<std::uint16_t>& block, DriveBit which) const;
  std::optional<double> believed_position(Axis axis, const std::vector<std::uint16_t>& block, double now_s);
  AxisStatus status_from(Axis axis, const std::vector<std::uint16_t>& block, double position_deg, double now_s);
  struct MoveNumbers {
    double position_deg = 0.0, distance_deg = 0.0, rate_degps = 0.0, acceleration_degps2 = 0.0;
  };
  using Moves = std::array<MoveNumbers, 3>;
  Result<std::vector<std::uint16_t>> words_of(const WriteStep& step, Axis axis, const Moves& moves) const;
  Status write_list(Axis axis, DriveOperation operation, const Moves& moves);
  // In its turn of three, or once for the table.
  bool is_due(DriveOperation operation, Axis axis) const { return !map_.once(operation) || axis == Axis::heading; }
  Status write_to_all_at_once(DriveOperation operation);
  int function_for(std::size_t registers) const { return registers > 1 ? 16 : map_.write_function; }

  RegisterMap map_;
  const Clock& clock_;
  StopSignal stop_;
  ModbusLink link_;
  bool connected_ = false;
  bool was_connected_ = false;
  bool enable_called_ = false;
  bool commanded_off_ = false;  // since enable()
  std::array<AxisMemory, 3> memory_;
  std::array<std::size_t, 3> beats_{};
  Moves moves_{};             // the last of each axis, for tables that are told of all three
  bool targets_void_ = true;  // after a stop or a homing the axes stand elsewhere
};

}  // namespace turncal
