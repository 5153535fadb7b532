// RigClock: the station's clock in a dry run is the rig's time, which makes a run give the same bytes every time.
#pragma once

#include "imu_io/base/clock.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {

class RigClock : public Clock {
 public:
  explicit RigClock(const Rig& rig) : rig_(rig) {}  // the rig must outlive the clock
  double now_s() const override { return rig_.time_s(); }
  double utc_s() const override { return rig_.config().start_utc_s + rig_.time_s(); }

 private:
  const Rig& rig_;
};

}  // namespace turncal
