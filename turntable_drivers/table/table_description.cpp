#include "turntable_drivers/table/table_description.h"

#include "imu_io/base/key_table.h"

namespace turncal {

void read_table_description(KeyValueFile& file, TableDescription& description) {
  KeyTable keys(file);
  description.file = file.file_name();
  file.integer("format", 1, 1);
  description.name = file.text("name");
  keys.flag("verified_on_hardware", description.verified_on_hardware);
  keys.flag("commissioned", description.commissioned);
  keys.flag("switch_off", description.can_switch_off);
  keys.number("moving.rate_degps", description.moving_rate_degps, positive);
  keys.number("plausible.angle_deg", description.plausible_deg, positive);
  keys.number("plausible.rate_degps", description.plausible_rate_degps, positive);
}

}  // namespace turncal
