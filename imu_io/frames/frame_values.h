// Where in a frame the numbers of a sample are, and what they become: increments of the body axes, status, temperature.
//
// A FrameVariant of a description, compiled: one field a body axis with its sign, scale and zero, or a cumulative field whose step
// since the frame before is the increment. Pure; nothing is remembered here (CumulativeBase is the caller's).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

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
  FieldCodec field;
  std::optional<FieldCodec> down;
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
  FrameValues(const FrameDescription& frame, const FrameVariant& from);
  // Of the two frames of a sample, one after the other.
  static FrameValues joined(const FrameValues& gyro, const FrameValues& accel);

  std::size_t length() const { return length_; }
  bool has_counter() const { return has_counter_; }
  double counter(const std::byte* frame) const { return counter_.number(frame); }
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
  struct Status {
    FieldCodec field;
    std::uint64_t mask, good;
  };
  std::size_t length_ = 0;
  std::array<FrameElement, 6> element_;  // gyro x y z, accel x y z, body axes
  std::vector<FieldCodec> temperature_;
  double temperature_zero_ = 0.0, temperature_scale_ = 1.0;
  bool multiplexed_ = false;
  FieldCodec multiplexer_;
  std::uint64_t when_ = 0;
  bool has_counter_ = false;
  FieldCodec counter_;
  std::vector<Status> status_;
};

}  // namespace turncal
