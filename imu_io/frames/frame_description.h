// The description of a unit's frame: plain data, read from `key = value` text. docs/imu-frames.md explains every key; the files
// in imu_io/frames are examples. The layout:
//
//   sync [id] [length] ... fields ... check [tail]      one frame; offsets are in bytes from the first sync byte
//
// A field is an integer or float of 1 to 8 bytes in any byte order. It is masked and converted by
//   value = (raw - zero) * scale                          in the field's unit
// A description has one or more variants: frames with the same sync, but with another id and layout.
//
// Units: a recording holds increments in pulses, or in rad and m/s (recording_types.h). Angles and velocities are increments
// already; rates and accelerations are multiplied by sample_period_s. 1 g = 9.80665 m/s^2, 1 ft = 0.3048 m.
// Errors (kind input) are one line with file, line, key and what was expected.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"
#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_field.h"
#include "imu_io/lines/serial_port.h"

namespace turncal {

inline constexpr std::size_t longest_frame = 1024;  // bytes

// The field of a body axis and its conversion.
struct FrameValue {
  FrameField field;
  std::optional<FrameField> down;     // a second field that counts the negative pulses: raw = field - down
  double zero = 0.0;                  // in raw counts
  double factor = 1.0;                // raw count to increment of the body axis (pulses, rad, m/s), sign included
  double low = -1e300, high = 1e300;  // range of possible raw numbers; outside, the sample is flagged invalid
  bool cumulative = false;
  std::uint64_t modulus = 0;  // for a cumulative field; 0: 2^64
  bool pulses = false;        // the value must be a whole number
};

struct FrameScalar {
  std::vector<FrameField> places;  // the value is the mean of all
  double zero = 0.0;
  double scale = 1.0;
  std::optional<std::uint64_t> when;  // present only if the multiplexer has this value; held between
};

struct FrameCounter {
  FrameField field;
  double step = 1.0;     // increase per sample, in the field's units
  double modulus = 0.0;  // in the field's units; default 2^bits, or practically none if floating
};

struct FrameStatus {
  FrameField field;
  std::uint64_t mask = ~std::uint64_t{0};
  std::uint64_t good = 0;  // the data are valid when (raw & mask) == good
};

struct FrameVariant {
  std::string name;  // empty when there is only one
  std::uint64_t id = 0;
  std::size_t length = 0;  // the whole frame, in bytes
  bool has_gyro = true;    // false if a unit sends gyros and accelerometers separately
  bool has_accel = true;
  std::array<FrameValue, 6> values;  // gyro x y z, accel x y z of the body axes, as far as the variant has them
  std::optional<FrameScalar> temperature;
  std::optional<FrameCounter> counter;
  std::vector<FrameStatus> status;
  std::optional<FrameField> multiplexer;
};

struct FrameDescription {
  std::string file;
  std::string name;
  std::vector<std::byte> sync;
  std::vector<std::byte> sync_mask;  // as long as sync
  std::vector<std::byte> tail;       // the frame's last bytes
  std::optional<FrameField> id;
  std::optional<FrameField> length;  // raw * length_scale + length_add is the length in bytes; other ids use it too
  std::int64_t length_scale = 1;
  std::int64_t length_add = 0;
  std::size_t longest = 0;  // longest variant, or longest length that the length field may give
  ByteStuffing stuffing;
  FrameCheck check;
  std::vector<FrameVariant> variants;
  bool split = false;              // variants 0 (gyros) and 1 (accelerometers) with the same counter make a sample
  std::vector<std::byte> request;  // asks the unit for its last sample; empty: it sends by itself
  double request_period_s = 0.0;
  double sample_period_s = 0.005;
  double accel_pulse_mps = 0.0;
  SerialSettings line;            // device stays empty
  std::vector<LineSource> lines;  // the source of each line of the file

  const FrameValue& gyro() const { return variants.front().values[0]; }
  const FrameValue& accel() const { return variants[split ? 1 : 0].values[3]; }
  bool has_temperature() const;
  // Sets period, increment kinds, pulse weight and temperature. Site, serial and `simulated` are left unchanged.
  void describe(RecordingInfo& info) const;
};

Result<FrameDescription> read_frame_description(const std::string& path);
Result<FrameDescription> parse_frame_description(std::string_view text, const std::string& file_name);

// The frame descriptions of imu_io/frames, compiled into the program, so that it runs without these files.

// Returns the names of the files without ".frame", in alphabetical order: "laser_gyro", "stim300", ...
std::vector<std::string_view> builtin_frame_names();
// Returns an empty text for an unknown name.
std::string_view builtin_frame_text(std::string_view name);

// Reads a built-in description by its name, or a file if the name has a '/' or ends in ".frame".
Result<FrameDescription> find_frame(const std::string& name_or_path);

}  // namespace turncal
