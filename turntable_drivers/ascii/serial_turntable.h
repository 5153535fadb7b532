// SerialTurntable: a three-axis table that speaks an ASCII dialect over a serial line or TCP, wholly described by a Dialect.
//
// Beside the rules of turntable.h, and as ModbusTurntable does:
// - An answer has to match its template, a number has to be a number, a status has to be known; else it is an error, or "not
//   arrived". Readings are repeated read_retries times; the next failure is a lost link. Commands are never repeated.
// - A position is believed by axis_memory.h's rule. Rate comes from two positions where the device tells none.
// - Nothing moves before the dialect is commissioned, enable() was called since connect(), and the axis is homed and at rest.
// - stop_all() and abort_all() go out at once, whatever the line is doing; axes that did not answer are asked again. Once the drives
//   were told to go off, or all read off, a stop is another abort: it must not switch them on.
// - What the device cannot tell: enabled is what was commanded; homed is "arrived after a homing"; faults, limits, emergency stop and
//   local mode are not seen, which docs/tables.md says to the user.
// - A circle that is entered the shorter way (axis.NAME.way) is gone in legs of less than half of it: status() sends the next one when
//   the last is done, and says "moving" until then. A stop, a fault, or a drive that is off ends it.
// One thread.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "imu_io/base/clock.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/ascii/text_line.h"
#include "turntable_drivers/table/axis_memory.h"
#include "turntable_drivers/table/stop_signal.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class SerialTurntable : public Turntable {
 public:
  // The clock and the count must outlive the table.
  SerialTurntable(Dialect dialect, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);

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
  bool answers() const override { return connected_ && line_.is_open() && !lost_; }
  bool can_switch_off() const override { return dialect_.can_switch_off; }

  // Reads every axis, which the user has put at known angles: sign and scale fit, or what would.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  struct Command {
    double position_deg = 0.0, rate_degps = 1.0, acceleration_degps2 = 1.0, distance_deg = 0.0;
  };
  using Values = std::map<std::string, std::string>;
  struct Reading {
    double position_deg = 0.0;
    std::optional<double> rate_degps;
    DialectFlags flags;
  };
  Error table_error(const std::string& what) const;
  Error axis_error(Axis axis, const std::string& what) const;
  Status connected() const;
  Status commissioned() const;
  std::string filled(const SentenceTemplate& sentence, Axis axis, const std::array<Command, 3>& commands) const;
  // One exchange; the values of the answer, checked for errors of the device and for the axis.
  Result<Values> talk(const Exchange& exchange, Axis axis, const std::array<Command, 3>& commands);
  Status carry_out(DialectOperation operation, Axis axis,
                   const std::array<Command, 3>& commands);  // of one axis, or the table
  Status carry_out_for_all(DialectOperation operation);
  Status carry_out_at_once(DialectOperation operation);
  Result<Reading> read_once(Axis axis);
  Result<Reading> read(Axis axis, bool believed_only);
  // In legs, of a circle the shorter way.
  Status send_move(Axis axis, const Command& command);
  Status send_leg(Axis axis, double from_deg);
  Status go_on(Axis axis, AxisStatus& report);
  Result<double> number(Axis axis, const Values& values, const std::string& quantity) const;

  Dialect dialect_;
  const Clock& clock_;
  StopSignal stop_;
  TextLine line_;
  bool connected_ = false;
  bool lost_ = false;
  std::string lost_reason_;
  bool was_connected_ = false;
  bool enable_called_ = false;
  bool commanded_off_ = false;  // since enable()
  bool commanded_on_ = false;   // enable was sent, and no abort was taken since
  std::array<AxisMemory, 3> memory_;
  std::array<Command, 3> commands_;            // the last of each axis
  std::array<std::optional<Command>, 3> way_;  // what the present leg is a part of
  bool targets_void_ = false;                  // after a stop or a homing the axes stand elsewhere
};

}  // namespace turncal
