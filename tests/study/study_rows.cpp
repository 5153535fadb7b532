// The faults by which the diagnosis was once caught out (docs/diagnosis.md), each drawn anew: axis, sign, size, time constant, unit.
//
//   study_rows SEED_FIRST SEED_COUNT [ROW]
// One line a run: seed row size verdict trusted names(aliases) worst_parameter_sigmas parameter settled_sigmas parameter. `size` in ppm, ug
// or 0.01 deg/h. The truth of a parameter is what it is over the whole recording; settled: without what was laid on (a creep: in the end).
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>

#include "calib/evidence/diagnosis.h"
#include "tests/rig_recorder.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

using Random = std::mt19937_64;

double uniform(Random& r, double low, double high) { return std::uniform_real_distribution<double>(low, high)(r); }

struct Row {
  const char* name;
  double smallest, largest;  // of the size
  // What one unit of size reads more on one axis; tau: 100 to 1000 s.
  Disturbance (*draw)(int axis, double size, double tau_s, Random& r);
};

double creep_tau_s(Random& r) { return std::exp(uniform(r, std::log(60.0), std::log(900.0))); }

const Row rows[] = {
    {"none", 0.0, 0.0, nullptr},
    {"second_order_and_turn_on", 10.0, 25.0, nullptr},  // in the rig: the holdout has other biases
    {"drift_into_the_holdout", 8.0, 20.0,
     [](int axis, double size, double, Random&) {
       return on_accel(axis, [=](const DisturbedMoment& m) { return ug * size * m.time_s / 3600.0; });
     }},
    {"gyro_scale_warm_up", 15.0, 30.0,
     [](int axis, double size, double tau_s, Random&) {
       return on_gyro(axis, [=](const DisturbedMoment& m) {
         return 1e-6 * size * m.rate_radps[axis] * std::exp(-m.time_s / (2.0 * tau_s));
       });
     }},
    {"accel_scale_warm_up", 15.0, 30.0,
     [](int axis, double size, double tau_s, Random&) {
       return on_accel(axis, [=](const DisturbedMoment& m) {
         return ug * size * m.force_g[axis] * std::exp(-m.time_s / (2.0 * tau_s));
       });
     }},
    {"scatter", 4.0, 8.0,
     [](int axis, double size, double, Random& r) { return scattered_scale(axis, 1e-6 * size, r()); }},
    {"creep", 5.0, 30.0,
     [](int axis, double size, double, Random& r) { return accel_creep(axis, size, creep_tau_s(r)); }},
    {"gyro_creep", 5.0, 30.0,
     [](int axis, double size, double, Random& r) {
       return on_gyro(axis, Creep(&DisturbedMoment::rate_radps, axis, 1e-6 * size, creep_tau_s(r)));
     }},
    {"lock_in", 2.0, 4.0,  // per cent
     [](int axis, double size, double, Random&) {
       return on_gyro(axis, [=](const DisturbedMoment& m) { return locked_in(m.rate_radps[axis], -0.01 * size, 3.0); });
     }},
    {"accel_with_pitch", 5.0, 25.0,
     [](int axis, double size, double, Random& r) {
       return on_accel(axis,
                       [=, phase = uniform(r, 0.0, 2.0 * pi), order = 2.0 + double(r() % 3)](const DisturbedMoment& m) {
                         return ug * size * std::sin(order * m.table_rad[1] + phase);
                       });
     }},
    {"odd_quadratic", 40.0, 80.0,
     [](int axis, double size, double, Random&) {
       return on_accel(
           axis, [=](const DisturbedMoment& m) { return ug * size * m.force_g[axis] * std::abs(m.force_g[axis]); });
     }},
};

void run(std::uint64_t seed, const Row& row) {
  Random r(seed * 1000003u + std::uint64_t(&row - rows));
  RigConfig config = default_rig_config();
  config.seed = 50000 + seed;
  config.noise_seed = 900000 + seed;
  config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
  const int axis = int(r() % 3);
  const double size = uniform(r, row.smallest, row.largest) * (r() % 2 == 0 ? 1.0 : -1.0);
  const double tau_s = std::exp(uniform(r, std::log(90.0), std::log(600.0)));
  const bool in_rig = std::strcmp(row.name, "second_order_and_turn_on") == 0;
  if (in_rig) *find_effect(config.effects, std::string("accel_second_order.") + "xyz"[axis]) = size;
  RigRecording made = record_on_rig(must_read_sequence("fourteen_step.seq"), config);
  RigConfig again = config;
  again.noise_seed = 1200000 + seed;
  const ParameterVector truth = to_vector(made.truth);
  for (int k = 0; in_rig && k < 6; ++k)
    again.truth[std::size_t(k)] = truth[k] + uniform(r, -1.0, 1.0) * (k < 3 ? 0.03 : 30e-6);
  RigRecording held = record_on_rig(must_read_sequence("holdout.seq"), again);
  ParameterVector settled = truth;
  if (row.draw != nullptr) {
    const Disturbance whole = row.draw(axis, size, tau_s, r);
    const Disturbance rest = without_parameters(whole, made.recording, made.truth);
    const auto laid_on = [&whole](std::size_t, const DisturbedMoment& m) { return whole(m); };
    settled -= as_parameters(taken_up(laid_on, made.recording, made.truth), made.truth);
    disturb(made.recording, made.truth, rest);
    disturb(held.recording, made.truth, rest);
  }
  DiagnosisOptions options;
  options.holdouts = {&held.recording};
  const Diagnosis d = diagnose(made.recording, options);
  std::string names;
  for (const std::string& name : d.effect_names) {
    std::string others;
    if (const auto found = d.aliases.find(name); found != d.aliases.end())
      for (const std::string& other : found->second) others += (others.empty() ? "" : ",") + other;
    names += (names.empty() ? "" : "+") + name + (others.empty() ? "" : "(" + others + ")");
  }
  Eigen::Index at = 0;
  // The rig's truth is that of the named effect; what is laid on has been freed of what the parameters take up.
  const auto beyond = [&d](const ParameterVector& right) {
    ParameterVector error = to_vector(d.extended.parameters) - right;
    for (int k = 0; k < parameter_count; ++k)
      error[k] = d.extended.sigma[k] > 0.0 ? error[k] / d.extended.sigma[k] : 0.0;
    return error;
  };
  Eigen::Index at_settled = 0;
  const double worst =
      (in_rig ? beyond(truth) : errors_in_sigmas(d.extended, made.recording, made.truth)).cwiseAbs().maxCoeff(&at);
  const double worst_settled = beyond(settled).cwiseAbs().maxCoeff(&at_settled);
  std::printf("%llu %s.%c %.1f %s %d %s %.2f %s %.2f %s\n", static_cast<unsigned long long>(seed), row.name,
              "xyz"[axis], size, to_string(d.verdict), d.trusted, names.empty() ? "-" : names.c_str(), worst,
              std::string(parameter_keys[std::size_t(at)]).c_str(), worst_settled,
              std::string(parameter_keys[std::size_t(at_settled)]).c_str());
  std::fflush(stdout);
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: study_rows SEED_FIRST SEED_COUNT [ROW]\n");
    return 1;
  }
  const std::uint64_t first = std::strtoull(argv[1], nullptr, 10), count = std::strtoull(argv[2], nullptr, 10);
  for (const turncal::Row& row : turncal::rows)
    for (std::uint64_t seed = first; seed < first + count; ++seed)
      if (argc < 4 || std::strcmp(argv[3], row.name) == 0) turncal::run(seed, row);
  return 0;
}
