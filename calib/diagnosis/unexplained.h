// Patterns without a physical name, tested beside the catalogue so that a residual which is none of the catalogue's is not
// given a name of it: bias steps at times through the run, slow periodic biases, biases that go with a table angle,
// biases that remember which way up the sensor was (hysteresis), and scale factors that are others in the next recording.
// They are never added to a model or written to a file as effects: where one of them explains the residual better than any effect, the verdict is `unexplained`, and the pattern
// is described.
#pragma once

#include <string>
#include <vector>

#include "calib/model/effects.h"
#include "calib/statistics/compression.h"

namespace turncal {

// Columns for make_effect_model(), through the same machinery as the catalogue's. `parts`: JoinedRecordings; steps and waves are of one.
std::vector<EffectColumn> pattern_columns(const std::vector<const CompressedRecording*>& parts);
// The same pattern at so many finer steps of its time or period around the present one; empty where there is nothing to refine.
inline constexpr int refined_values = 11;
std::vector<EffectColumn> refined(const EffectColumn& column, const std::vector<const CompressedRecording*>& parts);
// A step or a wave in time: a drift or a temperature effect must do at least as well to be named.
bool depends_on_time_only(const EffectColumn& pattern);
bool is_pattern(const EffectColumn& column);
// "bias step of gyro z at 3200 s"
std::string describe_pattern(const EffectColumn& column);

}  // namespace turncal
