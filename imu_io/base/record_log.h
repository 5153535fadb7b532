// Append-only binary logs of numbered records. The header and the whole record each have a checksum, so that a reader
// can tell a torn tail from damage, loses only one record to a flipped bit, and knows how much was lost.
//
//   record = magic:u32 type:u32 number:u32 length:u32 header_crc:u32  payload:length bytes  crc:u32     little-endian
//   header_crc = CRC-32C of the first 16 bytes;  crc = CRC-32C of those 16 bytes and the payload
//
// Numbers count up from 0 without a gap; a gap means lost records. The caller defines the types.
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

// To write a record: call begin_record, append the payload to `out`, and pass what begin_record returned to end_record.
std::size_t begin_record(std::vector<std::byte>& out, std::uint32_t magic, std::uint32_t type, std::uint32_t number);
void end_record(std::vector<std::byte>& out, std::size_t begun_at);

struct Record {
  std::uint32_t type = 0;
  std::uint32_t number = 0;
  std::span<const std::byte> payload;  // valid until the next call of next()
};

// Reads the file in blocks, from its start up to `end`. The file must outlive the scanner.
class RecordScanner {
 public:
  RecordScanner(const PosixFile& file, std::uint64_t end, std::uint32_t magic) : window_(file, end), magic_(magic) {}

  // Finds the next whole record; false when there are no more. Bytes skipped on the way count as dropped.
  // The only errors are those of reading the file.
  Result<bool> next(Record& record);
  // Counts the last record as dropped, because its payload makes no sense although its checksum is right.
  void drop_last() {
    ++records_dropped_;
    bytes_dropped_ += last_bytes_;
  }

  std::uint64_t good_end() const { return good_end_; }  // just after the last whole record
  std::uint32_t next_number() const { return next_number_; }
  std::uint64_t records_dropped() const { return records_dropped_; }  // gaps in the numbering, and drop_last()
  std::uint64_t bytes_dropped() const { return bytes_dropped_; }
  std::uint64_t tail_bytes() const { return window_.end() - good_end_; }  // valid once next() has returned false

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
