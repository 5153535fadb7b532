// Any CRC of 8 to 32 bits by its parameters, as catalogues give them (Rocksoft model): width, polynomial, initial value,
// reflection of input and output, final xor. Check values for "123456789": CRC-32/MPEG-2 0376E6E7, NovAtel CRC-32 2DFD2D88,
// CRC-16/XMODEM 31C3. One look-up a byte. For CRC-32C of files there is crc32c.h.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

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

 private:
  std::uint32_t step(std::uint32_t state, std::uint32_t byte) const;

  CrcParameters parameters_;
  std::uint32_t start_ = 0;
  std::array<std::uint32_t, 256> table_{};
};

}  // namespace turncal
