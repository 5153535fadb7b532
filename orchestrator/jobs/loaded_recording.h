// A recording read once, from its beginning, into the sufficient statistics that calibration and diagnosis both start from.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/statistics/compression.h"
#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

// What is said of a recording turned by hand, which has no other mark (segmentation.h, without_table_angles).
inline constexpr const char* no_table_angles = "all table angles are 0, as of a unit turned by hand";

struct LoadedRecording {
  std::string path;
  CompressedRecording data;
  RecordingDamage damage;
  std::string hash;          // of the contents (RecordingSource::content_hash)
  double recorded_s = 0.0;   // of all its segments
  bool by_hand = false;      // no table angles
  std::string dead_channel;  // data_screen.h, of a recording with table angles
};

// Blocks as short as the recording needs: those of rests found by hand where it has no table angles. `progress`, if given, is
// told the number of samples read so far; `blocks`: others; `before_step`: what later steps recorded is left out (0: nothing is). An
// error when the recording has no segments.
Result<LoadedRecording> load_recording(RecordingSource& source, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);
Result<LoadedRecording> load_recording(const std::string& path, const std::function<void(std::int64_t)>& progress = {},
                                       const std::optional<CompressionOptions>& blocks = {}, int before_step = 0);

// An error when there is nothing to calibrate from: a channel that does not live, units that are
// plainly wrong, not one whole second at rest.
Status check_data(const LoadedRecording& loaded);

// An error when two of them are the same, or they are not of one unit, recorded in one way, and all with table angles or all without.
Status check_same_unit(const std::vector<const LoadedRecording*>& recordings);

}  // namespace turncal
