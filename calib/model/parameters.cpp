#include "calib/model/parameters.h"

namespace turncal {

const std::vector<int>& free_parameters() {
  static const std::vector<int> free = [] {
    std::vector<int> all;
    for (int k = 0; k < parameter_count; ++k)
      if (parameter_is_free[k]) all.push_back(k);
    return all;
  }();
  return free;
}

ParameterVector to_vector(const Parameters& p) {
  ParameterVector v;
  v << p.N0_degph, p.A0_g, p.n.row(0).transpose(), p.n.row(1).transpose(), p.n.row(2).transpose(),
      p.a.row(0).transpose(), p.a.row(1).transpose(), p.a.row(2).transpose();
  return v;
}

Parameters from_vector(const ParameterVector& v) {
  Parameters p;
  p.N0_degph = v.segment<3>(0);
  p.A0_g = v.segment<3>(3);
  for (int row = 0; row < 3; ++row) {
    p.n.row(row) = v.segment<3>(6 + 3 * row).transpose();
    p.a.row(row) = v.segment<3>(15 + 3 * row).transpose();
  }
  return p;
}

Parameters start_parameters(const RecordingInfo& info) {
  Parameters p;
  if (info.gyro_increment == IncrementKind::physical) p.n.setIdentity();
  return p;
}

ParameterVector si_per_unit(const RecordingInfo& info) {
  ParameterVector unit;
  unit.segment<3>(0).setConstant(radps_per_degph);
  unit.segment<3>(3).setConstant(standard_gravity_mps2);
  unit.segment<9>(6).setConstant(info.gyro_increment == IncrementKind::pulses ? rad_per_arcsec : 1.0);
  unit.segment<9>(15).setConstant(info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 1.0);
  return unit;
}

SensorModel sensor_model(const Parameters& p, const RecordingInfo& info) {
  const ParameterVector unit = si_per_unit(info);
  return {p.n * unit[6], p.N0_degph * unit[0], p.a * unit[15], p.A0_g * unit[3]};
}

double nominal_gyro_rad(const RecordingInfo& info) { return si_per_unit(info)[6] * start_parameters(info).n(0, 0); }

}  // namespace turncal
