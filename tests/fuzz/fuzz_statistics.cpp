// Bytes into the reader of statistics.tcs. Bit 0 of byte 0: the checksum is put right first. What is accepted is written again, and read.
#include <cstring>
#include <string>
#include <vector>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc32c.h"
#include "imu_io/recordings/statistics_file.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const bool put_right = (input.byte() & 1U) != 0;
  const std::string_view text = input.text();
  std::vector<std::byte> bytes(text.size());
  if (!text.empty()) std::memcpy(bytes.data(), text.data(), text.size());
  if (put_right && bytes.size() >= 4) {
    bytes.resize(bytes.size() - 4);
    append_bytes(bytes, crc32c(std::span<const std::byte>(bytes)));
  }
  const auto statistics = parse_statistics(bytes, "fuzz");
  if (!statistics) {
    fuzz::require(statistics.error().message.find('\n') == std::string::npos);
    return 0;
  }
  const auto again = format_statistics(*statistics);
  fuzz::require(again.ok());
  fuzz::require(parse_statistics(*again, "again").ok());
  return 0;
}
