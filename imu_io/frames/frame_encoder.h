// Samples into bytes by the same description that the decoder reads: for the twin and for tests.
//
// decode(encode(x)) == x for pulses. For units that send rad or rates the value is rounded to the frame's number, and what the
// rounding left out goes into the next frame (as a unit's own integrator does), so that no angle is lost.
// The first variant is used; of a unit that sends gyros and accelerometers apart both, one after the other. Bytes that the description does not name are 0; a multiplexed temperature is in every frame.
// An invalid sample gets a status that differs from the good one in its lowest judged bit.
// Errors (kind input): a number that does not fit the frame's field; the message names axis and value.
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
  std::size_t length() const;  // of what one sample makes, before it is stuffed
  // Writes the frame, or the two of them, to the front of `out`, without stuffing; out.size() >= length().
  Status encode(const ImuSample& sample, std::span<std::byte> out);
  // Appends them as they go over the line.
  Status append(const ImuSample& sample, std::vector<std::byte>& out);

 private:
  std::span<const FrameVariant> used() const;
  Status encode_variant(const FrameVariant& variant, const ImuSample& sample, std::span<std::byte> out);
  bool put(const FrameValue& element, std::size_t i, double value, std::byte* out);

  FrameDescription frame_;
  Crc crc_;
  std::array<double, 6> left_{};           // what rounding left out
  std::array<std::uint64_t, 12> total_{};  // of cumulative fields, then of what counts the other way
  std::vector<std::byte> plain_;
};

}  // namespace turncal
