// The plain data of a recording: samples, segments and what is known about unit and site. No model code.
//
// A recording is a contiguous stream of increments (what came in since the previous sample) and a contiguous list of
// segments over the unit's own sample counter. Field meanings are those of the recording's text form (docs/files.md).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"

namespace turncal {

// One row: increments over the sample that ends at counter `counter`. Whole numbers when the unit counts pulses.
struct ImuSample {
  std::int64_t counter = 0;       // the unit's counter, unwrapped; a jump of more than 1 is a gap
  std::array<double, 3> gyro{};   // pulses or rad, body axes x y z
  std::array<double, 3> accel{};  // pulses or m/s
  float temperature_c = std::numeric_limits<float>::quiet_NaN();  // NaN: not measured
  std::uint32_t flags = 0;                                        // 0 good; bits below
};
inline constexpr std::uint32_t sample_flag_invalid = 1;  // the unit marked its data as bad
// Returns one of the six channels, gyros first.
template <class Sample>
auto& channel_of(Sample& sample, std::size_t channel) {
  return channel < 3 ? sample.gyro[channel] : sample.accel[channel - 3];
}

enum class IncrementKind { pulses, physical };  // physical: rad for the gyros, m/s for the accelerometers

struct RecordingInfo {
  double sample_period_s = 0.005;
  double latitude_deg = 0.0;
  double gravity_mps2 = 0.0;
  std::string unit_serial;
  IncrementKind gyro_increment = IncrementKind::pulses;
  IncrementKind accel_increment = IncrementKind::pulses;
  double accel_pulse_mps = 0.0;  // nominal m/s per pulse; used when accel_increment is pulses
  bool has_temperature = false;
  std::optional<std::int64_t> started_utc_s;  // time of the first sample, if known; seconds since 1970-01-01
  bool simulated = false;                     // made by the rig: never yields a production parameter file
};

// align and static: the unit is at rest. rotate: it may be moving (moves, settling, and dwells that were repeated).
enum class SegmentKind { align, still, rotate };  // `still` is written "static" in files

struct Segment {
  int step = 0;
  SegmentKind kind = SegmentKind::still;
  std::int64_t start_sample = 0;  // in unwrapped counter values
  std::int64_t end_sample = 0;    // exclusive
  double heading_deg = 0.0;       // commanded at the end of the segment; cumulative, may exceed 360
  double pitch_deg = 0.0;
  double roll_deg = 0.0;
};
using Segments = std::vector<Segment>;

// A move or a dwell of a plan; each becomes a segment.
struct PlannedMotionItem {
  enum class Kind { move, dwell } kind = Kind::dwell;
  int step = 0;                                 // number of its step
  std::int64_t samples = 0;                     // of a move: including settling
  SegmentKind dwell_kind = SegmentKind::still;  // align or still
  Axis axis = Axis::heading;                    // moves only, as the next four
  double from_deg = 0.0;
  double to_deg = 0.0;
  double rate_degps = 0.0;           // above zero
  double acceleration_degps2 = 0.0;  // above zero, the same for braking
};

}  // namespace turncal
