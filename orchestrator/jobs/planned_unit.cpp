#include "orchestrator/jobs/planned_unit.h"

#include <fmt/format.h>

#include <cmath>

#include "calib/prediction/predict.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_table.h"
#include "orchestrator/devices/station_rig.h"
#include "orchestrator/jobs/run_request.h"

namespace turncal {

Status check_option(const char* option, double value, double min, double max, bool min_excluded) {
  const bool good = (min_excluded ? value > min : value >= min) && value <= max;  // false for NaN
  if (good) return {};
  return input_error(
      std::string(option) + " = " + format_number(value) + ": expected a number " +
      (min_excluded ? "above " + format_number(min) + " and not above " : "from " + format_number(min) + " to ") +
      format_number(max));
}

Result<double> parse_time_s(const char* option, const std::string& text) {
  constexpr double longest_s = 86400.0;
  std::string_view number = text;
  double unit = 1.0;
  for (const auto& [name, seconds] : {std::pair{"min", 60.0}, std::pair{"h", 3600.0}, std::pair{"s", 1.0}}) {
    if (!number.ends_with(name)) continue;
    number.remove_suffix(std::string_view(name).size());
    unit = seconds;
    break;
  }
  const std::optional<double> value = parse_number(number);
  if (!value || *value * unit < 1.0 || *value * unit > longest_s)
    return input_error(std::string(option) + " '" + text +
                       "': expected a time from 1s to 24h, like 1h, 90min or 5400s");
  return *value * unit;
}

Status check_site(const PlannedSite& site) {
  for (const Status& status : {
           check_option("--latitude", site.latitude_deg.value_or(0.0), site_latitude_deg.min, site_latitude_deg.max),
           check_option("--gravity", site.gravity_mps2.value_or(standard_gravity_mps2), site_gravity_mps2.min,
                        site_gravity_mps2.max),
           check_option("--arw", site.arw_deg_per_rt_h, 0.0, 1000.0, true),
           check_option("--vrw", site.vrw_ug_per_rt_hz, 0.0, 1e6, true),
           check_option("--gyro-bias-instability", site.gyro_bias_instability_degph, 0.0, 1e4),
           check_option("--accel-bias-instability", site.accel_bias_instability_ug, 0.0, 1e5),
       })
    if (!status) return status;
  return {};
}

Result<PlannedUnit> planned_unit(const PlannedSite& site) {
  const StationConfig station =
      TRY(site.station.empty() ? Result<StationConfig>(default_station_config()) : read_station_config(site.station));
  RigConfig rig = TRY(rig_of(station));
  PlannedUnit unit;
  unit.station = station;
  unit.info = planned_info(station, &rig);
  if (site.latitude_deg) unit.info.latitude_deg = *site.latitude_deg;
  if (site.gravity_mps2) unit.info.gravity_mps2 = *site.gravity_mps2;
  unit.info.simulated = true;
  unit.parameters = typical_unit(unit.info);
  unit.parameters.n = Eigen::Matrix3d::Identity() * rig.gyro_pulse_arcsec;
  return unit;
}

NoiseModel noise_model(const PlannedSite& site) {
  NoiseModel noise;
  noise.angle_random_walk.setConstant(site.arw_deg_per_rt_h * radprs_per_degprh);
  noise.velocity_random_walk.setConstant(site.vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  noise.gyro_bias_instability_radps = site.gyro_bias_instability_degph * radps_per_degph;
  noise.accel_bias_instability_mps2 = site.accel_bias_instability_ug * 1e-6 * standard_gravity_mps2;
  return noise;
}

Facts describe_premises(const PlannedSite& site, const RecordingInfo& info) {
  return {{{"noise", fmt::format("{} deg/sqrt(h), {} ug/sqrt(Hz); bias instability {} deg/h, {} ug; pulse {} m/s",
                                 format_number(site.arw_deg_per_rt_h), format_number(site.vrw_ug_per_rt_hz),
                                 format_number(site.gyro_bias_instability_degph),
                                 format_number(site.accel_bias_instability_ug), format_number(info.accel_pulse_mps))},
           {"site", fmt::format("latitude {} deg, gravity {} m/s^2; IMU at {} Hz", format_number(info.latitude_deg),
                                format_number(info.gravity_mps2),
                                format_number(std::round(1e6 / info.sample_period_s) / 1e6))}}};
}

namespace {

constexpr std::size_t most_predicted = 20000;  // items: some 10 s of a core
constexpr double good_arw_deg_per_rt_h = 0.002, good_vrw_ug_per_rt_hz = 8.0;

}  // namespace

PlannedMotion planned_motion(const Sequence& sequence, const Plan& plan) {
  PlannedMotion motion;
  motion.start_deg = sequence.start_deg;
  for (const PlannedItem& item : plan.items) {
    PlannedMotionItem planned;
    planned.kind =
        item.kind == SequenceItem::Kind::move ? PlannedMotionItem::Kind::move : PlannedMotionItem::Kind::dwell;
    planned.step = item.step;
    planned.samples = item.samples;
    planned.dwell_kind = item.dwell_kind;
    planned.axis = item.axis;
    planned.from_deg = item.from_deg;
    planned.to_deg = item.to_deg;
    planned.rate_degps = item.rate_degps;
    planned.acceleration_degps2 = item.acceleration_degps2;
    motion.items.push_back(planned);
  }
  return motion;
}

std::vector<std::string> undetermined_by(const Sequence& sequence, const Plan& plan, const RecordingInfo& info) {
  if (plan.items.size() > most_predicted) return {};
  PredictOptions options;
  options.noise.angle_random_walk.setConstant(good_arw_deg_per_rt_h * radprs_per_degprh);
  options.noise.velocity_random_walk.setConstant(good_vrw_ug_per_rt_hz * mpsprs_per_ugprHz);
  ParameterVector asked;
  for (int k = 0; k < parameter_count; ++k) asked[k] = parameter_is_free[static_cast<std::size_t>(k)] ? 1.0 : 0.0;
  return open_parameters(predict(info, planned_motion(sequence, plan), options), asked);
}

std::vector<std::string> open_parameters(const Prediction& prediction, const ParameterVector& asked) {
  std::vector<std::string> keys;
  for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
    const bool determined = prediction.valid && prediction.determined[k];
    if (asked[static_cast<Eigen::Index>(k)] > 0.0 && !determined) keys.emplace_back(parameter_keys[k]);
  }
  return keys;
}

std::string coverage_text(const std::vector<std::string>& keys) {
  std::string text = "does not determine";
  if (keys.size() == parameter_keys.size() - 3) {
    text += " any parameter";
  } else {
    for (const std::string& key : keys) text += " " + key;
  }
  return text + ": expected steps that do (turncal predict)";
}

}  // namespace turncal
