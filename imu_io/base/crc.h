// Any CRC of 8 to 32 bits by its parameters, as catalogues give them (Rocksoft model): width, polynomial, initial value,
// reflection of input and output, final xor. Check values for "123456789": CRC-32/MPEG-2 0376E6E7, NovAtel CRC-32 2DFD2D88,
// CRC-16/XMODEM 31C3. One look-up a byte.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

struct CrcParameters {
  int width = 16;                     // 8 to 32
  std::uint32_t polynomial = 0x1021;  // without the leading one, highest power in the highest bit
  std::uint32_t initial = 0;          // of the register, not reflected
  bool reflect_input = false;
  bool reflect_output = false;
  std::uint32_t final_xor = 0;
};

class Crc {
 public:
  explicit Crc(const CrcParameters& parameters);
  // Over `data` followed by `zeros` zero bytes.
  std::uint32_t operator()(std::span<const std::byte> data, std::size_t zeros = 0) const;
  // Goes on from the CRC of what came before; 0 to begin. REQUIRES: input and output reflected, initial value and final xor all ones.
  std::uint32_t go_on(std::span<const std::byte> data, std::uint32_t before) const;

 private:
  std::uint32_t step(std::uint32_t state, std::uint32_t byte) const;

  CrcParameters parameters_;
  std::uint32_t start_ = 0;
  std::array<std::uint32_t, 256> table_{};
};

// CRC-32C (Castagnoli, polynomial 0x1EDC6F41 reflected, as in iSCSI, RFC 3720): crc32c("123456789") = 0xE3069283.
// Uses the processor's instruction where there is one; the result is the same without.

// Goes on from the CRC of what came before; 0 to begin.
std::uint32_t crc32c(std::span<const std::byte> data, std::uint32_t before = 0);
std::uint32_t crc32c(std::string_view text, std::uint32_t before = 0);
// Without it, for the test that holds both against each other.
std::uint32_t crc32c_portable(std::span<const std::byte> data, std::uint32_t before = 0);

// Text files that tell whether they are whole: the last line is `checksum = ` and the CRC-32C, as 8 hex digits, of all bytes above it. It
// tells damage and careless editing, not forgery.

// `text` ends its last line.
std::string with_checksum(std::string text);
// What stands above the checksum. An error when there is none, when it is wrong, or when it is not the last line.
Result<std::string_view> without_checksum(std::string_view text, const std::string& file_name);

}  // namespace turncal
