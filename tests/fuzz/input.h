// What the fuzz targets share: taking an input apart, and stopping where something holds that must not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string_view>
#include <vector>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"

namespace turncal::fuzz {

inline void require(bool holds) {
  if (!holds) std::abort();
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
