// The driver of every table that a file describes, by a register map (turntable_drivers/modbus/register_codec.h) or a dialect
// (turntable_drivers/ascii/sentence_codec.h). It decides when an axis may be enabled, homed or moved, which readings are believed, and how
// the axis is stopped.
//
// - Nothing is enabled or moves unless the description is commissioned, enable() was called since connect(), and the drive itself
//   reports enabled, homed, at rest, no fault and remote control.
// - A reply to another request is an error. A failed reading is repeated read_retries times, then the link counts as lost; commands are
//   never repeated. AxisMemory decides which positions are believed; one that is not is read again, and finally an error.
// - stop_all() and abort_all() are sent at once, step by step, each step to every axis, waiting at most stop_ack_s. Axes without an
//   acknowledgement get them again. They are also sent on a link that counts as lost or was closed after trouble.
// - A drive that was commanded off, or last read off, gets abort instead of stop, since a stop might enable it. A stop of
//   the whole table is replaced by abort only if all drives are off.
// - A table that takes all three angles at once gets, with a move of one axis, the last targets of the others, or their positions after
//   a stop.
// - What a device does not report: the rate is computed from two positions; enabled is what was commanded; homed is "arrived after a
//   homing"; faults, limits, emergency stop and local mode stay unseen, which docs/tables.md tells the user.
// - A long move of a circular axis that takes the shorter way is made in legs of less than half a turn. status() sends the next leg when one
//   is done, and reports "moving" until the last. A stop, a fault, or a disabled drive ends the move.
// - A heartbeat, if there is one, is sent before a status reading when it is due.
// Not modelled: restarting a drive's own programs, torque limits. Single-threaded.
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

// What a driver remembers of an axis between readings, and how it judges a new one. Plain arithmetic.
//
// - A position is believable if it is finite, within plausible_deg and, once homed, within reach of the last one at
//   plausible_rate_degps (plus 1 deg).
// - If a device reports no rate, it is computed from two positions at least 50 ms apart, since one count in 1 ms would look like motion. It
//   is NaN (unknown, hence "not arrived") until there are two.
// - After a command to home, the flag may be stale: homed counts once the homing was seen to begin (the flag cleared, the axis turning or
//   displaced), or from the third reading on if the axis stands at its zero.
struct AxisMemory {
  std::optional<double> position_deg;  // last believed one, cumulative
  double read_s = 0.0;
  double rate_degps = std::numeric_limits<double>::quiet_NaN();  // from two positions
  double rate_base_deg = 0.0, rate_base_s = -std::numeric_limits<double>::infinity();
  bool homed = false;        // as last reported to the caller
  bool home_called = false;  // since the link was opened
  int homing_polls = 0;
  bool homing_seen = false;
  std::optional<double> homing_from_deg;
  bool arrived_seen = false;  // for a flag that is set only briefly
  double heartbeat_s = -1e9;
  std::optional<bool> drive_on;  // as last read; empty: not read since connect() or enable()

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
  // searches: the axis must turn to find its zero.
  void homing_began(bool searches) {
    home_called = true;
    homed = false;
    homing_polls = 3;
    homing_seen = !searches;
    homing_from_deg = position_deg;
  }
  // REQUIRES: note() was called with the position of this reading.
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
  // Takes a RegisterMap or a Dialect; codec_of() makes its codec. The clock and the count must outlive the table.
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

  // Reads every axis, which the user has set to known angles, and reports which settings fit. Succeeds if those of the description fit and no
  // others do. connect() is not needed, as it accepts only plausible positions.
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
  // Returns the axis's status, or an error that says why it must not be homed or moved now.
  Result<AxisStatus> ready(Axis axis);

  Status open(bool judge_positions);
  Status carry_out(TableOperation operation, Axis axis, const Moves& moves);
  Status carry_out(TableOperation operation);  // for all axes, or the table
  Status halt(bool off);                       // sent to every axis at once
  Status beat();                               // to every drive whose heartbeat is due
  Judgement read_once(Axis axis, AxisReading& reading);
  // Reads an axis and unwraps the position of a circular one.
  Result<AxisReading> read(Axis axis, bool believed_only);
  bool believable(Axis axis, double position_deg) const;
  AxisStatus report_of(Axis axis, const AxisReading& reading);
  Status send_move(Axis axis, const MoveNumbers& move);
  // Sends the next leg of a move that takes the shorter way.
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
  bool commanded_on_ = false;   // enable was sent, and no abort was acknowledged since
  bool commanded_off_ = false;  // since enable()
  bool targets_void_ = true;    // after a stop or a homing the axes are not at their targets
  std::array<AxisMemory, 3> memory_;
  Moves moves_;                                    // the last move of each axis
  std::array<std::optional<MoveNumbers>, 3> way_;  // the whole move to which the present leg belongs
};

}  // namespace turncal
