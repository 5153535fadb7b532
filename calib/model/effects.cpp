#include "calib/model/effects.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace turncal {

namespace {

using Eigen::Vector3d;

constexpr int most_components = 18;

// The memory of effects that depend on earlier blocks; called block after block, from the first on.
class History {
 public:
  // Lags f and T by the time constant tau (0: none), and integrates the rotation.
  void follow(BlockState& s, double tau) {
    if (s.time_s <= time_s_) {  // another pass
      turned_.setZero();
      lagged_f_ = s.f_b;
      lagged_c_ = s.temperature_c;
    } else if (tau > 0.0) {
      const double part = -std::expm1((time_s_ - s.time_s) / tau);
      lagged_f_ += part * (s.f_b - lagged_f_);
      lagged_c_ += part * (s.temperature_c - lagged_c_);
    }
    time_s_ = s.time_s;
    s.turned_rad = turned_ + 0.5 * s.duration_s * s.w_b;
    turned_ += s.duration_s * s.w_b;
    s.lagged_f_b = lagged_f_;
    s.lagged_temperature_c = lagged_c_;
  }

 private:
  double time_s_ = 1e300;
  Vector3d lagged_f_ = Vector3d::Zero(), turned_ = Vector3d::Zero();
  double lagged_c_ = 0.0;
};

}  // namespace

std::string_view to_string(Sensor sensor) {
  return std::array<std::string_view, 3>{"gyro", "accelerometer", "earth rate"}[std::size_t(sensor)];
}
std::string_view to_string(Quantity quantity) {
  return std::array<std::string_view, 3>{"bias", "scale factor", "direction"}[std::size_t(quantity)];
}
std::string_view to_string(Driver driver) {
  static constexpr std::string_view names[] = {"time", "temperature", "turns", "angle", "force", "rate", "field", ""};
  return names[std::size_t(driver)];
}

const EffectEntry* find_effect(std::string_view name) {
  for (const EffectEntry& entry : effect_catalogue())
    if (entry.name == name) return &entry;
  return nullptr;
}

double absurd_magnitude(const EffectEntry& entry, double duration_s) {
  if (entry.unit == "mm") return 1000.0;
  if (entry.unit == "ms" || entry.unit == "%") return 100.0;
  const double largest = entry.unit.starts_with("deg") || entry.unit.starts_with("arcsec") ? 1e4 : 1e5;
  return entry.name.ends_with("_drift") && duration_s > 0.0 ? largest * std::max(1.0, 3600.0 / duration_s) : largest;
}

std::span<const std::string_view> unobservable_quantities() {
  static constexpr std::array<std::string_view, 4> names = {
      "error of the local gravity entered for the site (it is the common accelerometer scale factor), and of the "
      "sample period as far as the earth's rate does not show it",
      "arm from the table's centre to the unit's centre", "sag of the whole fixture",
      "error of the table's angles (they are not used as truth beyond the first heading)"};
  return names;
}

std::string EffectColumn::key() const {
  return std::string(entry->name) + "." + std::string(entry->components[component]) +
         (recording > 0 ? "_recording_" + std::to_string(recording + 1) : "");
}

std::vector<EffectColumn> catalogue_columns(const RecordingInfo& info, int recordings) {
  std::vector<EffectColumn> columns;
  for (const EffectEntry& entry : effect_catalogue()) {
    if (entry.needs_temperature && !info.has_temperature) continue;
    const std::vector<double> taus = entry.taus_s.empty() ? std::vector<double>{0.0} : entry.taus_s;
    for (int of = 0; of < (entry.of_one_run ? recordings : 1); ++of)
      for (const double tau : taus)
        for (int k = 0; k < int(entry.components.size()); ++k)
          columns.push_back({&entry, k, tau, entry.of_one_run ? of : -1});
  }
  return columns;
}

EffectModel make_effect_model(const std::vector<EffectColumn>& columns, const Site& site,
                              double reference_temperature_c) {
  // Consecutive columns of one entry, tau and recording are evaluated together; each column picks its component.
  struct Part {
    const EffectEntry* entry;
    double tau_s;
    int recording;
    std::vector<std::pair<int, int>> pick = {};  // component, column
    History history = {};
  };
  std::vector<Part> parts;
  for (int k = 0; k < int(columns.size()); ++k) {
    const EffectColumn& column = columns[k];
    if (parts.empty() || parts.back().entry != column.entry || parts.back().tau_s != column.tau_s ||
        parts.back().recording != column.recording)
      parts.push_back({.entry = column.entry, .tau_s = column.tau_s, .recording = column.recording});
    parts.back().pick.emplace_back(column.component, k);
  }
  EffectModel model;
  model.columns = int(columns.size());
  model.values = Eigen::VectorXd::Zero(model.columns);
  model.reference_temperature_c = reference_temperature_c;
  Eigen::Matrix3Xd gyro = Eigen::Matrix3Xd::Zero(3, most_components);
  Eigen::Matrix3Xd accel = Eigen::Matrix3Xd::Zero(3, most_components);
  model.regressors = [parts, site, gyro, accel](const BlockState& at, EffectRegressors& out) mutable {
    BlockState s = at;
    for (Part& part : parts) {
      part.history.follow(s, part.tau_s);
      const int count = int(part.entry->components.size());
      gyro.leftCols(count).setZero();
      accel.leftCols(count).setZero();
      if (part.recording < 0 || part.recording == s.recording)
        part.entry->write(s, site, part.tau_s, gyro.leftCols(count), accel.leftCols(count));
      for (const auto& [component, column] : part.pick) {
        out.gyro.col(column) = gyro.col(component) * part.entry->si;
        out.accel.col(column) = accel.col(component) * part.entry->si;
      }
    }
  };
  return model;
}

}  // namespace turncal
