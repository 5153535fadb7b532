#include "imu_io/lines/serial_keys.h"

namespace turncal {

void read_serial_keys(KeyTable& keys, const std::string& prefix, SerialSettings& settings, bool serial) {
  for (const char* const name : {".baud", ".data_bits", ".parity", ".stop_bits"}) {
    if (!serial && keys.file()->has(prefix + name))
      keys.file()->reject(prefix + name, "no such key unless the device is a serial line");
  }
  keys.whole(prefix + ".baud", settings.baud, 50u, 20'000'000u);
  keys.whole(prefix + ".data_bits", settings.data_bits, 7, 8);
  keys.chosen(prefix + ".parity", settings.parity, {"none", "even", "odd"});
  keys.whole(prefix + ".stop_bits", settings.stop_bits, 1, 2);
}

}  // namespace turncal
