#include "imu_io/frames/frame_scanner.h"

#include <algorithm>
#include <cassert>
#include <cstring>

namespace turncal {
namespace {

constexpr std::size_t buffer_size = 8192;  // several of the longest frames

}  // namespace

FrameScanner::FrameScanner(const FrameDescription& frame)
    : frame_(frame),
      crc_(frame.check.crc),
      unstuffer_(frame.stuffing),
      lead_(frame.stuffing.kind == StuffingKind::none ? 0 : 1),
      buffer_(buffer_size) {}

std::span<std::byte> FrameScanner::space() {
  if (buffer_.size() - end_ < longest_frame && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return std::span(buffer_).subspan(std::min(end_ + lead_, buffer_.size()));
}

void FrameScanner::added(std::size_t count) {
  assert(count <= buffer_.size() - end_ - lead_);
  end_ += lead_ == 0 ? count : unstuffer_.unstuff(buffer_.data() + end_, count);
}

void FrameScanner::restart() {
  begin_ = end_ = 0;
  unstuffer_.restart();
  in_step_ = false;
  seeking_again_ = false;
  skipped_ = 0;
}

// As far as bytes are there; an unfinished sync is not a wrong one.
bool FrameScanner::sync_at(std::span<const std::byte> remaining) const {
  const std::size_t n = std::min(frame_.sync.size(), remaining.size());
  for (std::size_t i = 0; i < n; ++i)
    if (((remaining[i] ^ frame_.sync[i]) & frame_.sync_mask[i]) != std::byte{0}) return false;
  return true;
}

bool FrameScanner::check_good(std::span<const std::byte> frame) const {
  const FrameCheck& check = frame_.check;
  if (check.kind == CheckKind::none) return true;
  return check.field.bits_at(frame.data() + check_offset(check, frame.size())) == frame_check_value(check, crc_, frame);
}

FrameScanner::Verdict FrameScanner::judge(std::span<const std::byte> remaining, std::size_t& length,
                                          std::size_t& variant) const {
  if (!sync_at(remaining)) return Verdict::bad;
  const FrameCheck& check = frame_.check;
  // How long is it? Without an id there is one variant.
  const FrameVariant* known = frame_.id ? nullptr : frame_.variants.data();
  if (frame_.id) {
    if (remaining.size() < frame_.id->end()) return Verdict::more;
    const std::uint64_t id = frame_.id->bits_of(remaining.data());
    for (const FrameVariant& candidate : frame_.variants)
      if (candidate.id == id) known = &candidate;
    if (known == nullptr && !frame_.length) return Verdict::bad;
  }
  if (frame_.length) {
    if (remaining.size() < frame_.length->end()) return Verdict::more;
    const std::uint64_t raw = frame_.length->bits_of(remaining.data());
    if (raw > longest_frame) return Verdict::bad;
    const std::int64_t says = static_cast<std::int64_t>(raw) * frame_.length_scale + frame_.length_add;
    if (says < 1 || says > static_cast<std::int64_t>(longest_frame)) return Verdict::bad;
    length = static_cast<std::size_t>(says);
    if (known != nullptr && known->length != length) return Verdict::bad;
    if (known == nullptr) {
      // Only a check at the end can be found in a frame of unknown layout, and only a strong one is believed alone.
      const bool can_tell = check.from_end && !check.weak();
      if (!can_tell || length < frame_.sync.size() + frame_.tail.size() || check.field.offset() > length ||
          check_offset(check, length) <= check.start + check.gap)
        return Verdict::bad;
    }
  } else {
    length = known->length;
  }
  if (remaining.size() < length) return Verdict::more;
  const auto frame = remaining.first(length);
  if (!frame_.tail.empty() && !std::equal(frame_.tail.begin(), frame_.tail.end(),
                                          frame.end() - static_cast<std::ptrdiff_t>(frame_.tail.size())))
    return Verdict::bad;
  if (!check_good(frame)) return Verdict::bad;
  if (known == nullptr) return Verdict::other;
  if (check.weak()) {
    const auto after = remaining.subspan(length);
    if (!sync_at(after)) return Verdict::bad;
    if (after.size() < frame_.sync.size()) return Verdict::more;
  }
  variant = static_cast<std::size_t>(known - frame_.variants.data());
  return Verdict::good;
}

bool FrameScanner::next(ScannedFrame& frame) {
  while (begin_ < end_) {
    const auto remaining = std::span<const std::byte>(buffer_).subspan(begin_, end_ - begin_);
    std::size_t length = 0;
    std::size_t variant = 0;
    const Verdict verdict = judge(remaining, length, variant);
    if (verdict == Verdict::more) return false;
    if (verdict == Verdict::bad) {
      if (in_step_) {
        ++counters_.bad_frames;
        seeking_again_ = true;
      }
      in_step_ = false;
      ++begin_;
      ++skipped_;
      ++counters_.skipped_bytes;
      continue;
    }
    if (seeking_again_) ++counters_.resyncs;
    seeking_again_ = false;
    in_step_ = true;
    begin_ += length;
    if (verdict == Verdict::other) {
      ++counters_.other_frames;
      continue;
    }
    ++counters_.frames;
    frame = {remaining.data(), variant, skipped_};
    skipped_ = 0;
    return true;
  }
  begin_ = end_ = 0;
  return false;
}

}  // namespace turncal
