// Byte stuffing: how a unit keeps the bytes that mark its frames out of their contents. The description's offsets and its check count
// the bytes as they are without it; sync and tail stand on the line as they are.
//
//   escape    a byte that means something on the line is sent as `byte`, then itself xor `flip`       (HDLC, RFC 1662: 7D, 20)
//   slip      the same with C0 as DB DC and DB as DB DD                                                (RFC 1055)
//   repeat    `byte` in the contents is sent twice; sync and tail begin with one                       (DLE STX ... DLE ETX)
//   cobs      consistent overhead: a 00 ends every frame, and the contents hold none (Cheshire, Baker, IEEE/ACM ToN 7, 1999). The 00
//             before the contents is their sync: it is byte 0 of the frame, whether the unit sends one or the frame before ended so
// A byte that was lost costs the frame that it belonged to, and no other. Not modelled: bit stuffing, COBS/R and other variants.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace turncal {

enum class StuffingKind { none, escape, slip, repeat, cobs };

struct ByteStuffing {
  StuffingKind kind = StuffingKind::none;
  std::byte byte{0x7D};
  std::byte flip{0x20};
};

// Takes stuffing out of a stream that comes in pieces.
class Unstuffer {
 public:
  explicit Unstuffer(const ByteStuffing& stuffing) : stuffing_(stuffing) {}
  // data[1, 1 + count) is new; what it says is put from data[0] on: at most count + 1 bytes. Returns how many.
  std::size_t unstuff(std::byte* data, std::size_t count);
  void restart();

 private:
  std::byte* decode_cobs(std::byte now, std::byte* to);

  ByteStuffing stuffing_;
  bool pending_ = false;  // the last byte was `byte`: what it means the next one tells
  // Of cobs: bytes left in the group, none after a 00; whether a 00 follows it unless the frame ends; a 00 came last.
  int group_ = 0;
  bool zero_due_ = false;
  bool ended_ = false;
};

// The bytes of a frame as they go over the line, appended to `out`; the first `sync` and the last `tail` of them stay as they are.
void append_stuffed(const ByteStuffing& stuffing, std::span<const std::byte> frame, std::size_t sync, std::size_t tail,
                    std::vector<std::byte>& out);

}  // namespace turncal
