// A recording: the samples of a unit, and its rests. Files: docs/files.md.
//
// Held in memory, 64 bytes a sample: 92 MB for two hours at 200 Hz.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <turncal/error.h>

namespace turncal::v0 {

struct Sample {
  std::int64_t counter = 0;       // the unit's own, unwrapped; a step of more than 1 is a gap
  std::array<double, 3> gyro{};   // increment since the last sample: pulses or rad
  std::array<double, 3> accel{};  // pulses or m/s
  float temperature_c = std::numeric_limits<float>::quiet_NaN();  // NaN: not measured
  std::uint32_t flags = 0;                                        // 0: good
};

enum class SegmentKind { align, still, rotate };  // align and still: at rest. still is "static" in files

struct Segment {
  int step = 0;
  SegmentKind kind = SegmentKind::still;
  std::int64_t start_sample = 0, end_sample = 0;              // counters; the end is exclusive
  double heading_deg = 0.0, pitch_deg = 0.0, roll_deg = 0.0;  // table angles at its end; all 0: turned by hand
};

enum class IncrementKind { pulses, physical };  // physical: rad, m/s

struct RecordingInfo {
  double sample_period_s = 0.005;
  double latitude_deg = 0.0;  // latitude of the site
  double gravity_mps2 = 0.0;
  std::string unit_serial;
  IncrementKind gyro_increment = IncrementKind::pulses;
  IncrementKind accel_increment = IncrementKind::pulses;
  double accel_pulse_mps = 0.0;  // nominal weight of a pulse
  bool has_temperature = false;
  std::optional<std::int64_t> started_utc_s;  // since 1970-01-01
  bool simulated = false;                     // its parameters are not for a real unit
};

class TURNCAL_API Recording {
 public:
  // Loads a folder or a .tcr file, as the program does.
  static Recording load(const std::string& path);
  // Imports a table of numbers (CSV, .npy, .mat, HDF5) or a ROS bag, by a map of its columns (docs/import.md); without segments.
  static Recording import_table(const std::string& path, const std::string& map);
  // Returns the same samples with the rests that `turncal segment` finds, for a unit turned by hand.
  Recording with_rests(double min_rest_s = 1.5) const;

  const std::string& path() const;
  RecordingInfo info() const;
  std::span<const Sample> samples() const;  // valid as long as a copy of this object lives
  std::span<const Segment> segments() const;
  std::string damage() const;  // data lost in the file, one line; empty: none
  // What the command says of it, a line each: `turncal import` of a table; `turncal apply` of parameters that are not trusted, or are used
  // outside the range of their temperatures.
  std::vector<std::string> notes() const;
  std::string hash() const;  // record.hash of the parameter file: the same for every form of a recording

  struct Content;
  explicit Recording(std::shared_ptr<const Content> content) : content_(std::move(content)) {}
  const Content& content() const { return *content_; }

 private:
  std::shared_ptr<const Content> content_;
};

}  // namespace turncal::v0
