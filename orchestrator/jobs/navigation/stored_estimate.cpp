#include "orchestrator/jobs/navigation/stored_estimate.h"

#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

Error bad_value(const std::string& file_name, const std::string& key, const std::string& value, const char* expected) {
  return input_error(file_name + ": key '" + key + "' = '" + value + "': expected " + expected);
}

// Into `value` (times `unit`) where the key is there.
Status take(const ParameterFile& file, const std::string& file_name, const std::string& key, double unit,
            double& value) {
  const std::string* const text = find_further(file, key);
  if (text == nullptr) return {};
  const std::optional<double> number = parse_number(*text);
  if (!number || *number < 0.0) return bad_value(file_name, key, *text, "a number of 0 or more");
  value = *number * unit;
  return {};
}

}  // namespace

bool has_noise(const ParameterFile& file) {
  return find_further(file, "noise.angle_random_walk.x_deg_per_rt_h") != nullptr;
}

Result<NoiseModel> stored_noise(const ParameterFile& file, const std::string& file_name) {
  NoiseModel noise;
  const bool counts = file.accel_increment == IncrementKind::pulses;
  noise.accel_pulse_mps = counts ? file.accel_pulse_mps : 0.0;
  for (int k = 0; k < 3; ++k) {
    const std::string axis(1, "xyz"[k]);
    TRY(take(file, file_name, "noise.angle_random_walk." + axis + "_deg_per_rt_h", radprs_per_degprh,
             noise.angle_random_walk[k]));
    TRY(take(file, file_name, "noise.velocity_random_walk." + axis + "_ug_per_rt_hz", mpsprs_per_ugprHz,
             noise.velocity_random_walk[k]));
  }
  for (const auto& [key, unit, value] :
       {std::tuple{"noise.gyro_bias_instability_degph", radps_per_degph, &noise.gyro_bias_instability_radps},
        std::tuple{"noise.accel_bias_instability_ug", mpsprs_per_ugprHz, &noise.accel_bias_instability_mps2},
        std::tuple{"noise.gyro_pulse_arcsec", rad_per_arcsec, &noise.gyro_pulse_rad},
        std::tuple{"noise.bias_correlation_s", 1.0, &noise.bias_correlation_s}})
    TRY(take(file, file_name, key, unit, *value));
  if (noise.bias_correlation_s <= 0.0) return bad_value(file_name, "noise.bias_correlation_s", "0", "a number above 0");
  return noise;
}

Result<StoredCovariance> stored_covariance(const ParameterFile& file, const std::string& file_name) {
  StoredCovariance stored;
  if (!file.effects.empty()) {
    stored.source = "effects";
    return stored;
  }
  ParameterVector sigma = ParameterVector::Zero();
  for (int k = 0; k < parameter_count; ++k) sigma[k] = file.sigma[static_cast<std::size_t>(k)].value_or(0.0);
  if (sigma.any()) {
    stored.source = "sigmas";
    stored.covariance = sigma.cwiseAbs2().asDiagonal();
  }
  std::vector<int> rows;  // those that have a line, in order
  for (int k = 0; k < parameter_count; ++k) {
    const std::string key = "quality.covariance." + std::string(parameter_keys[static_cast<std::size_t>(k)]);
    const std::string* const text = find_further(file, key);
    if (text == nullptr) continue;
    rows.push_back(k);
    const std::vector<std::string_view> words = split_words(*text);
    if (words.size() != rows.size())
      return bad_value(file_name, key, *text, (std::to_string(rows.size()) + " numbers").c_str());
    for (std::size_t j = 0; j < words.size(); ++j) {
      const std::optional<double> number = parse_number(words[j]);
      if (!number) return bad_value(file_name, key, std::string(words[j]), "a number");
      stored.covariance(k, rows[j]) = stored.covariance(rows[j], k) = *number;
    }
  }
  if (rows.empty()) return stored;
  stored.source = "covariance";
  ParameterVector scale = ParameterVector::Ones();
  for (const int k : rows) {
    if (!(stored.covariance(k, k) > 0.0))
      return bad_value(file_name, "quality.covariance." + std::string(parameter_keys[static_cast<std::size_t>(k)]),
                       format_number(stored.covariance(k, k)), "a variance above 0");
    if (sigma[k] > 0.0) scale[k] = sigma[k] / std::sqrt(stored.covariance(k, k));
  }
  stored.covariance = scale.asDiagonal() * stored.covariance * scale.asDiagonal();
  return stored;
}

}  // namespace turncal
