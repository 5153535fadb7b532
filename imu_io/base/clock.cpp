#include "imu_io/base/clock.h"

#include <cmath>
#include <cstdio>
#include <ctime>

namespace turncal {

std::string format_utc(double utc_s) {
  const std::time_t seconds = static_cast<std::time_t>(std::floor(utc_s));
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

}  // namespace turncal
