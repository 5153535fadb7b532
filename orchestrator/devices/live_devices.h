// The devices of a live run: the station's table and units, the machine's clocks, and waits in real time.
//
// Nothing is opened here; the run does that. clock.speed_up other than 1 is for twins (docs/tables.md): all of the station's times then
// run that much faster. A table turned by hand gets the reason of each move, and the first unit's measurement of gravity. The thread
// that makes the devices has real-time priority until they are destroyed, or the table need no longer be watched.
#pragma once

#include <Eigen/Core>

#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/units/serial_imu.h"
#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/run/station_run.h"
#include "orchestrator/station/station_config.h"
#include "orchestrator/watch/progress.h"
#include "turntable_drivers/chamber/described_chamber.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/table/limited_turntable.h"

namespace turncal {

// The table of a live run, made from the station's configuration, with the station's motion limits around it.
//
// Nothing is opened here: connect() does that. However the run ends, the destructor leaves the table at rest with its drives off, read back
// (turntable_drivers/table/table_stop.h). After kill -9 the drive's watchdog has to act. The mock has no live table (dry_run_devices.h).
class TableDevice {
 public:
  // An axis slower than standing_rate_degps is at rest.
  TableDevice(std::unique_ptr<Turntable> driver, const std::array<AxisLimits, 3>& limits, double standing_rate_degps)
      : driver_(std::move(driver)), limited_(*driver_, limits), standing_rate_degps_(standing_rate_degps) {}
  ~TableDevice();
  TableDevice(const TableDevice&) = delete;
  TableDevice& operator=(const TableDevice&) = delete;
  Turntable& table() { return limited_; }
  // Leaves the table now, so that a failure can be reported; the destructor then does nothing.
  Status leave();
  // Call it when a stop could not be verified in time and that was reported: nothing more is tried.
  void give_up() { left_ = true; }
  // The driver of a table turned by hand, which is told why a move is asked for; else null.
  ManualTurntable* manual() { return dynamic_cast<ManualTurntable*>(driver_.get()); }
  // Runs the driver's comparison with known angles; an error for a driver without one.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  std::unique_ptr<Turntable> driver_;
  LimitedTurntable limited_;
  double standing_rate_degps_;
  bool left_ = false;
};

// What the drivers need from the program. All must outlive the table.
struct TableContext {
  const Clock& clock;
  const std::atomic<int>* stop_requests = nullptr;  // a change of the count ends a wait for the device
  int operator_input = 0;                           // for a table turned by hand: file descriptor
  std::ostream* operator_output = nullptr;
  GravitySense gravity{};
};

Result<std::unique_ptr<TableDevice>> make_table(const StationConfig& station, const TableContext& context);

// Passes everything on to another source; a base for sources that add something.
class FrontImu : public ImuSource {
 public:
  explicit FrontImu(ImuSource& imu) : imu_(imu) {}  // imu must outlive this object
  Status open() override { return imu_.open(); }
  Result<ImuIdentity> identify() override { return imu_.identify(); }
  void describe(RecordingInfo& info) const override { imu_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override { return imu_.read(out, timeout_s); }
  ImuLinkCounters counters() const override { return imu_.counters(); }
  void close() override { imu_.close(); }

 protected:
  ImuSource& imu_;
};

// Passes a unit's samples on and keeps the data against which a table turned by hand is checked: the mean specific force of the last second
// (GravitySense), and the sum of the gyros (TurnSense).
//
// mean(): the accelerometers' increments per sample, in their own unit; empty before there is a second of samples, and while the
// means of its two halves differ by more than 2 % (the unit turns). The sum: degrees by the nominal scale; over lost samples
// the unit is assumed to turn as in the next one. One thread.
class GravityWatch : public FrontImu {
 public:
  GravityWatch(ImuSource& source, double sample_period_s);  // the source must outlive this

  std::optional<std::array<double, 3>> mean() const;
  std::optional<std::array<double, 3>> turned_deg() const { return counter_ ? std::optional(turned_) : std::nullopt; }

  Status open() override;
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;

