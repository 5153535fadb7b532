#include "calib/rests/rest_units.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/rests/rest_start.h"
#include "calib/statistics/median.h"
#include "calib/statistics/unit_slip.h"

namespace turncal {
std::string wrong_accelerometer_unit(const RestData& data) {
  if (data.rests.empty()) return {};
  const RecordingInfo& info = data.recording->info;
  const SensorModel model = sensor_model(start_parameters(info), info);
  std::vector<double> norms;
  for (const Rest& rest : data.rests) norms.push_back((model.accel_scale * rest.whole.accel).norm());
  const double norm = median(norms);
  const UnitSlip* const slip = slip_near(accel_slips(), norm / info.gravity_mps2);
  if (slip == nullptr) return {};
  char text[200];
  std::snprintf(text, sizeof text, "gravity reads %.3g where %.3g m/s^2 is expected: the accelerometers look %s", norm,
                info.gravity_mps2, slip->words);
  return text;
}

std::string wrong_gyro_unit(const RestData& data) {
  if (std::count_if(data.legs.begin(), data.legs.end(), [](const RestLeg& leg) { return leg.fault.empty(); }) < 3)
    return {};
  const double as_given = rest_misfit_rad(data, 1.0);
  if (!(as_given > rest_limits.least_misfit_rad)) return {};
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
  char text[200];
  std::snprintf(
      text, sizeof text,
      "gravity's direction after a turn is off by %.2g rad as given and by %.2g rad with the rates divided by "
      "%.3g: the gyros look %s",
      as_given, best_misfit, best->factor, best->words);
  return text;
}

std::string wrong_units(const RestData& data) {
  std::string both = wrong_accelerometer_unit(data);
  // Gravity's direction does not depend on the accelerometers' common scale.
  const std::string gyro = wrong_gyro_unit(data);
  if (!both.empty() && !gyro.empty()) both += "; ";
  return both + gyro;
}

}  // namespace turncal
