// For tests of the rig: a perfect one, its clock, and its time.
#pragma once

#include <cmath>
#include <vector>

#include "imu_io/base/clock.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

// A rig without noise, table errors, parameter errors or quantisation: what is left is geometry, gravity and earth rate.
inline RigConfig perfect_rig_config() {
  RigConfig config;
  config.random_truth = false;
  config.quantisation = RigQuantisation::off;
  config.noise = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, config.noise.flicker_longest_s};
  config.table_errors.random_arcmin = 0.0;
  return config;
}

inline ImuSample next_sample(Rig& rig) {
  ImuSample sample;
  rig.advance({&sample, 1});
  return sample;
}
inline void pass_time(Rig& rig, double seconds) {
  std::vector<ImuSample> samples(std::size_t(std::lround(seconds / rig.config().sample_period_s)));
  if (!samples.empty()) rig.advance(samples);
}

// A clock that shows the time of one rig; a dry run has that of its RigGroup.
class RigClock : public Clock {
 public:
  explicit RigClock(const Rig& rig) : rig_(rig) {}  // the rig must outlive the clock
  double now_s() const override { return rig_.time_s(); }
  double utc_s() const override { return rig_.config().start_utc_s + rig_.time_s(); }

 private:
  const Rig& rig_;
};

}  // namespace turncal
