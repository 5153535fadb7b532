// A recording with calibrated increments in place of those that the unit gave:
//   dtheta = n counts_gyro - N0 dt  [rad],   dv = a counts_accel - A0 dt  [m/s],   dt the sample period.
// Effects beyond the 24 parameters are taken off as the estimate modelled them (effect_terms.h). Segments, counters, temperatures
// and flags stay.
#pragma once

#include <memory>

#include "calib/model/parameters.h"
#include "imu_io/recordings/recording_source.h"
#include "orchestrator/jobs/effect_terms.h"

namespace turncal {

class CalibratedSource : public RecordingSource {
 public:
  // Errors: the file, or that it is not of this unit and kind of increments. `path`: how it is called. `source` outlives it.
  static Result<std::unique_ptr<CalibratedSource>> of(const ParameterFile& file, const std::string& path,
                                                      RecordingSource& source);

 protected:
  Status stream(const Sink& sink) override;

 private:
  CalibratedSource(RecordingSource& source, const SensorModel& model, EffectTerms effects);
  RecordingSource& source_;
  SensorModel model_;
  EffectTerms effects_;
};

}  // namespace turncal
