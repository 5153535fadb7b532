// ModbusTurntable: three drives behind Modbus TCP or RTU, wholly described by a RegisterMap.
//
// Beside the rules of described_turntable.h:
// - A position needs a block that was read whole. One that is not believed is read again, and then it is an error.
// - commission() against a known angle shows what scale, sign and word order give; the user then writes `commissioned = true`.
// - stop_all() and abort_all() go to every axis at once, each waiting at most stop_ack_s for the answer; those that did not answer
//   are asked again, after the line was read empty. They also go out on a link that counts as lost, or was closed after trouble.
// - A table that takes all three angles in one block gets, with the move of one axis, the last targets of the others, or where they
//   stand once they were stopped.
// - Where a stop is of the whole table it gives way to write.abort only when all drives are off.
// - The heartbeat, if the map has one, is written to every drive with any status reading, when it is due.
// - homed is believed only after the homing was seen to begin, or three readings after the command.
//
// Not modelled: restarting a drive's own programs, torque limits. One thread.
#pragma once

#include <array>
#include <atomic>
#include <optional>

#include "turntable_drivers/modbus/modbus_link.h"
#include "turntable_drivers/modbus/move_words.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/described_turntable.h"

namespace turncal {

class ModbusTurntable : public DescribedTurntable {
 public:
  // The clock and the count must outlive the table.
  ModbusTurntable(RegisterMap map, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;

  // Reads every axis, which the user has put at known angles, and says which word order and sign fit. Success: those of the map
  // do, and no other would. Needs no connect(), which believes no position that is not plausible.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  bool lost() const override { return link_.lost() || !link_.is_open(); }
  std::string lost_reason() const override { return link_.lost_reason(); }
  Status halt(bool off) override;
  Status open_drives(bool judge_positions);
  Status beat();  // to every drive whose heartbeat is due
  Result<std::vector<std::uint16_t>> read_block(Axis axis);
  double raw_counts(Axis axis, const std::vector<std::uint16_t>& block, WordLayout layout) const;
  std::optional<bool> bit(Axis axis, const std::vector<std::uint16_t>& block, DriveBit which) const;
  std::optional<double> believed_position(Axis axis, const std::vector<std::uint16_t>& block) const;
  AxisStatus status_from(Axis axis, const std::vector<std::uint16_t>& block, double position_deg, double now_s);
  Status write_list(Axis axis, DriveOperation operation, const Moves& moves);
  // In its turn of three, or once for the table.
  bool is_due(DriveOperation operation, Axis axis) const { return !map_.once(operation) || axis == Axis::heading; }
  int function_for(std::size_t registers) const { return registers > 1 ? 16 : map_.write_function; }

  RegisterMap map_;
  ModbusLink link_;
  std::array<std::size_t, 3> beats_{};
  Moves moves_{};  // the last of each axis, for tables that are told of all three
};

}  // namespace turncal
