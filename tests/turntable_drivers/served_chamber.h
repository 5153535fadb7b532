// For tests of chambers: a rig, its chamber, a twin that shows it as a real one, a server in a thread of its own, and the driver.
#pragma once

#include <atomic>
#include <thread>

#include <gtest/gtest.h>

#include "tests/test.h"
#include "turntable_drivers/twins/chamber_twin.h"
#include "turntable_drivers/twins/rig_chamber.h"

namespace turncal {

inline const std::string chamber_limits_text = "limits.low_c = -40\nlimits.high_c = 85\nlimits.ramp_c_per_min = 3\n";
// Of our own invention: floats with swapped words, a status word with three bits.
inline std::string registers_text(const std::string& kind) {
  return "format = 1\nname = own\ncommissioned = true\nlanguage = registers\nlink.kind = " + kind +
         "\nlink.address = 127.0.0.1:1\nlink.unit = 5\nlink.response_timeout_s = 0.15\nlink.byte_timeout_s = 0.03\n"
         "link.quiet_s = 0.12\nread.function = 4\nwords.order = low_first\nread.actual = 100 f32\nread.set_point = 102 "
         "s16\n"
         "read.set_point.scale = 10\nread.on = 104 u16\nread.on.mask = 0x3\nread.on.values = 2\nread.door = 104 "
         "u16\nread.door.mask = 0x4\n"
         "read.alarm = 104 u16\nread.alarm.mask = 0x8\nwrite.set_point = 200 s16\nwrite.set_point.scale = "
         "10\nwrite.ramp = 201 u16\n"
         "write.ramp.scale = 100\nwrite.on = 210 u16 2, 211 u16 7\nwrite.off = 210 u16 0\n" +
         chamber_limits_text;
}
inline std::string sentences_text(const std::string& kind) {
  return "format = 1\nname = own\ncommissioned = true\nlanguage = sentences\nlink.kind = " + kind +
         "\nlink.address = 127.0.0.1:1\nlink.reply_timeout_s = 0.15\nlink.quiet_s = 0.12\nlink.terminator_in = \\r\\n\n"
         "link.check = sum8\nnumber.decimals = 2\nread.actual = T?\nread.actual.expect = T={value},{*}\nread.set_point "
         "= S?\n"
         "read.set_point.expect = S={value}\nread.on = M?\nread.on.expect = M={value}\nread.on.values = RUN\nread.door "
         "= D?\n"
         "read.door.expect = D={value}\nread.door.values = 1\nread.alarm = A?\nread.alarm.expect = "
         "A={value}\nread.alarm.values = 1\n"
         "write.set_point = S {value}\nwrite.set_point.expect = OK\nwrite.ramp = R {value}\nwrite.ramp.expect = OK\n"
         "write.on = RUN\nwrite.on.expect = OK\nwrite.off = STOP\nwrite.off.expect = OK\n" +
         chamber_limits_text;
}

struct ServedChamber {
  explicit ServedChamber(const std::string& text, const RigConfig& config = default_rig_config())
      : described(expect_value(parse_chamber(text, "own.chamber"))),
        group(config, 1),
        simulated(group, described.limits),
        twin(described, simulated) {
    EXPECT_OK(described.link().tcp ? twin.listen_tcp(0) : twin.open_pty(""));
    described.reach(twin.address());
    driver = std::make_unique<DescribedChamber>(described);
    start();
  }
  ~ServedChamber() {
    driver.reset();
    stop();
  }
  void pass(double seconds) {
    const std::lock_guard lock(twin.mutex);
    group.pass_until(group.now_s() + seconds);
  }
  void disturb(std::function<void(bool, AnswerPlan&)> how) {
    stop();
    twin.disturb = std::move(how);
    start();
  }
  void hang_up() {
    stop();
    twin.hang_up();
    start();
  }
  bool heats() {
    const std::lock_guard lock(twin.mutex);
    return group.rig(0).chamber().on;
  }

  ChamberDescription described;
  RigGroup group;
  RigChamber simulated;
  ChamberTwin twin;
  std::unique_ptr<DescribedChamber> driver;

 private:
  void start() {
    ended_ = false;
    thread_ = std::thread([this] {
      while (!ended_) twin.run_once(0.01);
    });
  }
  void stop() {
    ended_ = true;
    thread_.join();
  }
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace turncal
