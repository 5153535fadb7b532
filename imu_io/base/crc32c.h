// CRC-32C (Castagnoli, polynomial 0x1EDC6F41 reflected, as in iSCSI, RFC 3720): crc32c("123456789") = 0xE3069283.
// Uses the processor's instruction where there is one; the result is the same without.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace turncal {

// Goes on from the CRC of what came before; 0 to begin.
std::uint32_t crc32c(std::span<const std::byte> data, std::uint32_t before = 0);
std::uint32_t crc32c(std::string_view text, std::uint32_t before = 0);
// The table-driven form, for the test that holds both against each other.
std::uint32_t crc32c_portable(std::span<const std::byte> data, std::uint32_t before = 0);

}  // namespace turncal
