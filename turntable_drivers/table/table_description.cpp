#include "turntable_drivers/table/table_description.h"

#include <algorithm>

#include "imu_io/base/key_table.h"

namespace turncal {

void read_table_description(KeyValueFile& file, TableDescription& description) {
  KeyTable keys(file);
  description.file = file.file_name();
  description.lines = read_line_sources(file);
  file.integer("format", 1, 1);
  description.name = file.text("name");
  keys.flag("verified_on_hardware", description.verified_on_hardware);
  keys.flag("commissioned", description.commissioned);
  keys.flag("switch_off", description.can_switch_off);
  keys.number("moving.rate_degps", description.moving_rate_degps, between(1e-6, 1.0));
  keys.number("plausible.angle_deg", description.plausible_deg, between(1.0, 1e6));
  keys.number("plausible.rate_degps", description.plausible_rate_degps, between(1.0, 1e5));
}

bool decides_motion(std::string_view key) {
  if (key.starts_with("axis.")) key.remove_prefix(std::min(key.find('.', 5), key.size() - 1) + 1);
  if (key.starts_with("write.")) key.remove_prefix(6);
  const std::string_view first = key.substr(0, key.find('.'));
  return first.starts_with("status") || first == "bit" || first == "enable" || first == "home" || first == "move" ||
         first == "stop" || first == "abort";
}

double circle_deg(KeyValueFile& file, const std::string& key) {
  const double circle = file.number_or(key, 0.0, between(0.0, 3600.0));
  if (circle != 0.0 && !(circle >= 90.0)) file.reject(key, "0, or a circle of 90 to 3600 deg");
  return circle;
}

}  // namespace turncal
