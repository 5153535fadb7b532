#include "orchestrator/line/parameter_history.h"

#include "calib/model/parameters.h"

namespace turncal {

ParameterHistory parameter_history(const std::vector<StoredCalibration>& all, std::string_view key) {
  ParameterHistory history;
  history.key = key;
  for (const StoredCalibration& c : all) {
    for (const StoredValue& value : c.values) {
      if (value.key != key) continue;
      history.of.push_back(&c);
      history.units.push_back(c.unit);
      history.times.push_back(c.time_utc);
      history.values.push_back(value.value);
      history.sigmas.push_back(value.sigma);
      if (value.limit.min || value.limit.max) history.limit = value.limit;
    }
  }
  history.chart = control_chart(history.values, history.limit);
  return history;
}

std::vector<std::string_view> free_parameter_keys() {
  std::vector<std::string_view> keys;
  for (std::size_t i = 0; i < parameter_keys.size(); ++i) {
    if (parameter_is_free[i]) keys.push_back(parameter_keys[i]);
  }
  return keys;
}

}  // namespace turncal
