#include "imu_io/units/serial_imu_config.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/frames/builtin_frames.h"

namespace turncal {

Result<SerialImuConfig> read_serial_imu_config(KeyValueFile& file) {
  SerialImuConfig config;
  config.settings.device = file.text("imu.device");
  const std::string& device = config.settings.device;
  const std::optional<LineAddress> line = parse_line(device);
  if (!line && !device.empty()) {
    file.reject(
        "imu.device",
        "a serial device such as /dev/serial/by-id/..., tcp:HOST:PORT, udp:PORT, udp:ADDRESS:PORT or udp_to:HOST:PORT");
  }
  std::string name = file.text("imu.frame");
  KeyTable keys(file);
  keys.text("imu.unit_serial", config.settings.unit_serial);
  keys.flag("imu.simulated", config.settings.simulated);
  keys.number("imu.clock_max_ppm", config.settings.clock_max_ppm, between(0.1, 2000.0));
  keys.number("imu.speedup", config.settings.speedup, between(0.01, 1000.0));
  if (config.settings.speedup != 1.0 && !config.settings.simulated) {
    file.reject("imu.speedup", "1 unless imu.simulated is true");
  }
  TRY(file.status());
  const bool is_file = name.find('/') != std::string::npos || name.ends_with(".frame");
  if (is_file && !name.starts_with('/')) name = folder_of(file.file_name()) + "/" + name;
  auto frame = find_frame(name);
  if (!frame && !is_file) file.reject("imu.frame", "a built-in frame or a file: " + frame.error().message);
  TRY(file.status());
  if (!frame) return frame.error();
  config.frame = std::move(*frame);
  if (line && line->kind == LineKind::udp) {
    if (!config.frame.variants.front().counter) {
      file.reject("imu.device", "a frame with a counter: only it tells of datagrams that were lost");
    }
    if (!config.frame.request.empty() && !line->asks)
      file.reject("imu.device", "a serial line, tcp: or udp_to:HOST:PORT: the frame has a request to send");
    if (config.frame.request.empty() && line->asks)
      file.reject("imu.device", "udp:PORT, or a frame with a request: without one nothing is sent there");
  }
  if (line && line->kind != LineKind::serial && file.has("imu.baud")) {
    file.reject("imu.baud", "no such key unless the device is a serial line");
  }
  keys.whole("imu.baud", config.frame.line.baud, 50u, 20'000'000u);
  if (file.has("imu.accel_pulse_mps") && config.frame.accel_pulse_mps == 0.0) {
    file.reject("imu.accel_pulse_mps", "no such key: the frame's accelerometers do not send pulses");
  }
  keys.number("imu.accel_pulse_mps", config.frame.accel_pulse_mps, between(1e-9, 1.0));
  if (line && line->kind == LineKind::serial) {
    const SerialSettings& serial = config.frame.line;
    const int bits = 1 + serial.data_bits + (serial.parity == SerialParity::none ? 0 : 1) + serial.stop_bits;
    std::size_t bytes = config.frame.split ? 0 : config.frame.variants.front().length;
    for (const FrameVariant& variant : config.frame.variants)
      bytes = config.frame.split ? bytes + variant.length : std::min(bytes, variant.length);
    const double needed = static_cast<double>(bits) * static_cast<double>(bytes) / config.frame.sample_period_s;
    if (needed > static_cast<double>(serial.baud))
      file.reject(file.has("imu.baud") ? "imu.baud" : "imu.frame",
                  "a line of at least " + format_number(std::ceil(needed)) + " baud, for " + std::to_string(bytes) +
                      " bytes each " + format_number(config.frame.sample_period_s) + " s; it has " +
                      std::to_string(serial.baud));
  }
  TRY(file.status());
  return config;
}

}  // namespace turncal
