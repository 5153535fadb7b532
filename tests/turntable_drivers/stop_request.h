// For tests of how soon a stop goes out.
#pragma once

#include "tests/test.h"

#include <thread>

#include "imu_io/base/clock.h"

namespace turncal {

inline constexpr double limit_s = 0.1;  // from the request to the stop
inline constexpr double into_the_wait_s = 0.1;

// The best of three: the machine may be busy, the driver may not.
inline void expect_in_time(const std::function<double()>& once) {
  double best_s = 1e9;
  for (int i = 0; i < 3 && best_s > limit_s && !testing::Test::HasFatalFailure(); ++i)
    best_s = std::min(best_s, once());
  EXPECT_LT(best_s, limit_s);
  testing::Test::RecordProperty("ms", int(std::ceil(1e3 * best_s)));
}

// Somebody who asks for a stop while something else goes on.
class Request {
 public:
  explicit Request(std::atomic<int>& requests)
      : thread_([this, &requests] {
          ::usleep(unsigned(1e6 * into_the_wait_s));
          asked_s_ = monotonic_s();
          ++requests;
        }) {}
  double made_at_s() {
    if (thread_.joinable()) thread_.join();
    return asked_s_;
  }
  ~Request() { made_at_s(); }

 private:
  double asked_s_ = 0.0;
  std::thread thread_;
};

}  // namespace turncal
