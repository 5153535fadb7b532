// The devices of a live run: the station's table and units, the machine's clocks, and waiting that really waits.
//
// Nothing is opened here; the run does that. clock.speed_up other than 1 is for twins (docs/twin.md): all of the station's times then
// run so many times faster. A table turned by hand is given the reason of each move, and what the first unit
// senses of gravity. The thread that makes them goes before others until they go, or the table need not be watched any more.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/units/serial_imu.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/devices/table_device.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/chamber/described_chamber.h"

namespace turncal {

// One process at a time uses a station's devices: its table and its units, over TCP as well as on serial lines. Taken before anything is
// opened, released when the process ends, however it ends.
//
// A device in /dev goes by the name that the station says, not by what its links lead to: who has lost its line still holds the name, and
// ttyUSB0 may be another station's adapter by then. Two names of one port are kept apart by the port (SerialPort).
//
// A lock file of this machine for each device, below /run/lock: another machine at the same table is not seen. The name of a table's host is
// that of its address; all addresses by which this machine reaches itself are one.
class StationLock {
 public:
  // Error: kind device, names the device and who holds it.
  static Result<StationLock> acquire(const StationConfig& station);

 private:
  std::vector<LockFile> locks_;
};

// The lock file of a device: a path or HOST:PORT.
std::string lock_path_of(const std::string& device);

// Lets the thread that holds a table go before all others, where the system allows it: a busy PC must not hold up a stop.
//
// SCHED_FIFO at its lowest priority, for the calling thread alone (threads that it starts are ordinary ones), and the memory of the process
// kept from being swapped out (mlockall). What is not allowed is left out: a run is safe by its deadlines without it, and `turncal check`
// says what there is. Whoever is no root gets both by limits.conf (docs/safety.md).
class RealTime {
 public:
  RealTime();
  ~RealTime();  // as it was, in the same thread
  RealTime(const RealTime&) = delete;
  RealTime& operator=(const RealTime&) = delete;
  // "goes before other programs (SCHED_FIFO), memory locked": in one line what there is, and what to do for what there is not.
  std::string text() const;

 private:
  bool first() const { return scheduled_ == 0; }
  bool locked() const { return locked_ == 0; }
  int scheduled_, locked_;  // 0, or errno
};

class LiveClock : public Clock {
 public:
  explicit LiveClock(double speed_up);
  double now_s() const override;  // CLOCK_MONOTONIC since construction, times speed_up
  double utc_s() const override;  // CLOCK_REALTIME, never sped up

 private:
  double speed_up_;
  double start_s_;
};

class LiveDevices {
 public:
  // REQUIRES: station.imu, units <= station.imu_places(). The count and the stream (prompts of a table turned by hand, whose answers are read from the terminal)
  // must outlive the devices.
  static Result<std::unique_ptr<LiveDevices>> make(const StationConfig& station, const std::atomic<int>& stop_requests,
                                                   std::ostream& out, std::size_t units = 1);
  StationDevices devices();  // valid as long as this object
  ImuSource& imu(std::size_t place) { return place == 0 ? static_cast<ImuSource&>(watched_) : *further_[place - 1]; }
  std::string unit_summary(std::size_t place) const { return (place == 0 ? imu_ : *further_[place - 1]).summary(); }
  // The clock of a unit against the host's; empty as long as it is not known, and of a twin that runs at another pace.
  std::optional<ArrivalEstimate> unit_clock(std::size_t place) const {
    const auto clock = (place == 0 ? imu_ : *further_[place - 1]).clock();
    const bool known = clock && clock->skew_uncertainty > 0.0 && speed_up_ == 1.0;
    return known ? clock : std::nullopt;
  }
  // At most 20 ms, so that whoever waits finds out about a stop in time; a signal ends it earlier.
  static void wait_a_little(double wall_s);
  Status commission_table(const AxisTriple& known_deg, double tolerance_deg) {
    return table_->commission(known_deg, tolerance_deg);
  }

  // At rest with its drives off, read back; an error: that of what was done, with how it was left, or that it could not be verified.
  // Nobody may use the table afterwards.
  Status leave_table(Status done, const std::string& how_left = "");
  bool left_off() const { return left_off_; }  // leave_table() has verified it
  void give_table_up() { table_->give_up(); }
  // Whether an axis turns now that its drive is off: looks once more, 2.5 s of the station after it read like this (none: as it reads now),
  // and says how far it turned. Empty: all stand, or cannot be read.
  std::string sag_since(const std::optional<TableStatus>& left);
  void end_real_time() { real_time_.reset(); }  // the table rests with its drives off: what comes may take its time

  DescribedChamber* chamber() { return chamber_.get(); }  // null: the station has none
  // Of a table turned by hand: what its operator is told; else null. The sequence must outlive the devices.
  OperatorPrompts* prompts();

 private:
  LiveDevices(const StationConfig& station, std::size_t units, StationLock lock);

  StationLock lock_;  // outlives the devices
  std::optional<RealTime> real_time_{std::in_place};
  double speed_up_;
  bool left_off_ = false;
  LiveClock clock_;
  SerialImu imu_;
  GravityWatch watched_;
  std::vector<std::unique_ptr<SerialImu>> further_;
  std::unique_ptr<DescribedChamber> chamber_;  // outlives the table: that is left first
  std::unique_ptr<TableDevice> table_;
  std::unique_ptr<OperatorPrompts> prompts_;
};

}  // namespace turncal
