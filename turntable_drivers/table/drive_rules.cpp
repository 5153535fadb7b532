#include "turntable_drivers/table/drive_rules.h"

#include <cmath>

#include "imu_io/base/format_number.h"

namespace turncal {

std::string degrees(double value) { return format_number(std::round(1e4 * value) / 1e4) + " deg"; }

std::optional<std::string> refusal_of_move(double position_deg, double rate_degps, double acceleration_degps2,
                                           double plausible_deg, double plausible_rate_degps) {
  if (!(std::abs(position_deg) <= plausible_deg)) {
    return "move to " + format_number(position_deg) + " deg: expected at most " + degrees(plausible_deg);
  }
  if (!(rate_degps > 0.0 && rate_degps <= plausible_rate_degps)) {
    return "rate " + format_number(rate_degps) + " deg/s: expected above 0 and at most " +
           format_number(plausible_rate_degps);
  }
  if (!(acceleration_degps2 > 0.0) || !std::isfinite(acceleration_degps2)) {
    return "acceleration " + format_number(acceleration_degps2) + " deg/s^2: expected above 0";
  }
  return {};
}

std::optional<std::string> refusal_of_state(const AxisStatus& now) {
  const std::string text = now.text.empty() ? "" : ": " + now.text;
  if (now.emergency_stop) return "emergency stop is pressed" + text;
  if (now.fault) return "drive fault: expected it cleared" + text;
  if (!now.remote) return "not in remote mode";
  // A rate that is not known yet, at the first reading of a device that does not tell, is no motion seen.
  if (now.moving && !std::isnan(now.rate_degps)) return "a motion is under way: expected it finished or stopped";
  if (!now.enabled) return "not enabled";
  return {};
}

Error with_state(const Error& error, const Result<AxisStatus>& after) {
  const char* const state = !after ? "its state cannot be read" : after->moving ? "it moves" : "it stands";
  return {error.kind, error.message + "; " + state};
}

}  // namespace turncal
