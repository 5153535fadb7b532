#include "imu_io/frames/byte_stuffing.h"

#include <algorithm>

namespace turncal {
namespace {

constexpr std::byte slip_end{0xC0}, slip_escape{0xDB}, slip_end_code{0xDC}, slip_escape_code{0xDD};

// Groups of at most 254 bytes, each led by its length and one.
void append_cobs(std::span<const std::byte> contents, std::vector<std::byte>& out) {
  constexpr std::size_t longest_group = 254;
  for (;;) {
    const auto zero = std::find(contents.begin(), contents.end(), std::byte{0});
    const std::size_t length = std::min(static_cast<std::size_t>(zero - contents.begin()), longest_group);
    out.push_back(static_cast<std::byte>(length + 1));
    out.insert(out.end(), contents.begin(), contents.begin() + static_cast<std::ptrdiff_t>(length));
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
    return static_cast<std::size_t>(end - data);
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
  return static_cast<std::size_t>(to - data);
}

void Unstuffer::restart() {
  pending_ = zero_due_ = ended_ = false;
  group_ = 0;
}

// No more bytes than came: the 00 that a group stands for is written when the next group begins.
std::byte* Unstuffer::decode_cobs(std::byte now, std::byte* to) {
  if (now == std::byte{0}) {
    if (!ended_) *to++ = now;  // several in a row say no more than one
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
    out.insert(out.end(), frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(sync));
    append_cobs(frame.subspan(sync), out);
    return;
  }
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const std::byte byte = frame[i];
    const bool inside = i >= sync && i + tail < frame.size();
    const bool marks = std::find(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(sync), byte) !=
                           frame.begin() + static_cast<std::ptrdiff_t>(sync) ||
                       std::find(frame.end() - static_cast<std::ptrdiff_t>(tail), frame.end(), byte) != frame.end();
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

}  // namespace turncal
