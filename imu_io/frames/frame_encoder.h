// Encodes samples into frames by the same description that the decoder reads, for the twin and for tests.
//
// decode(encode(x)) == x for pulses. Units that send rad or rates have their values rounded to the frame's resolution; the rounding
// error is carried into the next frame, as a unit's own integrator does, so that no angle is lost.
// It uses the first variant, or both if a unit sends gyros and accelerometers separately. Bytes outside the described fields are 0;
// every frame has the multiplexed temperature. An invalid sample gets a status that differs from `good` in the lowest masked bit.
// Errors (kind input): a number that does not fit its field; the message names axis and value.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/frames/frame_description.h"

namespace turncal {

class FrameEncoder {
 public:
  explicit FrameEncoder(const FrameDescription& frame);
  std::size_t length() const;  // bytes per sample before stuffing
  // Writes the one or two frames of a sample to the front of `out`, unstuffed. REQUIRES: out.size() >= length().
  Status encode(const ImuSample& sample, std::span<std::byte> out);
  // Appends the stuffed bytes, as sent over the line.
  Status append(const ImuSample& sample, std::vector<std::byte>& out);

 private:
  std::span<const FrameVariant> used() const;
  Status encode_variant(const FrameVariant& variant, const ImuSample& sample, std::span<std::byte> out);
  bool put(const FrameValue& element, std::size_t i, double value, std::byte* out);

  FrameDescription frame_;
  Crc crc_;
  std::array<double, 6> left_{};           // rounding errors carried over
  std::array<std::uint64_t, 12> total_{};  // of cumulative fields, then of their `down` fields
  std::vector<std::byte> plain_;
};

}  // namespace turncal
