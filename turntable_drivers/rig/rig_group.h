// Several units on one table: a rig for each, in lockstep. One table gives every rig the same commands at the same sample; each
// unit is an ImuSource of its own; time is that of the group.
//
// Reading any unit makes time pass for all: what the others deliver meanwhile waits for whoever reads them. A read first gives
// what waits, and counts the time in which that came as waited. What nobody reads is lost beyond group_buffer_samples. A unit
// that is unplugged loses what it would have sent until it is opened again; the others, and the table, go on.
// A group of one is a rig with RigTable and RigImu. Same errors of the table for all, rig_of_unit() for the rest.
// One thread.
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
  void bring_up_all();             // every rig to the group's time
  void pass_until(double time_s);  // nobody reads a unit meanwhile: what they send is lost

 private:
  struct Member;
  std::int64_t samples_passed() const;  // of the rig that is furthest
  void bring_up(Member& member);        // to the group's time

  double period_s_;
  std::vector<std::unique_ptr<Member>> members_;
  std::unique_ptr<Turntable> table_;
};

}  // namespace turncal
