// Asks a unit for samples at a fixed pace, beside whoever reads them: a unit that answers requests with its last sample must be asked
// while the station is busy elsewhere, or the samples in between are gone.
// What cannot be sent is left out: a line that has gone shows in reading it.
#pragma once

#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

#include "imu_io/lines/byte_line.h"

namespace turncal {

class RequestPump {
 public:
  RequestPump() = default;
  ~RequestPump() { stop(); }
  RequestPump(const RequestPump&) = delete;
  RequestPump& operator=(const RequestPump&) = delete;

  // The line must stay open, and where it is, until stop().
  void start(ByteLine& line, std::vector<std::byte> request, double period_s);
  void stop();

 private:
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace turncal
