// Bytes into the reader of parameter blocks. Bit 0 of byte 0: the checksum is put right first. What is accepted is written again as the
// same bytes.
#include <string>
#include <vector>

#include "imu_io/recordings/parameter_forms.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  const std::vector<std::byte> bytes = fuzz::Input(data, size).checksummed();
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
