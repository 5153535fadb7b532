#include "imu_io/base/record_log.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"

namespace turncal {
namespace {
constexpr std::size_t checked_header_bytes = record_header_bytes - 4;
}  // namespace

std::size_t begin_record(std::vector<std::byte>& out, std::uint32_t magic, std::uint32_t type, std::uint32_t number) {
  const std::size_t begun_at = out.size();
  constexpr std::uint32_t later = 0;  // end_record() fills in length and header checksum
  ByteWriter{out}(magic, type, number, later, later);
  return begun_at;
}

void end_record(std::vector<std::byte>& out, std::size_t begun_at) {
  const std::size_t length = out.size() - begun_at - record_header_bytes;
  assert(length <= max_record_payload_bytes);
  const auto length32 = std::uint32_t(length);
  std::byte* header = out.data() + begun_at;
  std::memcpy(header + 12, &length32, 4);
  const std::uint32_t header_crc = crc32c(std::span<const std::byte>(header, checked_header_bytes));
  std::memcpy(header + checked_header_bytes, &header_crc, 4);
  append_bytes(out, crc32c(std::span<const std::byte>(header + record_header_bytes, length), header_crc));
}

// Returns the offset of the next magic at or after `offset`, or the end.
Result<std::uint64_t> RecordScanner::find_magic(std::uint64_t offset) {
  std::byte pattern[4];
  std::memcpy(pattern, &magic_, 4);
  while (offset + 4 <= window_.end()) {
    const std::span<const std::byte> bytes = TRY(window_.at(offset, 4));
    const auto found = std::search(bytes.begin(), bytes.end(), std::begin(pattern), std::end(pattern));
    if (found != bytes.end()) return offset + std::uint64_t(found - bytes.begin());
    if (bytes.size() < 4) break;
    offset += bytes.size() - 3;  // the magic may span two blocks
  }
  return window_.end();
}

Result<bool> RecordScanner::next(Record& record) {
  while (position_ + record_overhead_bytes <= window_.end()) {
    std::span<const std::byte> bytes = TRY(window_.at(position_, record_overhead_bytes));
    if (bytes.size() < record_overhead_bytes) break;
    const std::byte* header = bytes.data();
    const std::uint32_t header_crc = crc32c(bytes.first(checked_header_bytes));
    const auto number = load_bytes<std::uint32_t>(header + 8);
    const auto length = load_bytes<std::uint32_t>(header + 12);
    const bool good_header = load_bytes<std::uint32_t>(header) == magic_ &&
                             load_bytes<std::uint32_t>(header + checked_header_bytes) == header_crc &&
                             length <= max_record_payload_bytes && number >= next_number_ &&
                             length <= window_.end() - position_ - record_overhead_bytes;
    if (!good_header) {
      position_ = TRY(find_magic(position_ + 1));
      continue;
    }
    const auto type = load_bytes<std::uint32_t>(header + 4);
    const std::uint64_t total = record_overhead_bytes + length;
    bytes = TRY(window_.at(position_, total));
    if (bytes.size() < total) break;
    const auto payload = bytes.subspan(record_header_bytes, length);
    const std::uint32_t crc = crc32c(payload, header_crc);
    const std::uint64_t start = position_;
    position_ += total;  // the header checksum covers the length, so a damaged payload can be skipped
    if (load_bytes<std::uint32_t>(payload.data() + length) != crc) continue;
    records_dropped_ += number - next_number_;
    bytes_dropped_ += start - good_end_;
    last_bytes_ = total;
    good_end_ = position_;
    next_number_ = number + 1;
    record = {type, number, payload};
    return true;
  }
  return false;
}

}  // namespace turncal
