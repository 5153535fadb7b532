// A clock that shows the time of one rig; a dry run has that of its RigGroup.
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
