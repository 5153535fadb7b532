// The driver of every table that a file describes, by a register map (turntable_drivers/modbus/register_codec.h) or a dialect
// (turntable_drivers/ascii/sentence_codec.h): when an axis may be enabled, homed or moved, what is believed of what it says, and how it
// is stopped.
//
// - Nothing is switched on or moves before the description is commissioned, enable() was called since connect(), and the drive's own
//   state says enabled, homed, at rest, without fault, in remote.
// - A reply that is not the one asked for is an error. Readings are repeated read_retries times, the next failure is a lost link; commands are
//   never repeated. A position is believed by the rule of AxisMemory; one that is not is read again, and then an error.
// - stop_all() and abort_all() go out at once, step by step, each to every axis and waiting at most stop_ack_s; axes that did not take one are
//   asked again. They also go out on a link that counts as lost, or was closed after trouble.
// - A drive that was told to go off, or last read off, is sent abort in place of stop: a stop must not switch it on. Where a stop is of
//   the whole table it gives way to abort only when all drives are off.
// - A table that takes all three angles at once gets, with the move of one axis, the last targets of the others, or where they stand once they
//   were stopped.
// - What a device cannot tell: rate comes from two positions; enabled is what was commanded; homed is "arrived after a homing"; faults,
//   limits, emergency stop and local mode are not seen, which docs/tables.md says to the user.
// - A circle that is entered the shorter way is gone in legs of less than half of it: status() sends the next one when the last is done, and
//   says "moving" until then. A stop, a fault, or a drive that is off ends it.
// - A heartbeat, if there is one, is written with any status reading, when it is due.
// Not modelled: restarting a drive's own programs, torque limits. One thread.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "imu_io/base/clock.h"
#include "turntable_drivers/table/table_codec.h"
#include "turntable_drivers/table/table_line.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

// What a driver remembers of an axis from reading to reading, and what it makes of a new one. Plain arithmetic.
//
// - A position is believable when it is finite, within plausible_deg, and, once homed, no further from the last than
//   plausible_rate_degps allows (and 1 deg).
// - A device that tells no rate: it comes from two positions at least 50 ms apart, since one count in 1 ms would be a motion; NaN
//   (unknown, which is "not arrived") until there are two.
// - After a command to home the flag may be the old one: homed counts when the homing was seen to begin (the flag gone, the axis turning or
//   elsewhere), or from the third reading on of an axis that stands at its zero.
struct AxisMemory {
  std::optional<double> position_deg;  // last believed, cumulative
  double read_s = 0.0;
  double rate_degps = std::numeric_limits<double>::quiet_NaN();  // from two positions
  double rate_base_deg = 0.0, rate_base_s = -std::numeric_limits<double>::infinity();
  bool homed = false;        // as last reported
  bool home_called = false;  // since the link was opened
  int homing_polls = 0;
  bool homing_seen = false;
  std::optional<double> homing_from_deg;
  bool arrived_seen = false;  // of a flag that shows for a moment only
  double heartbeat_s = -1e9;
  std::optional<bool> drive_on;  // as last read; empty: not read since it was connected or switched on

  bool believable(double angle_deg, double now_s, double plausible_deg, double plausible_rate_degps) const {
    if (!(std::abs(angle_deg) <= plausible_deg)) return false;
    if (!position_deg || !homed) return true;
    const double reach_deg = 1.0 + plausible_rate_degps * std::max(0.0, now_s - read_s);
    return std::abs(angle_deg - *position_deg) <= reach_deg;
  }
  void note(double angle_deg, double now_s) {
    constexpr double shortest_interval_s = 0.05;
    if (now_s - rate_base_s >= shortest_interval_s) {
      if (std::isfinite(rate_base_s)) rate_degps = (angle_deg - rate_base_deg) / (now_s - rate_base_s);
      rate_base_deg = angle_deg;
      rate_base_s = now_s;
    }
    position_deg = angle_deg;
    read_s = now_s;
  }
  // searches: the axis has to turn to find its zero.
  void homing_began(bool searches) {
    home_called = true;
    homed = false;
    homing_polls = 3;
    homing_seen = !searches;
    homing_from_deg = position_deg;
  }
  // REQUIRES: note() has the position of this reading.
  bool judge_homed(bool device_says, bool moving) {
    constexpr double stands_deg = 1.0;
    const auto is_at = [&](double angle_deg) {
      return position_deg && std::abs(*position_deg - angle_deg) <= stands_deg;
    };
    if (home_called && !homing_seen) {
      homing_polls = std::max(0, homing_polls - 1);
      homing_seen = moving || !device_says || (homing_from_deg && !is_at(*homing_from_deg));
      homed = device_says && !moving && (homing_seen || (homing_polls == 0 && is_at(0.0)));
      homing_seen = homing_seen || homed;
      return homed;
    }
    homed = device_says;
    return homed;
  }
};

