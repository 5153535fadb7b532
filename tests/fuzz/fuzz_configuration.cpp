// Text into the readers of configuration: station, rig, CSV map (byte 0 chooses).
#include <string>

#include "imu_io/recordings/csv_map_import.h"
#include "input.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/rig/rig_config.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const std::uint8_t which = input.byte();
  const std::string text(input.text());
  switch (which % 3) {
    case 0: (void)fuzz::taken(parse_station_config(text, "fuzz")); break;
    case 1: (void)fuzz::taken(parse_rig_config(text, "fuzz")); break;
    default: (void)fuzz::taken(parse_csv_map(text, "fuzz")); break;
  }
  return 0;
}
