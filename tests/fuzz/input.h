// What the fuzz targets share: taking an input apart, and stopping where something holds that must not.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal::fuzz {

inline void require(bool holds) {
  if (!holds) std::abort();
}

// Taken, or refused in one line.
template <class Outcome>
bool taken(const Outcome& outcome) {
  if (!outcome.ok()) require(outcome.error().message.find('\n') == std::string::npos);
  return outcome.ok();
}

// Reads to the end, or says why not; counters increase and numbers are numbers.
inline Status read_through(RecordingSource& source) {
  std::optional<std::int64_t> last;
  return source.read([&](std::span<const ImuSample> samples) {
    require(!samples.empty());
    for (const ImuSample& sample : samples) {
      require(!last || sample.counter > *last);
      last = sample.counter;
      for (std::size_t k = 0; k < 3; ++k) require(std::isfinite(sample.gyro[k]) && std::isfinite(sample.accel[k]));
    }
    return Status();
  });
}

struct Input {
  std::span<const std::byte> rest;

  Input(const std::uint8_t* data, std::size_t size) : rest(reinterpret_cast<const std::byte*>(data), size) {}
  // 0 at the end.
  std::uint8_t byte() {
    if (rest.empty()) return 0;
    const auto value = std::to_integer<std::uint8_t>(rest.front());
    rest = rest.subspan(1);
    return value;
  }
  std::span<const std::byte> take(std::size_t count) {
    const auto result = rest.first(count < rest.size() ? count : rest.size());
    rest = rest.subspan(result.size());
    return result;
  }
  // Of a file that ends with a CRC-32C. Bit 0 of the first byte: the checksum is put right.
  std::vector<std::byte> checksummed() {
    const bool put_right = (byte() & 1U) != 0;
    std::vector<std::byte> bytes(rest.begin(), rest.end());
    if (put_right && bytes.size() >= 4) {
      bytes.resize(bytes.size() - 4);
      append_bytes(bytes, crc32c(std::span<const std::byte>(bytes)));
    }
    return bytes;
  }
  std::string_view text() const { return {reinterpret_cast<const char*>(rest.data()), rest.size()}; }
};

}  // namespace turncal::fuzz
