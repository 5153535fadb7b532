// Text into the parameter file's reader. Bit 0 of byte 0: the checksum is put right first. What is accepted is written again as the
// same bytes.
#include <cstdio>
#include <string>

#include "imu_io/base/crc.h"
#include "imu_io/recordings/parameter_file.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const bool put_right = (input.byte() & 1U) != 0;
  std::string text(input.text());
  if (put_right) {
    const std::size_t at = text.rfind("checksum = ");
    if (at != std::string::npos) {
      text.resize(at);
      char line[32];
      std::snprintf(line, sizeof line, "checksum = %08x\n", crc32c(text));
      text += line;
    }
  }
  const auto file = parse_parameter_file(text, "fuzz");
  if (!fuzz::taken(file)) return 0;
  const auto again = format_parameter_file(*file);
  fuzz::require(again.ok());
  const auto parsed = parse_parameter_file(*again, "again");
  fuzz::require(parsed.ok());
  fuzz::require(*format_parameter_file(*parsed) == *again);
  return 0;
}
