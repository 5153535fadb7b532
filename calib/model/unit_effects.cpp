#include "calib/model/effect_entry.h"

namespace turncal {
namespace {

using namespace effect_entry;

const std::vector<double> relaxation_taus_s = {2.0, 5.0, 12.0};

}  // namespace

std::vector<EffectEntry> unit_effects() {
  return {
      {.name = "earth_rate",
       .term = "error of the earth rate used (latitude)",
       .formula = "C_bn dw_ie",
       .unit = "deg/h",
       .components = {"north", "up"},
       .si = radps_per_degph,
       .seen_by = "lies inside gyro_magnetic; a known latitude",
       .write = [](const BlockState& s, const Site&, double, Out g, Out) { g = s.C_nb.transpose().leftCols<2>(); }},
      {.name = "sample_period",
       .term = "error of the sample period used",
       .formula = "1e-6 c C_bn w_ie",
       .unit = "ppm",
       .components = {"period"},
       .si = 1e-6,
       .seen_by = "lies inside earth_rate; a unit whose clock was measured",
       .write = [](const BlockState& s, const Site& site, double, Out g,
                   Out) { g.col(0) = s.C_nb.transpose() * earth_rate_n(site.latitude_deg); }},
      {.name = "post_rotation_relaxation",
       .term = "relaxation of the accelerometer after a rotation",
       .formula = "c exp(-t/tau) f_i",
       .unit = "ug/g",
       .components = xyz,
       .si = micro_g,
       .taus_s = relaxation_taus_s,
       .seen_by = "first seconds of a dwell",
       .write =
           [](const BlockState& s, const Site&, double tau, Out, Out a) {
             if (s.since_rotation_s < 1e6) diagonal(a, in_g(s) * std::exp(-s.since_rotation_s / tau));
           }},
  };
}

}  // namespace turncal
