// Bytes into the reader of statistics.tcs. Bit 0 of byte 0: the checksum is put right first. What is accepted is written again, and read.
#include <vector>

#include "imu_io/recordings/statistics_file.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  const std::vector<std::byte> bytes = fuzz::Input(data, size).checksummed();
  const auto statistics = parse_statistics(bytes, "fuzz");
  if (!fuzz::taken(statistics)) return 0;
  const auto again = format_statistics(*statistics);
  fuzz::require(again.ok());
  fuzz::require(parse_statistics(*again, "again").ok());
  return 0;
}
