// Several units on one table: one rig for each, in lockstep. The table gives every rig the same commands at the same sample; each
// unit is an ImuSource of its own; the group has one time.
//
// Reading any unit makes time pass for all; samples of the others are buffered until they are read. A read first returns
// buffered samples, and counts the time in which they came against its timeout. Beyond group_buffer_samples unread samples are lost. An
// unplugged unit loses its samples until it is opened again; the other units and the table go on.
// A group of one is a rig with RigTable and RigImu. Table errors are the same for all units; the rest is in rig_of_unit().
// Single-threaded.
#pragma once

#include <memory>
#include <vector>

#include "imu_io/base/clock.h"
#include "imu_io/recordings/imu_source.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {

inline constexpr std::size_t group_buffer_samples = 65536;

class RigGroup : public Clock {
 public:
  // REQUIRES: check(config).ok(), units > 0
  RigGroup(const RigConfig& config, std::size_t units);
  ~RigGroup() override;
  RigGroup(const RigGroup&) = delete;
  RigGroup& operator=(const RigGroup&) = delete;

  std::size_t size() const { return members_.size(); }
  Rig& rig(std::size_t unit);
  ImuSource& imu(std::size_t unit);
  Turntable& table() { return *table_; }

  double now_s() const override { return double(samples_passed()) * period_s_; }
  double utc_s() const override;
  void bring_up_all();             // brings every rig to the group's time
  void pass_until(double time_s);  // lets time pass with no unit being read: their samples are lost

 private:
  struct Member;
  std::int64_t samples_passed() const;  // of the most advanced rig
  void bring_up(Member& member);        // brings it to the group's time

  double period_s_;
  std::vector<std::unique_ptr<Member>> members_;
  std::unique_ptr<Turntable> table_;
};

}  // namespace turncal
