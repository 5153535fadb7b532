// The table of a live run, made from the station's configuration, with the station's motion limits around it.
//
// Nothing is opened here: connect() does that. Whatever ends the run, an exception too, the table is left at rest with its drives off,
// read back, when this object goes (turntable_drivers/table/table_stop.h); what ends the process without that (kill -9) is the affair of the drive's watchdog. The mock has no live table; a dry run makes its own (dry_run_devices.h).
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <ostream>

#include "imu_io/base/clock.h"
#include "imu_io/recordings/imu_source.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/manual/manual_turntable.h"
#include "turntable_drivers/table/limited_turntable.h"
#include "turntable_drivers/table/turntable.h"

namespace turncal {

class TableDevice {
 public:
  // Slower than that an axis stands.
  TableDevice(std::unique_ptr<Turntable> driver, const std::array<AxisLimits, 3>& limits, double standing_rate_degps)
      : driver_(std::move(driver)), limited_(*driver_, limits), standing_rate_degps_(standing_rate_degps) {}
  ~TableDevice();
  TableDevice(const TableDevice&) = delete;
  TableDevice& operator=(const TableDevice&) = delete;
  Turntable& table() { return limited_; }
  // Leaves it now, so that a failure can be told; it is not done again.
  Status leave();
  // A stop could not be verified in its time, and was said to be: nothing more is tried.
  void give_up() { left_ = true; }
  // Of a table turned by hand, to say why a move is asked for; else null.
  ManualTurntable* manual() { return dynamic_cast<ManualTurntable*>(driver_.get()); }
  // The driver's comparison with known angles; an error for a driver that has none.
  Status commission(const AxisTriple& known_deg, double tolerance_deg);

 private:
  std::unique_ptr<Turntable> driver_;
  LimitedTurntable limited_;
  double standing_rate_degps_;
  bool left_ = false;
};

// What the drivers need of the program. All must outlive the table.
struct TableContext {
  const Clock& clock;
  const std::atomic<int>* stop_requests = nullptr;  // a change of the count cuts a wait for the device short
  int operator_input = 0;                           // of a table turned by hand: file descriptor
  std::ostream* operator_output = nullptr;
  GravitySense gravity{};
};

Result<std::unique_ptr<TableDevice>> make_table(const StationConfig& station, const TableContext& context);

// Passes a unit's samples on and keeps what a table turned by hand is compared with: the mean specific force of the last second
// (GravitySense), and what the gyros have added up to (TurnSense).
//
// Mean of the accelerometers' increments, per sample, in their own unit; empty before there is a second of samples, and while the
// means of its two halves differ by more than 2 % (the unit turns). The sum: degrees by the nominal scale; through samples that were lost
// the unit turned on as in the next one. One thread.
class GravityWatch : public ImuSource {
 public:
  GravityWatch(ImuSource& source, double sample_period_s);  // the source must outlive this

  std::optional<std::array<double, 3>> mean() const;
  std::optional<std::array<double, 3>> turned_deg() const { return counter_ ? std::optional(turned_) : std::nullopt; }

  Status open() override;
  Result<ImuIdentity> identify() override { return source_.identify(); }
  void describe(RecordingInfo& info) const override { source_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return source_.counters(); }
  void close() override { source_.close(); }

 private:
  ImuSource& source_;
  int half_samples_;
  int count_ = 0;  // of the half that is being filled
  std::array<double, 3> sum_{};
  std::array<double, 3> turned_{};
  std::optional<std::int64_t> counter_;  // of the last sample
  double deg_per_count_ = 0.0;
  std::optional<std::array<double, 3>> last_, before_;  // means of the two halves
};

}  // namespace turncal
