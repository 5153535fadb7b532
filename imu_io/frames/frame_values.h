// Where in a frame the numbers of a sample are, and what they become: increments of the body axes, status, temperature.
//
// Of a FrameVariant one field a body axis with its sign, scale and zero, or a cumulative field whose step since the frame before is
// the increment. Pure; nothing is remembered here (CumulativeBase is the caller's).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "calib/types/recording_types.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_field.h"

namespace turncal {

// What the cumulative fields read in the frame before.
struct CumulativeBase {
  std::array<std::uint64_t, 12> field{};  // the fields, then what counts the other way
  bool known = false;
};

// Where the number of a body axis is, and what one of it is.
struct FrameElement {
  FrameField field;
  std::optional<FrameField> down;
  double zero = 0.0;
  double factor = 1.0;  // to an increment of the body axis, sign included
  double low = 0.0, high = 0.0;
  std::uint64_t modulus = 0;  // cumulative; 0: 2^64
  bool cumulative = false;
  bool pulses = false;
};
// gyro x y z, accel x y z, body axes
std::array<FrameElement, 6> frame_elements(const FrameVariant& variant, double sample_period_s);

class FrameValues {
 public:
  FrameValues(FrameVariant from, double sample_period_s)
      : from_(std::move(from)), element_(frame_elements(from_, sample_period_s)) {}

  std::size_t length() const { return from_.length; }
  bool has_counter() const { return from_.counter.has_value(); }
  double counter(const std::byte* frame) const { return from_.counter->field.number(frame); }
  bool any_cumulative() const;
  bool cumulative(std::size_t value) const { return element_[value].cumulative; }
  // The increments of gyro and accel and the flag for invalid ones. False: the numbers are impossible.
  bool read(const std::byte* frame, const CumulativeBase& base, ImuSample& sample) const;
  // A recording holds what was read (an increment over a long gap may be beyond it).
  bool fits(const ImuSample& sample) const;
  void keep(const std::byte* frame, CumulativeBase& base) const;
  // Empty: not in this frame. NaN: not a number.
  std::optional<float> temperature_c(const std::byte* frame) const;

 private:
  FrameVariant from_;
  std::array<FrameElement, 6> element_;
};

// The variant that two frames of a sample are, one after the other.
FrameVariant joined(FrameVariant gyro, const FrameVariant& accel);

}  // namespace turncal
