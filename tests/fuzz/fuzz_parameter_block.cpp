// Bytes into the reader of parameter blocks. Bit 0 of byte 0: the checksum is put right first. What is accepted is written again as the
// same bytes.
#include <cstring>
#include <string>
#include <vector>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc32c.h"
#include "imu_io/recordings/parameter_forms.h"
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
  const auto block = parse_parameter_block(bytes, "fuzz");
  if (!block) {
    fuzz::require(block.error().message.find('\n') == std::string::npos);
    return 0;
  }
  const std::vector<std::byte> again = format_parameter_block(*block);
  fuzz::require(again.size() == bytes.size());
  const auto parsed = parse_parameter_block(again, "again");
  fuzz::require(parsed.ok());
  fuzz::require(format_parameter_block(*parsed) == again);
  return 0;
}
