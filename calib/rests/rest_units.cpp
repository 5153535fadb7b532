#include "calib/rests/rest_units.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <fmt/format.h>

#include "calib/model/attitude.h"
#include "calib/model/limits.h"
#include "calib/rests/rest_model.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

// Returns how the gyros are wrong if, as given, they do not carry gravity from rest to rest. Tried are all 48 ways to connect
// them, the factors between two units, and the map that short turns suggest; with too few turns between rests that map decides
// alone. A reversed accelerometer makes the body frame left-handed, and two gyros turn the other way in it.
std::string wrong_gyros(const RestData& data) {
  const RecordingInfo& info = data.recording->info;
  const SensorModel model = sensor_model(start_parameters(info), info);
  const std::vector<Block>& blocks = data.recording->blocks;
  const auto row = [&](std::size_t k) {
    return MotionSums{blocks[k].duration_s, model.gyro_scale * blocks[k].gyro, model.accel_scale * blocks[k].accel};
  };
  const auto usable = std::ranges::count_if(data.legs, [](const RestLeg& leg) { return leg.fault.empty(); });
  const double as_given = usable < 3 ? 0.0 : rest_misfit_rad(data, Eigen::Matrix3d::Identity());
  if (usable >= 3 && !(as_given > rest_limits.least_misfit_rad)) return {};
  const std::optional<GyroMap> seen = gyro_map(blocks.size(), row);
  Eigen::Matrix3d best = seen ? Eigen::Matrix3d(seen->factor * seen->axes) : Eigen::Matrix3d::Identity();
  std::string evidence = "gravity's direction follows the gyros only";
  if (usable >= 3) {
    std::vector<Eigen::Matrix3d> maps = signed_axes();
    for (const UnitSlip& slip : gyro_slips()) maps.emplace_back(Eigen::Matrix3d::Identity() / slip.factor);
    maps.push_back(best);
    const auto misfit = [&](const Eigen::Matrix3d& map) { return rest_misfit_rad(data, map); };
    best = *std::ranges::min_element(maps, {}, misfit);
    best *= best_rest_factor(data, best);
    const double best_misfit = misfit(best);
    if (best_misfit > std::min(rest_limits.least_misfit_rad, rest_limits.of_misfit * as_given)) return {};
    evidence = fmt::format("gravity's direction after a turn is off by {:.2g} rad as given and by {:.2g} rad", as_given,
                           best_misfit);
  }
  const double factor = std::cbrt(std::abs(best.determinant()));
  std::string wrong = wrong_axes(best / factor);
  if (!wrong.empty() && best.determinant() > 0.0) wrong += "; or one accelerometer is reversed, or two are exchanged";
  if (std::abs(std::log(factor)) < std::log1p(usable < 3 ? roughest_motion : roughest_scale)) return wrong;
  const UnitSlip* const slip = slip_near(gyro_slips(), 1.0 / factor);
  return wrong + fmt::format("{}{} with the rates divided by {:.3g}: the gyros look {}", wrong.empty() ? "" : "; ",
                             evidence, 1.0 / factor, slip != nullptr ? slip->words : "to be of another unit or scale");
}

}  // namespace

std::string wrong_units(const RestData& data) {
  std::string both = wrong_accelerometers(*data.recording);
  // Gravity's direction does not depend on the accelerometers' common scale.
  const std::string gyro = wrong_gyros(data);
  if (!both.empty() && !gyro.empty()) both += "; ";
  return both + gyro;
}

}  // namespace turncal
