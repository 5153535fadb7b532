// Finds frames in a byte stream: sync, id, length, check and tail must all be right. After a frame that is not, the search goes
// on at its second byte, never after the whole of it: a frame that begins inside a damaged one is not lost.
//
// With a check of 8 bits or none a frame counts only when the next one's sync comes right after it. That costs the time
// of a few bytes and takes away what the check cannot see of dropped and inserted bytes. (What it cannot see of changed
// bytes, 0.4 % of the frames with two of them, remains.) Other frames of the same sync (an id of no variant) are passed
// over whole when the length field and the check tell how far they reach. No allocation after construction.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_field.h"

namespace turncal {

struct ScanCounters {
  std::uint64_t frames = 0;
  std::uint64_t other_frames = 0;   // good, of an id that holds no samples
  std::uint64_t bad_frames = 0;     // where a frame should have begun and none did
  std::uint64_t resyncs = 0;        // found again after that
  std::uint64_t skipped_bytes = 0;  // not part of any frame
};

struct ScannedFrame {
  const std::byte* data = nullptr;  // until the next call of the scanner
  std::size_t variant = 0;
  std::uint64_t skipped_before = 0;  // bytes thrown away since the frame before
};

class FrameScanner {
 public:
  explicit FrameScanner(const FrameDescription& frame);

  // Where new bytes are to be put, and how many of them were. Space is empty only before next() has returned false.
  std::span<std::byte> space();
  void added(std::size_t count);
  // False: more bytes are needed.
  bool next(ScannedFrame& frame);
  // Forgets what it holds; the stream begins anew.
  void restart();
  const ScanCounters& counters() const { return counters_; }

 private:
  enum class Verdict { good, other, bad, more };
  Verdict judge(std::span<const std::byte> remaining, std::size_t& length, std::size_t& variant) const;
  bool sync_at(std::span<const std::byte> remaining) const;
  bool check_good(std::span<const std::byte> frame) const;

  FrameDescription frame_;
  Crc crc_;
  Unstuffer unstuffer_;
  std::size_t lead_;  // bytes between end_ and space(): what was held back comes first

  std::vector<std::byte> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  bool in_step_ = false;        // a frame ended right before begin_
  bool seeking_again_ = false;  // a frame was expected and was bad
  std::uint64_t skipped_ = 0;
  ScanCounters counters_;
};

}  // namespace turncal
