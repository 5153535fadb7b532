// SerialTurntable: a three-axis table that speaks an ASCII dialect over a serial line or TCP, wholly described by a Dialect.
//
// Beside the rules of described_turntable.h:
// - An answer has to match its template, a number has to be a number, a status has to be known; else it is an error, or "not
//   arrived". Readings are repeated read_retries times; the next failure is a lost link. Commands are never repeated.
// - Rate comes from two positions where the device tells none.
// - stop_all() and abort_all() go out at once, whatever the line is doing; axes that did not answer are asked again.
// - What the device cannot tell: enabled is what was commanded; homed is "arrived after a homing"; faults, limits, emergency stop and
//   local mode are not seen, which docs/tables.md says to the user.
// - A circle that is entered the shorter way (axis.NAME.way) is gone in legs of less than half of it: status() sends the next one when
//   the last is done, and says "moving" until then. A stop, a fault, or a drive that is off ends it.
// One thread.
#pragma once

#include <array>
#include <atomic>
#include <map>
#include <optional>
#include <string>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/ascii/move_sentence.h"
#include "turntable_drivers/ascii/text_line.h"
#include "turntable_drivers/table/described_turntable.h"

namespace turncal {

class SerialTurntable : public DescribedTurntable {
 public:
  // The clock and the count must outlive the table.
  SerialTurntable(Dialect dialect, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status clear_fault() override;
  bool tells_drives() const override { return dialect_.status.reports(DriveBit::enabled); }
  Result<AxisStatus> status(Axis axis) override;

  // Reads every axis, which the user has put at known angles: sign and scale fit, or what would.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  using Values = std::map<std::string, std::string>;
  struct Reading {
    double position_deg = 0.0;
    std::optional<double> rate_degps;
    DialectFlags flags;
  };
  bool lost() const override { return lost_ || !line_.is_open(); }
  std::string lost_reason() const override { return lost_reason_; }
  Status halt(bool off) override;
  // One exchange; the values of the answer, checked for errors of the device and for the axis.
  Result<Values> talk(const Exchange& exchange, Axis axis, const Moves& moves);
  Status carry_out(DialectOperation operation, Axis axis,
                   const Moves& moves);  // of one axis, or the table
  Status carry_out_for_all(DialectOperation operation);
  Result<Reading> read_once(Axis axis);
  Result<Reading> read(Axis axis, bool believed_only);
  // In legs, of a circle the shorter way.
  Status send_move(Axis axis, const MoveNumbers& move);
  Status send_leg(Axis axis, double from_deg);
  Status go_on(Axis axis, AxisStatus& report);
  Result<double> number(Axis axis, const Values& values, const std::string& quantity) const;

  Dialect dialect_;
  TextLine line_;
  bool lost_ = false;
  std::string lost_reason_;
  bool commanded_on_ = false;                      // enable was sent, and no abort was taken since
  Moves moves_;                                    // the last of each axis
  std::array<std::optional<MoveNumbers>, 3> way_;  // what the present leg is a part of
};

}  // namespace turncal
