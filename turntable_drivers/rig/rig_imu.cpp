#include "turntable_drivers/rig/rig_imu.h"

#include <algorithm>
#include <cmath>

namespace turncal {

RigImu::RigImu(Rig& rig) : rig_(rig) {}

Status RigImu::open() {
  rig_.plug_imu();
  open_ = true;
  return {};
}

Result<ImuIdentity> RigImu::identify() {
  if (!open_) return device_error("simulated unit: identify before open");
  return ImuIdentity{rig_.config().unit_serial,
                     "simulated unit, seed " + std::to_string(rig_.config().unit_seed.value_or(rig_.config().seed))};
}

void RigImu::describe(RecordingInfo& info) const {
  info.sample_period_s = rig_.config().sample_period_s;
  info.gyro_increment = IncrementKind::pulses;
  info.accel_increment = IncrementKind::pulses;
  info.accel_pulse_mps = rig_.config().accel_pulse_mps;
  info.has_temperature = true;
  info.simulated = true;
}

Result<std::size_t> RigImu::read(std::span<ImuSample> out, double timeout_s) {
  if (!open_) return device_error("simulated unit: read before open");
  if (rig_.imu_unplugged()) {
    open_ = false;
    return device_error("simulated unit: the link was lost at " + std::to_string(rig_.time_s()) + " s of rig time");
  }
  // The small addend: 0.1 s of 5 ms samples are 20, whatever the division rounds to.
  const double wanted = std::floor(timeout_s / rig_.config().sample_period_s + 1e-6);
  const double room = static_cast<double>(out.size());
  const std::int64_t samples = wanted > 0.0 ? static_cast<std::int64_t>(std::min(wanted, room)) : 0;
  const std::size_t delivered = rig_.advance_time(samples, out);
  counters_.samples += delivered;
  for (const ImuSample& sample : out.first(delivered)) {
    if (have_counter_) {
      const std::int64_t ahead = sample.counter - last_counter_;
      if (ahead <= 0) {
        ++counters_.duplicates;
      } else {
        counters_.lost_samples += static_cast<std::uint64_t>(ahead - 1);
      }
    }
    have_counter_ = true;
    last_counter_ = sample.counter;
  }
  return delivered;
}

ImuLinkCounters RigImu::counters() const { return counters_; }
void RigImu::close() { open_ = false; }

}  // namespace turncal
