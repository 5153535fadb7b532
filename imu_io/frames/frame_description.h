// What a unit's frame looks like: plain data, read from `key = value` text. docs/imu-frames.md explains every key; the files
// in imu_io/frames are examples. The words:
//
//   sync [id] [length] ... fields ... check [tail]      one frame; every place is a byte offset from the first sync byte
//
// A field is an integer or float of 1 to 8 bytes in any byte order, masked, and turned into a value by
//   value = (raw - zero) * scale                          in the field's unit
// A description has one or more variants (frames of the same sync with another id and layout).
//
// Units. A recording holds increments: pulses, or rad and m/s (recording_types.h). Angles and velocities are increments
// already; rates and accelerations are multiplied by sample_period_s. 1 g = 9.80665 m/s^2, 1 ft = 0.3048 m.
// Errors: one line with file, line, key and what was expected (kind input).
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

// Where the number of a body axis is, and what one of it is.
struct FrameValue {
  FrameField field;
  std::optional<FrameField> down;     // counts the other way: raw = field - down
  double zero = 0.0;                  // raw
  double factor = 1.0;                // from raw to an increment of the body axis (pulses, rad, m/s), sign included
  double low = -1e300, high = 1e300;  // raw numbers outside are impossible: the sample is flagged invalid
  bool cumulative = false;
  std::uint64_t modulus = 0;  // of a cumulative field; 0: 2^64
  bool pulses = false;        // whole numbers
};

struct FrameScalar {
  std::vector<FrameField> places;  // the value is the mean of all
  double zero = 0.0;
  double scale = 1.0;
  std::optional<std::uint64_t> when;  // only in frames whose multiplexer has this value; held in between
};

struct FrameCounter {
  FrameField field;
  double step = 1.0;     // the field's own units a sample
  double modulus = 0.0;  // in the field's own units; without a key 2^bits, floating: as good as none
};

struct FrameStatus {
  FrameField field;
  std::uint64_t mask = ~std::uint64_t{0};
  std::uint64_t good = 0;  // the data are valid when (raw & mask) == good
};

struct FrameVariant {
  std::string name;  // empty when there is only one
  std::uint64_t id = 0;
  std::size_t length = 0;  // of the whole frame
  bool has_gyro = true;    // a unit may send gyros and accelerometers apart
  bool has_accel = true;
  std::array<FrameValue, 6> values;  // gyro x y z, accel x y z of the body axes; those that it carries
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
  std::optional<FrameField> length;  // must say raw * length_scale + length_add bytes; tells how far other ids reach
  std::int64_t length_scale = 1;
  std::int64_t length_add = 0;
  std::size_t longest = 0;  // of all variants, and of what the length field may say
  ByteStuffing stuffing;
  FrameCheck check;
  std::vector<FrameVariant> variants;
  bool split = false;  // variants 0 and 1 of one counter are a sample: gyros in the one, accelerometers in the other
  std::vector<std::byte> request;  // what makes the unit send its last sample; empty: it sends by itself
  double request_period_s = 0.0;
  double sample_period_s = 0.005;
  double accel_pulse_mps = 0.0;
  SerialSettings line;            // device is left empty
  std::vector<LineSource> lines;  // of the file: where each comes from

  const FrameValue& gyro() const { return variants.front().values[0]; }
  const FrameValue& accel() const { return variants[split ? 1 : 0].values[3]; }
  bool has_temperature() const;
  // Period, increment kinds, pulse weight, temperature. Site, serial and `simulated` are left as they are.
  void describe(RecordingInfo& info) const;
};

Result<FrameDescription> read_frame_description(const std::string& path);
Result<FrameDescription> parse_frame_description(std::string_view text, const std::string& file_name);

// The frame descriptions of imu_io/frames, compiled into the program, so that it runs wherever it is copied to.

// "laser_gyro", "stim300", ...: the files' names without ".frame", in alphabetical order.
std::vector<std::string_view> builtin_frame_names();
// Empty when there is none of that name.
std::string_view builtin_frame_text(std::string_view name);

// A built-in name, or the path of a file where it has a '/' or ends in ".frame".
Result<FrameDescription> find_frame(const std::string& name_or_path);

}  // namespace turncal
