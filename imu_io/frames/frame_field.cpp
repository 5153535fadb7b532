#include "imu_io/frames/frame_field.h"

namespace turncal {

namespace {

constexpr std::byte slip_end{0xC0}, slip_escape{0xDB}, slip_end_code{0xDC}, slip_escape_code{0xDD};

// Writes groups of at most 254 bytes, each preceded by its length plus one.
void append_cobs(std::span<const std::byte> contents, std::vector<std::byte>& out) {
  constexpr std::size_t longest_group = 254;
  for (;;) {
    const auto zero = std::ranges::find(contents, std::byte{0});
    const std::size_t length = std::min(std::size_t(zero - contents.begin()), longest_group);
    out.push_back(static_cast<std::byte>(length + 1));
    out.insert(out.end(), contents.begin(), contents.begin() + std::ptrdiff_t(length));
    const bool at_zero = length < contents.size() && contents[length] == std::byte{0} && length < longest_group;
    contents = contents.subspan(length + (at_zero ? 1 : 0));
    if (contents.empty() && !at_zero) return;
  }
}

}  // namespace

std::size_t Unstuffer::unstuff(std::byte* data, std::size_t count) {
  if (stuffing_.kind == StuffingKind::none) {
    std::copy(data + 1, data + 1 + count, data);
    return count;
  }
  if (stuffing_.kind == StuffingKind::cobs) {
    std::byte* end = data;
    for (std::size_t i = 1; i <= count; ++i) end = decode_cobs(data[i], end);
    return std::size_t(end - data);
  }
  const std::byte marker = stuffing_.kind == StuffingKind::slip ? slip_escape : stuffing_.byte;
  std::byte* to = data;
  for (std::size_t i = 1; i <= count; ++i) {
    const std::byte now = data[i];
    if (!pending_) {
      pending_ = now == marker;
      if (!pending_) *to++ = now;
      continue;
    }
    pending_ = false;
    switch (stuffing_.kind) {
      case StuffingKind::none:
      case StuffingKind::cobs: break;
      case StuffingKind::escape: *to++ = now ^ stuffing_.flip; break;
      case StuffingKind::slip:
        *to++ = now == slip_end_code ? slip_end : now == slip_escape_code ? slip_escape : now;
        break;
      case StuffingKind::repeat:
        *to++ = marker;
        if (now != marker) *to++ = now;
        break;
    }
  }
  return std::size_t(to - data);
}

void Unstuffer::restart() {
  pending_ = zero_due_ = ended_ = false;
  group_ = 0;
}

// Never writes more bytes than it read: the 00 after a group is written when the next group begins.
std::byte* Unstuffer::decode_cobs(std::byte now, std::byte* to) {
  if (now == std::byte{0}) {
    if (!ended_) *to++ = now;  // repeated 00s count as one
    group_ = 0;
    zero_due_ = false;
    ended_ = true;
    return to;
  }
  ended_ = false;
  if (group_ > 0) {
    --group_;
    *to++ = now;
    return to;
  }
  if (zero_due_) *to++ = std::byte{0};
  group_ = std::to_integer<int>(now) - 1;
  zero_due_ = now != std::byte{0xFF};
  return to;
}

void append_stuffed(const ByteStuffing& stuffing, std::span<const std::byte> frame, std::size_t sync, std::size_t tail,
                    std::vector<std::byte>& out) {
  if (stuffing.kind == StuffingKind::cobs) {
    out.insert(out.end(), frame.begin(), frame.begin() + std::ptrdiff_t(sync));
    append_cobs(frame.subspan(sync), out);
    return;
  }
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const std::byte byte = frame[i];
    const bool inside = i >= sync && i + tail < frame.size();
    const bool marks =
        std::find(frame.begin(), frame.begin() + std::ptrdiff_t(sync), byte) != frame.begin() + std::ptrdiff_t(sync) ||
        std::find(frame.end() - std::ptrdiff_t(tail), frame.end(), byte) != frame.end();
    if (!inside || stuffing.kind == StuffingKind::none) {
      out.push_back(byte);
    } else if (stuffing.kind == StuffingKind::repeat) {
      out.push_back(byte);
      if (byte == stuffing.byte) out.push_back(byte);
    } else if (stuffing.kind == StuffingKind::slip && (byte == slip_end || byte == slip_escape)) {
      out.push_back(slip_escape);
      out.push_back(byte == slip_end ? slip_end_code : slip_escape_code);
    } else if (stuffing.kind == StuffingKind::escape && (marks || byte == stuffing.byte)) {
      out.push_back(stuffing.byte);
      out.push_back(byte ^ stuffing.flip);
    } else {
      out.push_back(byte);
    }
  }
}

// ---- fields ----

namespace {

// Calls `take` with every byte, or every word, padded with a zero byte.
template <typename Take>
void for_each_part(const FrameCheck& check, std::span<const std::byte> covered, const Take& take) {
  const auto at = [&](std::size_t i) { return i < covered.size() ? std::to_integer<std::uint32_t>(covered[i]) : 0U; };
  if (!check.of_words) {
    for (std::size_t i = 0; i < covered.size(); ++i) take(at(i));
    return;
  }
  for (std::size_t i = 0; i < covered.size(); i += 2)
    take(check.words_big_endian ? at(i) << 8 | at(i + 1) : at(i + 1) << 8 | at(i));
}

// At most 1024 parts of 16 bits: the 64-bit sum cannot overflow.
std::uint32_t sum(const FrameCheck& check, std::span<const std::byte> covered) {
  std::uint64_t total = 0;
  for_each_part(check, covered, [&](std::uint32_t part) { total += part; });
  const int bits = 8 * check.bytes();
  while (check.end_around && total >> bits != 0) total = (total & ((std::uint64_t{1} << bits) - 1)) + (total >> bits);
  return std::uint32_t(total);
}

std::uint32_t fletcher(const FrameCheck& check, std::span<const std::byte> covered) {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  for_each_part(check, covered, [&](std::uint32_t part) {
    a = (a + part) % check.modulus;
    b = (b + a) % check.modulus;
  });
  return b << (check.of_words ? 16 : 8) | a;
}

}  // namespace

std::size_t check_offset(const FrameCheck& check, std::size_t frame_length) {
  return !check.from_end ? check.field.offset() : frame_length - std::min(check.field.offset(), frame_length);
}

std::uint32_t frame_check_value(const FrameCheck& check, const Crc& crc, std::span<const std::byte> frame) {
  const std::size_t end = check_offset(check, frame.size()) - check.gap;
  const auto covered = frame.subspan(check.start, end - check.start);
  std::uint32_t value = 0;
  switch (check.kind) {
    case CheckKind::none: break;
    case CheckKind::sum: value = sum(check, covered); break;
    case CheckKind::exclusive_or: for_each_part(check, covered, [&](std::uint32_t part) { value ^= part; }); break;
    case CheckKind::crc: value = crc(covered, (check.pad - covered.size() % check.pad) % check.pad); break;
    case CheckKind::fletcher: value = fletcher(check, covered); break;
  }
  if (check.complement != Complement::none) value = ~value + (check.complement == Complement::twos ? 1U : 0U);
  return check.bytes() == 4 ? value : value & ((1U << (8 * check.bytes())) - 1U);
}

}  // namespace turncal
