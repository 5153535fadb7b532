// For tests of the ASCII driver: a rig, its mock table, the twin that speaks a dialect, and a server in a thread of its own.
#pragma once

#include <atomic>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "turntable_drivers/dialect_twin.h"
#include "turntable_drivers/rig_clock.h"
#include "turntable_drivers/rig_imu.h"
#include "turntable_drivers/rig_table.h"
#include "turntable_drivers/serial_turntable.h"

namespace turncal {

inline Dialect shipped_dialect(const std::string& name, bool tcp = false) {
  const Result<Dialect> read = read_dialect(std::string(TURNCAL_SOURCE_DIR) + "/turntable_drivers/dialects/" + name + ".dialect");
  EXPECT_TRUE(read.ok()) << (read.ok() ? "" : read.error().message);
  if (!read) return {};
  Dialect dialect = *read;
  EXPECT_FALSE(dialect.verified_on_hardware);
  EXPECT_FALSE(dialect.commissioned);
  dialect.commissioned = true;
  dialect.link.tcp = tcp;
  dialect.link.quiet_s = 0.1;
  return dialect;
}

class DialectStation {
 public:
  explicit DialectStation(const Dialect& dialect, const RigConfig& config = default_rig_config())
      : rig(config), mock(rig), clock(rig), twin(dialect, mock), server(twin), driver_dialect(dialect) {
    const Status opened = dialect.link.tcp ? server.listen_tcp(0) : server.open_pty("");
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message);
    EXPECT_TRUE(twin.power_on().ok());
    driver_dialect.link.address = server.address();
    start();
  }
  ~DialectStation() { stop(); }
  void pass(double seconds) {
    std::vector<ImuSample> samples(static_cast<std::size_t>(std::lround(seconds / rig.config().sample_period_s)));
    const std::lock_guard lock(server.mutex);
    if (!samples.empty()) rig.advance(samples);
  }
  void disturb(std::function<void(const std::string&, AnswerPlan&)> how) {
    stop();
    server.disturb = std::move(how);
    start();
  }

  Rig rig;
  RigTable mock;
  RigClock clock;
  DialectTwin twin;
  DialectServer server;
  Dialect driver_dialect;

 private:
  void start() {
    ended_ = false;
    thread_ = std::thread([this] {
      while (!ended_) server.run_once(0.01);
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