 private:
  int half_samples_;
  double deg_per_count_ = 0.0;
  int count_ = 0;  // samples in the present half
  Eigen::Vector3d sum_{0, 0, 0};
  std::array<double, 3> turned_{};
  std::optional<std::int64_t> counter_;           // of the last sample
  std::optional<Eigen::Vector3d> last_, before_;  // means of the two halves
};

// Locks a station's devices for this process: its table and its units, over TCP as well as on serial lines. Call it before anything is
// opened; the locks are released when the process ends, however it ends.
//
// A device in /dev is locked by the name in the station file, not by its link's target: a process that has lost its line still holds the
// name, and ttyUSB0 may be another station's adapter by then. SerialPort excludes two names of one port.
//
// The lock files are on this machine, below /run/lock: another machine at the same table is not seen. A host's name is replaced by its
// address, and all addresses by which this machine reaches itself count as one.
// Error: kind device, with the device and who holds it.
Result<std::vector<LockFile>> lock_devices(const StationConfig& station);
// Returns the key of each device's line, and the line.
std::vector<std::pair<std::string, std::string>> device_lines(const StationConfig& station);

// Returns the lock file of a device, which is a path or HOST:PORT.
std::string lock_path_of(const std::string& device);

// Gives the thread that controls a table real-time priority, where the system allows it: a busy PC must not delay a stop.
//
// It uses SCHED_FIFO at its lowest priority, for the calling thread alone (threads that it starts are ordinary ones), and locks the memory
// of the process (mlockall). What is not allowed is skipped: a run is safe by its deadlines without it, and `turncal check`
// says what is in force. Users other than root get both by limits.conf (docs/safety.md).
class RealTime {
 public:
  RealTime();
  ~RealTime();  // restores the former state, in the same thread
  RealTime(const RealTime&) = delete;
  RealTime& operator=(const RealTime&) = delete;
  // Returns in one line what is in force, "goes before other programs (SCHED_FIFO), memory locked", and how to get what is not.
  std::string text() const;

 private:
  bool first() const { return scheduled_ == 0; }
  bool locked() const { return locked_ == 0; }
  int scheduled_, locked_;  // 0, or errno
};

class LiveClock : public Clock {
 public:
  explicit LiveClock(double speed_up) : speed_up_(speed_up) {}
  double now_s() const override { return speed_up_ * (monotonic_s() - start_s_); }  // since construction
  double utc_s() const override { return wall_utc_s(); }                            // never sped up

 private:
  double speed_up_, start_s_ = monotonic_s();
};

class LiveDevices {
 public:
  // REQUIRES station.imu, units <= station.imu_places(). The count and the stream (for prompts of a table turned by hand, answered at the
  // terminal) must outlive the devices.
  static Result<std::unique_ptr<LiveDevices>> make(const StationConfig& station, const std::atomic<int>& stop_requests,
                                                   std::ostream& out, std::size_t units = 1);
  StationDevices devices();  // valid as long as this object
  ImuSource& imu(std::size_t place) { return place == 0 ? static_cast<ImuSource&>(watched_) : *further_[place - 1]; }
  std::string unit_summary(std::size_t place) const { return (place == 0 ? imu_ : *further_[place - 1]).summary(); }
  // Returns a unit's clock error against the host's; empty while it is unknown, and for a twin that runs at another pace.
  std::optional<ArrivalEstimate> unit_clock(std::size_t place) const {
    const auto clock = (place == 0 ? imu_ : *further_[place - 1]).clock();
    return clock && clock->skew_uncertainty > 0.0 && speed_up_ == 1.0 ? clock : std::nullopt;
  }
  // Waits for at most 20 ms, so that the caller notices a stop in time; a signal ends it earlier.
  static void wait_a_little(double wall_s);
  Status commission_table(const AxisTriple& known_deg, double tolerance_deg) {
    return table_->commission(known_deg, tolerance_deg);
  }

  // Leaves the table at rest with its drives off, read back. Returns the error of `done` with how it was left, or that this was not verified.
  // The table must not be used afterwards.
  Status leave_table(Status done, const std::string& how_left = "");
  bool left_off() const { return left_off_; }  // leave_table() has verified it
  void give_table_up() { table_->give_up(); }
  // Checks whether an axis turns now that its drive is off: reads it again 2.5 station seconds after `left` (none: after a reading now),
  // and returns how far it turned. Empty: all stand, or cannot be read.
  std::string sag_since(const std::optional<TableStatus>& left);
  void end_real_time() { real_time_.reset(); }  // call it with the drives off, when time no longer matters

  DescribedChamber* chamber() { return chamber_.get(); }  // null: the station has none
  // Returns the operator's prompts of a table turned by hand; else null. The sequence must outlive the devices.
  OperatorPrompts* prompts();

 private:
  LiveDevices(const StationConfig& station, std::size_t units, std::vector<LockFile> locks);

  std::vector<LockFile> locks_;  // outlive the devices
  std::optional<RealTime> real_time_{std::in_place};
  double speed_up_;
  bool left_off_ = false;
  LiveClock clock_;
  SerialImu imu_;
  GravityWatch watched_;
  std::vector<std::unique_ptr<SerialImu>> further_;
  std::unique_ptr<DescribedChamber> chamber_;  // outlives the table, which is left first
  std::unique_ptr<TableDevice> table_;
  std::unique_ptr<OperatorPrompts> prompts_;
};

}  // namespace turncal
