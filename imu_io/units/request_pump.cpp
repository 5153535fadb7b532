#include "imu_io/units/request_pump.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "imu_io/base/deadline.h"

namespace turncal {

void RequestPump::start(ByteLine& line, std::vector<std::byte> request, double period_s) {
  stop();
  ended_ = false;
  thread_ = std::thread([this, &line, request = std::move(request), period_s] {
    double next_s = monotonic_s();
    while (!ended_) {
      static_cast<void>(line.write_all(request, 0.0).ok());
      const double now_s = monotonic_s();
      next_s = std::max(next_s + period_s, now_s - period_s);  // what was missed is not made up for
      const double pause_s = std::max(next_s - now_s, 0.0);
      std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
    }
  });
}

void RequestPump::stop() {
  ended_ = true;
  if (thread_.joinable()) thread_.join();
}

}  // namespace turncal
