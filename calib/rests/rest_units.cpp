#include "calib/rests/rest_units.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <fmt/format.h>

#include "calib/model/attitude.h"
#include "calib/model/limits.h"
#include "calib/rests/rest_model.h"
#include "calib/rests/rest_system.h"
#include "calib/statistics/numerics.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
namespace {

// So many sigma from no error at all (by chance once in 10^6), and from the other sign.
constexpr double surely = 5.0, near_by = 3.0;
constexpr Eigen::Index fewest_rows = 30;

// What carries gravity from rest to rest, where the gyros as given do not: any factor, and any of the 48 ways to connect them. Short turns suggest
// one; where they cannot, the factors between two units, or none. A reversed accelerometer makes the body's frame left-handed, and two gyros turn the
// other way in it.
std::string wrong_gyros(const RestData& data) {
  if (std::ranges::count_if(data.legs, [](const RestLeg& leg) { return leg.fault.empty(); }) < 3) return {};
  const double as_given = rest_misfit_rad(data, Eigen::Matrix3d::Identity());
  if (!(as_given > rest_limits.least_misfit_rad)) return {};
  std::vector<Eigen::Matrix3d> maps = signed_axes();
  for (const UnitSlip& slip : gyro_slips()) maps.emplace_back(Eigen::Matrix3d::Identity() / slip.factor);
  const RecordingInfo& info = data.recording->info;
  const SensorModel model = sensor_model(start_parameters(info), info);
  const std::vector<Block>& blocks = data.recording->blocks;
  const auto row = [&](std::size_t k) {
    return MotionSums{blocks[k].duration_s, model.gyro_scale * blocks[k].gyro, model.accel_scale * blocks[k].accel};
  };
  if (const std::optional<GyroMap> found = gyro_map(blocks.size(), row)) maps.emplace_back(found->factor * found->axes);
  const auto misfit = [&](const Eigen::Matrix3d& map) { return rest_misfit_rad(data, map); };
  Eigen::Matrix3d best = *std::ranges::min_element(maps, {}, misfit);
  best *= best_rest_factor(data, best);
  const double best_misfit = misfit(best);
  if (best_misfit > std::min(rest_limits.least_misfit_rad, rest_limits.of_misfit * as_given)) return {};
  const double factor = std::cbrt(std::abs(best.determinant()));
  std::string wrong = wrong_axes(best / factor);
  if (!wrong.empty() && best.determinant() > 0.0) wrong += "; or one accelerometer is reversed, or two are exchanged";
  if (std::abs(std::log(factor)) < std::log1p(roughest_scale)) return wrong;
  const UnitSlip* const slip = slip_near(gyro_slips(), 1.0 / factor);
  return wrong + fmt::format(
                     "{}gravity's direction after a turn is off by {:.2g} rad as given and by {:.2g} rad with the "
                     "rates divided by {:.3g}: the gyros look {}",
                     wrong.empty() ? "" : "; ", as_given, best_misfit, 1.0 / factor,
                     slip != nullptr ? slip->words : "to be of another unit or scale");
}

}  // namespace

// The gyro rows at rest are r = c (sin L - sin L_stated) - db, db an error of the biases and -c what a vertical earth rate changes: alike on all
// three gyros, which tells it from their sensitivity to gravity.
std::string wrong_vertical(const RestData& data, const Parameters& fitted) {
  const double stated_deg = data.recording->info.latitude_deg, stated = std::sin(stated_deg * rad_per_deg),
               pole = stated_deg < 0.0 ? 1.0 : -1.0;
  CompressedRecording at_pole{data.recording->info, {}, data.recording->blocks, {}, 0, 0.0};
  at_pole.info.latitude_deg = 90.0 * pole;
  RestData other = data;
  other.recording = &at_pole;
  const RestSystem as_given = make_rest_system(data, fitted, EffectModel{}, true);
  const RestSystem elsewhere = make_rest_system(other, fitted, EffectModel{}, false);
  std::vector<Eigen::Index> rows;  // x, y, z of each rest
  for (std::size_t k = 0; k < as_given.kind.size(); ++k)
    if (as_given.kind[k] == RestKind::gyro) rows.push_back(k);
  const Eigen::Index count = rows.size();
  if (count < fewest_rows) return {};
  Eigen::MatrixXd of_bias(count, 3), c = Eigen::MatrixXd::Zero(count, 3);  // the columns of N0 come first
  Eigen::VectorXd r(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    of_bias.row(k) = as_given.jacobian.row(rows[k]).head(3);
    r[k] = as_given.residual[rows[k]];
    c(k, k % 3) = (r[k] - elsewhere.residual[rows[k]]) / (pole - stated);
  }
  const Eigen::MatrixXd B = column_space(of_bias);
  r -= B * (B.transpose() * r);
  c -= B * (B.transpose() * c);
  const Eigen::Array3d information = c.colwise().squaredNorm();
  if (!(information > 0.0).all()) return {};
  const Eigen::Array3d each = (c.transpose() * r).array() / information;
  const double off = (information * each).sum() / information.sum();
  const double variance = (r - c * each.matrix()).squaredNorm() / double(count - 6);
  const double sigma = std::sqrt(variance / information.sum());
  const bool alike = (information * (each - off).square()).sum() < surely * surely * variance;
  if (!(std::abs(off) > surely * sigma) || !alike || std::abs(stated + off) > 1.0 + near_by * sigma) return {};
  return fmt::format(
      "expected the latitude of the site{}: the gyros at rest measure another vertical earth rate than that of "
      "latitude "
      "{:.6g} deg, {:.2g} sigma off",
      stated * (stated + off) < 0.0 ? ", or accelerometers that read specific force (up at rest), not gravity" : "",
      stated_deg, std::abs(off) / sigma);
}

std::string wrong_units(const RestData& data) {
  std::string both = wrong_accelerometers(*data.recording);
  // Gravity's direction does not depend on the accelerometers' common scale.
  const std::string gyro = wrong_gyros(data);
  if (!both.empty() && !gyro.empty()) both += "; ";
  return both + gyro;
}

}  // namespace turncal
