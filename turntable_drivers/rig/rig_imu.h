// RigImu: the unit on the rig as an ImuSource. read() is what makes the rig's time pass.
//
// read(out, timeout_s) advances the rig by min(out.size(), floor(timeout_s / period)) samples at most, and returns
// them; nothing else advances time. Where a fault loses samples fewer come back than time has passed, and none at all
// while the unit is silent.
#pragma once

#include "imu_io/recordings/imu_source.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

class RigImu : public ImuSource {
 public:
  explicit RigImu(Rig& rig);  // the rig must outlive the source

  Status open() override;
  Result<ImuIdentity> identify() override;
  // pulses, period and pulse weight of the rig's configuration, temperature, simulated = true.
  void describe(RecordingInfo& info) const override;
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override;
  void close() override;

 private:
  Rig& rig_;
  bool open_ = false;
  bool have_counter_ = false;
  std::int64_t last_counter_ = 0;
  ImuLinkCounters counters_;
};

}  // namespace turncal
