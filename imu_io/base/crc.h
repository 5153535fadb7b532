// Computes any CRC of 8 to 32 bits from the parameters of the catalogues (Rocksoft model): width, polynomial, initial value,
// reflection of input and output, final xor. Check values for "123456789": CRC-32/MPEG-2 0376E6E7, NovAtel CRC-32 2DFD2D88,
// CRC-16/XMODEM 31C3. One table look-up per byte.
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
  // Returns the CRC of `data` followed by `zeros` zero bytes.
  std::uint32_t operator()(std::span<const std::byte> data, std::size_t zeros = 0) const;
  // Continues from `before`, 0 at the start. REQUIRES: input and output reflected, initial value and final xor all ones.
  std::uint32_t go_on(std::span<const std::byte> data, std::uint32_t before) const;

 private:
  std::uint32_t step(std::uint32_t state, std::uint32_t byte) const;

  CrcParameters parameters_;
  std::uint32_t start_ = 0;
  std::array<std::uint32_t, 256> table_{};
};

// CRC-32C (Castagnoli, polynomial 0x1EDC6F41 reflected, as in iSCSI, RFC 3720): crc32c("123456789") = 0xE3069283.
// Uses the processor's CRC instruction if there is one.

// Continues from `before`, the CRC of the preceding bytes (0 at the start).
std::uint32_t crc32c(std::span<const std::byte> data, std::uint32_t before = 0);
std::uint32_t crc32c(std::string_view text, std::uint32_t before = 0);
// Computes the same without that instruction; a test compares the two.
std::uint32_t crc32c_portable(std::span<const std::byte> data, std::uint32_t before = 0);

// Text files that detect damage: the last line is `checksum = ` and the CRC-32C, as 8 hex digits, of all bytes above it. It detects
// damage and careless editing, not forgery.

// Appends the checksum line. REQUIRES: `text` ends with a line break.
std::string with_checksum(std::string text);
// Returns the text above the checksum. An error when the checksum is missing, wrong or not the last line.
Result<std::string_view> without_checksum(std::string_view text, const std::string& file_name);

}  // namespace turncal
