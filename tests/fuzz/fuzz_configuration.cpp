// Text into the readers of configuration: station, rig, CSV map (byte 0 chooses).
#include <string>

#include "imu_io/recordings/csv_map_import.h"
#include "input.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/rig/rig_config.h"

namespace {

void one_line(const turncal::Status& status) {
  if (!status) turncal::fuzz::require(status.error().message.find('\n') == std::string::npos);
}
template <class T>
turncal::Status status_of(const turncal::Result<T>& result) {
  return result ? turncal::Status() : turncal::Status(result.error());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const std::uint8_t which = input.byte();
  const std::string text(input.text());
  switch (which % 3) {
    case 0: one_line(status_of(parse_station_config(text, "fuzz"))); break;
    case 1: one_line(status_of(parse_rig_config(text, "fuzz"))); break;
    default: one_line(status_of(parse_csv_map(text, "fuzz"))); break;
  }
  return 0;
}
