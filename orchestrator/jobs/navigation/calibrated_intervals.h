// A recording read once, its samples calibrated by one or more parameter files, as intervals of motion (calib/navigation/increments.h).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/navigation/increments.h"
#include "calib/navigation/reference_track.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/effect_terms.h"
#include "orchestrator/jobs/navigation/sample_gap.h"

namespace turncal {

inline constexpr double motion_interval_s = 0.1;  // or a sample, where that is longer

struct CalibratedIntervals {
  std::string path;  // of the parameter file
  ParameterFile file;
  SensorModel model;
  EffectTerms effects;
  IncrementIntegrator integrator;
};

// Before any sample is read. Errors: the file, or that it is not of this unit and kind of increments.
// `path`: how the file is called.
Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source);
Result<CalibratedIntervals> calibrated_intervals(const std::string& path, RecordingSource& source);

struct Stretch {  // s from the first sample
  double from_s = 0.0;
  std::optional<double> to_s;  // default: the end
};
struct IntegratedSamples {
  std::int64_t first_sample = 0;  // counter of the first, where the first interval begins
  std::vector<SampleGap> gaps;
  std::vector<std::string> faults;  // what cannot be true, a line each
};
// Samples marked as bad count as lost, and so do those that cannot be true, by the same rules as in a calibration (compression.h,
// implausible.h); an interval with a part of a long gap is not at rest. Without segments everything is at rest, but for what the reference
// says.
// Errors: also samples that are not finite, gyros or accelerometers that give nothing but zeros, and motion that nothing can make.
Result<IntegratedSamples> integrate_recording(RecordingSource& source, const Stretch& stretch,
                                              std::vector<CalibratedIntervals>& files,
                                              const ReferenceTrack* reference = nullptr);

}  // namespace turncal
