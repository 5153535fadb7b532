#include "imu_io/frames/frame_scanner.h"

#include <algorithm>
#include <cassert>
#include <cstring>

namespace turncal {
namespace {

constexpr std::size_t buffer_size = 8192;  // several of the longest frames

}  // namespace

FrameScanner::FrameScanner(const FrameDescription& frame)
    : sync_(frame.sync),
      mask_(frame.sync_mask),
      tail_(frame.tail),
      has_id_(frame.id.has_value()),
      has_length_(frame.length.has_value()),
      length_scale_(frame.length_scale),
      length_add_(frame.length_add),
      check_(frame.check),
      check_field_(frame.check.field),
      crc_(frame.check.crc),
      weak_(frame.check.weak()),
      unstuffer_(frame.stuffing),
      lead_(frame.stuffing.kind == StuffingKind::none ? 0 : 1),
      buffer_(buffer_size) {
  if (has_id_) id_ = FieldCodec(*frame.id);
  if (has_length_) length_ = FieldCodec(*frame.length);
  for (const FrameVariant& variant : frame.variants) variants_.push_back({variant.id, variant.length});
}

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
  const std::size_t n = std::min(sync_.size(), remaining.size());
  for (std::size_t i = 0; i < n; ++i) {
    if (((remaining[i] ^ sync_[i]) & mask_[i]) != std::byte{0}) return false;
  }
  return true;
}

bool FrameScanner::check_good(std::span<const std::byte> frame) const {
  if (check_.kind == CheckKind::none) return true;
  const std::size_t place = check_offset(check_, frame.size());
  return check_field_.bits_at(frame.data() + place) == frame_check_value(check_, crc_, frame);
}

FrameScanner::Verdict FrameScanner::judge(std::span<const std::byte> remaining, std::size_t& length,
                                          std::size_t& variant) const {
  if (!sync_at(remaining)) return Verdict::bad;
  // How long is it? Without an id there is one variant.
  const Variant* known = has_id_ ? nullptr : variants_.data();
  if (has_id_) {
    if (remaining.size() < id_.offset() + id_.bytes()) return Verdict::more;
    const std::uint64_t id = id_.bits_of(remaining.data());
    for (const Variant& candidate : variants_) {
      if (candidate.id == id) known = &candidate;
    }
    if (known == nullptr && !has_length_) return Verdict::bad;
  }
  if (has_length_) {
    if (remaining.size() < length_.offset() + length_.bytes()) return Verdict::more;
    const std::uint64_t raw = length_.bits_of(remaining.data());
    if (raw > longest_frame) return Verdict::bad;
    const std::int64_t says = static_cast<std::int64_t>(raw) * length_scale_ + length_add_;
    if (says < 1 || says > static_cast<std::int64_t>(longest_frame)) return Verdict::bad;
    length = static_cast<std::size_t>(says);
    if (known != nullptr && known->length != length) return Verdict::bad;
    if (known == nullptr) {
      // Only a check at the end can be found in a frame of unknown layout, and only a strong one is believed alone.
      const bool can_tell = check_.from_end && !weak_;
      if (!can_tell || length < sync_.size() + tail_.size() || check_.field.offset > length ||
          check_offset(check_, length) <= check_.start + check_.gap) {
        return Verdict::bad;
      }
    }
  } else {
    length = known->length;
  }
  if (remaining.size() < length) return Verdict::more;
  const auto frame = remaining.first(length);
  if (!tail_.empty() &&
      !std::equal(tail_.begin(), tail_.end(), frame.end() - static_cast<std::ptrdiff_t>(tail_.size()))) {
    return Verdict::bad;
  }
  if (!check_good(frame)) return Verdict::bad;
  if (known == nullptr) return Verdict::other;
  if (weak_) {
    const auto after = remaining.subspan(length);
    if (!sync_at(after)) return Verdict::bad;
    if (after.size() < sync_.size()) return Verdict::more;
  }
  variant = static_cast<std::size_t>(known - variants_.data());
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
