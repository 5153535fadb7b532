#include "calib/joint/noise_pull.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace turncal {

Eigen::VectorXd pull_of_noise(const CompressedRecording& recording, const Parameters& parameters,
                              const EffectModel& effects, const FilterSetup& at, const std::vector<int>& free,
                              const Eigen::MatrixXd& covariance) {
  constexpr double step = 0.01;        // of a variance
  constexpr double negligible = 0.01;  // of a sigma
  constexpr std::array<int, 6> scales = {6, 10, 14, 15, 19, 23};
  const ParameterVector values = to_vector(parameters);
  const double all = static_cast<double>(
      std::count_if(recording.blocks.begin(), recording.blocks.end(), [](const Block& b) { return b.whole_second; }));
  Eigen::VectorXd pull = Eigen::VectorXd::Zero(parameter_count);
  std::optional<double> log_determinant;
  const auto pass = [&](const NoiseModel& noise) {
    FilterSetup setup = at;
    setup.with_columns = false;
    setup.noise = noise;
    return run_filter(recording, parameters, effects, setup).log_determinant;
  };
  for (std::size_t k = 0; k < scales.size(); ++k) {
    const auto found = std::find(free.begin(), free.end(), scales[k]);
    if (found == free.end()) continue;
    const auto row = found - free.begin();
    const double sigma = std::sqrt(covariance(row, row));
    const double value = values[scales[k]];
    if (3.0 * all * sigma < negligible * std::abs(value)) continue;  // were all of S this one's
    if (!log_determinant) log_determinant = pass(at.noise);
    NoiseModel louder = at.noise;
    (k < 3 ? louder.angle_random_walk : louder.velocity_random_walk)[static_cast<Eigen::Index>(k % 3)] *=
        std::sqrt(1.0 + step);
    pull[scales[k]] = (pass(louder) - *log_determinant) / step / value;
  }
  return pull;
}

}  // namespace turncal
