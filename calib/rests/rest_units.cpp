#include "calib/rests/rest_units.h"

#include <algorithm>
#include <cmath>
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

std::string wrong_accelerometer_unit(const RestData& data) {
  if (data.rests.empty()) return {};
  const RecordingInfo& info = data.recording->info;
  const SensorModel model = sensor_model(start_parameters(info), info);
  std::vector<double> norms;
  for (const Rest& rest : data.rests) norms.push_back((model.accel_scale * rest.whole.accel).norm());
  return wrong_gravity(median(norms) / info.gravity_mps2, info);
}

std::string wrong_gyro_unit(const RestData& data, double as_given) {
  const UnitSlip* best = nullptr;
  double best_misfit = as_given;
  for (const UnitSlip& slip : gyro_slips())
    if (const double misfit = rest_misfit_rad(data, 1.0 / slip.factor); misfit < best_misfit) {
      best = &slip;
      best_misfit = misfit;
    }
  // A factor between, which is a scale and no slip, explains the turns as well: then nothing is said.
  if (best == nullptr || best_misfit > rest_limits.of_misfit * as_given) return {};
  if (rest_misfit_rad(data, (1.0 - slip_nearness) / best->factor) < best_misfit ||
      rest_misfit_rad(data, (1.0 + slip_nearness) / best->factor) < best_misfit)
    return {};
  return fmt::format(
      "gravity's direction after a turn is off by {:.2g} rad as given and by {:.2g} rad with the rates divided by "
      "{:.3g}: the gyros look {}",
      as_given, best_misfit, best->factor, best->words);
}

// The best of the 48 ways to connect three gyros, forwards or reversed: a fit from the nominal scale does not come back from another. A reversed
// accelerometer makes the body's frame left-handed, and two gyros turn the other way in it.
std::string wrong_gyro_axes(const RestData& data, double as_given) {
  Eigen::Matrix3d best = Eigen::Matrix3d::Identity();
  double best_misfit = rest_limits.of_misfit * as_given;
  for (const Eigen::Matrix3d& map : signed_axes())
    if (const double misfit = rest_misfit_rad(data, map); misfit < best_misfit) best = map, best_misfit = misfit;
  std::string wrong = wrong_axes(best);
  if (!wrong.empty() && best.determinant() > 0.0) wrong += "; or one accelerometer is reversed, or two are exchanged";
  return wrong;
}

std::string wrong_gyros(const RestData& data) {
  if (std::ranges::count_if(data.legs, [](const RestLeg& leg) { return leg.fault.empty(); }) < 3) return {};
  const double as_given = rest_misfit_rad(data, 1.0);
  if (!(as_given > rest_limits.least_misfit_rad)) return {};
  const std::string unit = wrong_gyro_unit(data, as_given);
  return unit.empty() ? wrong_gyro_axes(data, as_given) : unit;
}

}  // namespace

// The gyro rows at rest are r = k c - db, c = w_ie sin(latitude) u as it is taken off, db an error of the biases. k = 0 as it should be, -2 with the
// other sign.
std::string wrong_vertical(const RestData& data, const Parameters& fitted) {
  CompressedRecording other_side{data.recording->info, {}, data.recording->blocks, {}, 0, 0.0};
  other_side.info.latitude_deg = -other_side.info.latitude_deg;
  RestData other = data;
  other.recording = &other_side;
  const RestSystem as_given = make_rest_system(data, fitted, EffectModel{}, true);
  const RestSystem reversed = make_rest_system(other, fitted, EffectModel{}, false);
  std::vector<Eigen::Index> rows;
  for (std::size_t k = 0; k < as_given.kind.size(); ++k)
    if (as_given.kind[k] == RestKind::gyro) rows.push_back(k);
  const Eigen::Index count = rows.size();
  if (count < fewest_rows) return {};
  Eigen::MatrixXd of_bias(count, 3);  // the columns of N0 come first
  Eigen::VectorXd r(count), c(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const Eigen::Index row = rows[k];
    of_bias.row(k) = as_given.jacobian.row(row).head(3);
    r[k] = as_given.residual[row];
    c[k] = 0.5 * (reversed.residual[row] - r[k]);
  }
  const Eigen::MatrixXd B = column_space(of_bias);
  r -= B * (B.transpose() * r);
  c -= B * (B.transpose() * c);
  const double information = c.squaredNorm();
  if (!(information > 0.0)) return {};
  const double k = c.dot(r) / information;
  const double sigma = std::sqrt((r - k * c).squaredNorm() / (static_cast<double>(count - 4) * information));
  if (!(std::abs(k) > surely * sigma) || std::abs(k + 2.0) > near_by * sigma) return {};
  return fmt::format(
      "the gyros at rest feel {:.2f} +- {:.2f} of the vertical earth rate of latitude {:.6g} deg: expected the "
      "other sign of the latitude, or accelerometers that read specific force (up at rest), not gravity",
      1.0 + k, sigma, data.recording->info.latitude_deg);
}

std::string wrong_units(const RestData& data) {
  std::string both = wrong_accelerometer_unit(data);
  // Gravity's direction does not depend on the accelerometers' common scale.
  const std::string gyro = wrong_gyros(data);
  if (!both.empty() && !gyro.empty()) both += "; ";
  return both + gyro;
}

}  // namespace turncal
