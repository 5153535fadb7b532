// One joint estimate while it is being made: its course is in joint_estimate.cpp, the Gauss-Newton steps in joint_iterations.cpp.
// Only these two include this.
#pragma once

#include <cmath>
#include <vector>

#include "calib/joint/coarser_recording.h"
#include "calib/joint/joint_estimate.h"

namespace turncal {

// Far from the solution it is enough to come within some sigma of it. Beside it, the middle of a dwell says little second by
// second: the sigmas are 0.1 to 0.5 % larger than from every second.
inline constexpr Coarseness far_off = {20.0, 0.05};
inline constexpr Coarseness close_by = {8.0, 0.025};
inline constexpr Coarseness for_noise = {8.0, 0.0};
inline constexpr Coarseness for_noise_of_trials = {20.0, 0.0};

class JointRun {
 public:
  JointRun(const CompressedRecording& recording, const JointOptions& options)
      : recording_(recording),
        options_(options),
        reference_temperature_c_(options.reference_temperature_c.value_or(
            std::isnan(recording.mean_temperature_c) ? 0.0 : recording.mean_temperature_c)) {
    effects_ = make_effect_model(options.effects, {recording.info.latitude_deg}, reference_temperature_c_);
    if (options.free_parameters) subset_ = *options.free_parameters;
    for (int k = 0; k < parameter_count && !options.free_parameters; ++k)
      if (parameter_is_free[static_cast<std::size_t>(k)]) subset_.push_back(k);
    if (options.start_effects.size() == effects_.columns) effects_.values = options.start_effects;
    for (int k = 0; k < effects_.columns && !options.fixed_effects; ++k) subset_.push_back(parameter_count + k);
  }

  JointResult run();

 private:
  void start_of_each();
  bool settle();
  bool settle_from_here();
  bool iterate(double tolerance, int max_iterations, const Coarseness& coarseness);
  double improve(const FilterResult& pass);
  void move(const Eigen::VectorXd& step);
  double out_of_range();
  double& value_of(int column, ParameterVector& parameters) {
    return column < parameter_count ? parameters[column] : effects_.values[column - parameter_count];
  }
  void step_within_ranges(const FilterResult& pass, Eigen::VectorXd& step, Eigen::VectorXd& sigma);
  void look_for_faults();
  bool is_open() const { return solution_.undetermined.cols() > 0; }
  bool last_passes();
  void widen();
  void report();

  const CompressedRecording& recording_;
  const JointOptions& options_;
  Eigen::VectorXd ranges_;
  const double reference_temperature_c_;
  EffectModel effects_;
  std::vector<int> subset_;
  Eigen::VectorXd start_;  // where the parameters of the subset began
  SubsetSolution solution_;
  Eigen::VectorXd step_;  // of the subset, the last one taken
  // Of the noise, as long as the misfit is larger: else residuals push what hardly shows in them.
  double looseness_ = 1.0;
  double misfit_ = 0.0;  // chi-square an observation before the last step of iterate()
  JointResult result_;
};

}  // namespace turncal
