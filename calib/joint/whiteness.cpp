#include "calib/joint/whiteness.h"

#include <algorithm>
#include <cmath>

#include "calib/model/limits.h"

namespace turncal {

Whiteness test_whiteness(const std::vector<Innovation>& innovations) {
  constexpr int lags = 5;
  Whiteness w;
  w.autocorrelation = Eigen::VectorXd::Zero(lags);
  const NoiseLimits& limits = noise_limits;
  if (innovations.size() < static_cast<std::size_t>(limits.fewest_seconds)) {
    w.message = "too few static seconds to judge";
    return w;
  }
  const auto value = [&](std::size_t i) -> Eigen::Vector3d {
    return innovations[i].normalised.cwiseMax(-limits.outlier).cwiseMin(limits.outlier);
  };
  double square = 0.0;
  double raw = 0.0;
  for (std::size_t i = 0; i < innovations.size(); ++i) {
    square += value(i).squaredNorm();
    raw += innovations[i].normalised.squaredNorm();
    for (int lag = 1; lag <= lags && static_cast<std::size_t>(lag) <= i; ++lag)
      if (innovations[i].block - innovations[i - static_cast<std::size_t>(lag)].block == static_cast<std::size_t>(lag))
        w.autocorrelation[lag - 1] += value(i).dot(value(i - static_cast<std::size_t>(lag)));
  }
  w.autocorrelation /= square;
  w.level = raw / (3.0 * static_cast<double>(innovations.size()));
  const double worst = w.autocorrelation.cwiseAbs().maxCoeff();
  const double values = 3.0 * static_cast<double>(innovations.size());
  const double limit = std::max(limits.white_correlation, limits.of_chance / std::sqrt(values));
  const double level_spread = limits.of_chance * std::sqrt(2.0 / values);
  w.white = worst < limit && w.level > std::min(limits.white_lowest, 1.0 - level_spread) &&
            w.level < std::max(limits.white_highest, 1.0 + level_spread);
  w.message = w.white          ? "innovations are white at the noise model"
              : worst >= limit ? "innovations are correlated in time: the noise model does not fit"
                               : "innovations are larger or smaller than the noise model says";
  return w;
}

}  // namespace turncal
