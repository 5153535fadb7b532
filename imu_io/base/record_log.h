// Append-only binary logs: numbered records, each with a checksum of its header and one of the whole, so that a reader
// tells a torn tail from damage, loses one record to a flipped bit, and says how much it lost.
//
//   record = magic:u32 type:u32 number:u32 length:u32 header_crc:u32  payload:length bytes  crc:u32     little-endian
//   header_crc = CRC-32C of the first 16 bytes;  crc = CRC-32C of those 16 bytes and the payload
//
// Numbers count up from 0 without a hole: a hole is a lost record. The meaning of types is the caller's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/files.h"

namespace turncal {

inline constexpr std::size_t record_header_bytes = 20;
inline constexpr std::size_t record_overhead_bytes = record_header_bytes + 4;
inline constexpr std::uint32_t max_record_payload_bytes = std::uint32_t{1} << 20;

// Writing: begin_record, append the payload to `out`, end_record (which wants what begin_record returned).
std::size_t begin_record(std::vector<std::byte>& out, std::uint32_t magic, std::uint32_t type, std::uint32_t number);
void end_record(std::vector<std::byte>& out, std::size_t begun_at);

struct Record {
  std::uint32_t type = 0;
  std::uint32_t number = 0;
  std::span<const std::byte> payload;  // valid until the next call of next()
};

// Reads from the start up to `end` in blocks. The file must outlive it.
class RecordScanner {
 public:
  RecordScanner(const PosixFile& file, std::uint64_t end, std::uint32_t magic) : window_(file, end), magic_(magic) {}

  // The next whole record; false when there is none any more. What lies between it and the one before is dropped.
  // Errors are those of reading the file.
  Result<bool> next(Record& record);
  // For a record whose payload makes no sense although its checksum is right.
  void drop_last() {
    ++records_dropped_;
    bytes_dropped_ += last_bytes_;
  }

  std::uint64_t good_end() const { return good_end_; }  // just after the last whole record
  std::uint32_t next_number() const { return next_number_; }
  std::uint64_t records_dropped() const { return records_dropped_; }  // between whole records
  std::uint64_t bytes_dropped() const { return bytes_dropped_; }
  std::uint64_t tail_bytes() const { return window_.end() - good_end_; }  // once next() returned false

 private:
  Result<std::uint64_t> find_magic(std::uint64_t offset);

  FileWindow window_;
  std::uint32_t magic_;
  std::uint64_t position_ = 0;
  std::uint64_t good_end_ = 0;
  std::uint32_t next_number_ = 0;
  std::uint64_t last_bytes_ = 0;
  std::uint64_t records_dropped_ = 0;
  std::uint64_t bytes_dropped_ = 0;
};

}  // namespace turncal
