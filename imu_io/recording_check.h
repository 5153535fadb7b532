// What every recording must fulfil, whoever writes or reads it. Messages name the field; the caller puts the file in front.
#pragma once

#include <cstdint>
#include <string>

#include "calib/recording_types.h"
#include "calib/status.h"

namespace turncal {

// Accepted gravity at the site; a value outside is a slip of unit or of pen.
inline constexpr double min_gravity_mps2 = 9.0;
inline constexpr double max_gravity_mps2 = 11.0;

// Period, latitude, gravity, pulse weight, serial. `where` begins every message ("recording.conf").
Status check_info(const RecordingInfo& info, const std::string& where);

// Segments contiguous, not empty, inside the samples first_counter..last_counter. No segment at all is accepted:
// a recording may still have to be segmented.
Status check_segments(const Segments& segments, std::int64_t first_counter, std::int64_t last_counter,
                      const std::string& where);

// A serial or other short text that can stand as a value in a text file: not empty, printable, no '#', no blank at an end.
bool is_plain_text(const std::string& text);

}  // namespace turncal