class DescribedTurntable : public Turntable {
 public:
  // Of a RegisterMap or a Dialect, in the language that codec_of() makes of it. The clock and the count must outlive the table.
  template <class Description>
  DescribedTurntable(const Description& description, const Clock& clock,
                     const std::atomic<int>* stop_requests = nullptr)
      : DescribedTurntable(description, description.link, codec_of(description), clock, stop_requests) {}

  Status connect() override;
  Result<TableIdentity> identify() override;
  Status enable() override;
  Status home() override;
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override;
  Status stop_all() override { return halt(false); }
  Status abort_all() override;
  Status clear_fault() override;
  Result<AxisStatus> status(Axis axis) override;
  void set_meanwhile(std::function<void()> meanwhile) override { stop_.set_meanwhile(std::move(meanwhile)); }
  bool was_connected() const override { return was_connected_; }
  bool answers() const override { return connected_ && !lost(); }
  bool can_switch_off() const override { return table_.can_switch_off; }
  bool tells_drives() const override { return codec_->tells(DriveBit::enabled); }

  // Reads every axis, which the user has put at known angles, and says which settings fit. Success: those of the description do, and no other
  // would. Needs no connect(), which believes no position that is not plausible.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  DescribedTurntable(const TableDescription& description, const TableLinkSettings& link,
                     std::unique_ptr<TableCodec> codec, const Clock& clock, const std::atomic<int>* stop_requests);
  bool lost() const { return lost_ || !line_.is_open(); }
  Error table_error(const std::string& what) const;
  Error axis_error(Axis axis, const std::string& what) const;
  Error given_up(Axis axis) const;
  Error about(const TableRequest& request, const Error& error) const;
  Status connected() const;
  Status commissioned() const;
  // The axis's reading; or why it must not be homed or moved now.
  Result<AxisStatus> ready(Axis axis);

  Status open(bool judge_positions);
  Status carry_out(TableOperation operation, Axis axis, const Moves& moves);
  Status carry_out(TableOperation operation);  // for all axes, or the table
  Status halt(bool off);                       // to every axis at once
  Status beat();                               // to every drive whose heartbeat is due
  Judgement read_once(Axis axis, AxisReading& reading);
  // A position of a circle is unwrapped.
  Result<AxisReading> read(Axis axis, bool believed_only);
  bool believable(Axis axis, double position_deg) const;
  AxisStatus report_of(Axis axis, const AxisReading& reading);
  Status send_move(Axis axis, const MoveNumbers& move);
  // In legs, of a circle the shorter way.
  Status send_leg(Axis axis, double from_deg);
  Status go_on(Axis axis, AxisStatus& report);

  const Clock& clock_;
  StopSignal stop_;
  const TableDescription table_;
  const TableLinkSettings link_;
  std::unique_ptr<TableCodec> codec_;
  TableLine line_;
  bool lost_ = false;
  std::string lost_reason_;
  bool connected_ = false;
  bool was_connected_ = false;
  bool enable_called_ = false;
  bool commanded_on_ = false;   // enable was sent, and no abort was taken since
  bool commanded_off_ = false;  // since enable()
  bool targets_void_ = true;    // after a stop or a homing the axes stand elsewhere
  std::array<AxisMemory, 3> memory_;
  Moves moves_;                                    // the last of each axis
  std::array<std::optional<MoveNumbers>, 3> way_;  // what the present leg is a part of
};

}  // namespace turncal
