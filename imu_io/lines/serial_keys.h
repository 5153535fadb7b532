// The keys of a serial line in a configuration: PREFIX.baud, .data_bits, .parity, .stop_bits. What is not given stays as it is.
#pragma once

#include <string>

#include "imu_io/base/key_table.h"
#include "imu_io/lines/serial_port.h"

namespace turncal {

// `serial`: whether the line is one. Over a network none of these keys has a meaning, and each is refused.
void read_serial_keys(KeyTable& keys, const std::string& prefix, SerialSettings& settings, bool serial = true);

}  // namespace turncal
