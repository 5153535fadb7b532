#include "imu_io/frames/byte_stuffing.h"

#include <algorithm>

namespace turncal {
namespace {

constexpr std::byte slip_end{0xC0}, slip_escape{0xDB}, slip_end_code{0xDC}, slip_escape_code{0xDD};

}  // namespace

std::size_t Unstuffer::take(std::byte* data, std::size_t count) {
  if (stuffing_.kind == StuffingKind::none) {
    std::copy(data + 1, data + 1 + count, data);
    return count;
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
      case StuffingKind::none: break;
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

void append_stuffed(const ByteStuffing& stuffing, std::span<const std::byte> frame, std::size_t sync, std::size_t tail,
                    std::vector<std::byte>& out) {
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
