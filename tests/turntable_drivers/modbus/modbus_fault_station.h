// For tests of the Modbus driver's faults: short time-outs.
#pragma once

#include <functional>
#include <sstream>

#include "imu_io/base/clock.h"
#include "tests/turntable_drivers/twin_station.h"

namespace turncal {

struct FaultStation : FaultTable<TwinStation, ModbusTurntable> {
  explicit FaultStation(bool tcp, const std::string& more = "") : FaultTable(map_of(map_text(tcp, more))) {}
  explicit FaultStation(const RegisterMap& map) : FaultTable(map) {}
  // Short time-outs, and the lines of `more` in place of those with the same key.
  static std::string map_text(bool tcp, const std::string& more) {
    std::string text = plain_map_text(tcp ? "tcp" : "rtu");
    std::istringstream lines("link.response_timeout_s = 0.15\nlink.byte_timeout_s = 0.03\n" + more);
    for (std::string line; std::getline(lines, line);) {
      const std::size_t old = text.find("\n" + line.substr(0, line.find('=') + 1));
      if (old != std::string::npos) text.erase(old, text.find('\n', old + 1) - old);
      text += line + "\n";
    }
    return text;
  }
};

inline bool is_read(const ModbusRequest& request) { return request.function == 3; }

using Disturbance = std::function<void(const ModbusRequest&, AnswerPlan&)>;

}  // namespace turncal
