// What the effects of a parameter file read over each sample of a recording: what `turncal apply` takes off.
//
// The terms are those of the estimate itself (calib/joint/joint_filter.h): constant over a block, one second at rest and at most
// 0.1 s in a turn, evaluated at the rate, specific force, temperature, time and attitude of the block. Time counts from the
// first sample of the recording at hand.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "calib/joint/joint_filter.h"
#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

class EffectTerms {
 public:
  // Reads the recording once. An error when an effect is unknown, needs a temperature that the recording lacks, or needs an
  // attitude (earth rate, magnetic field) and the recording has no table angles.
  static Result<EffectTerms> of(const ParameterFile& file, const std::string& file_name, RecordingSource& source);

  // For samples in counter order.
  struct Term {
    Eigen::Vector3d rate_radps = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();
  };
  const Term& at(std::int64_t counter);

 private:
  // Without segments nothing says when the unit was at rest: every block by its own readings. What follows a rotation is left out.
  Status of_motion_alone(RecordingSource& source, const ParameterFile& file, EffectModel model);

  std::vector<std::int64_t> starts_;
  std::vector<Term> terms_;
  std::size_t index_ = 0;
};

}  // namespace turncal
