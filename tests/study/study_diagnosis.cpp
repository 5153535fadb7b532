// The acceptance study of the diagnosis (docs/diagnosis-study.md): seeded rig recordings, the estimator is never told.
//
//   study_diagnosis CASE SEED_FIRST SEED_COUNT [--times M] [--stages] [--sequence NAME]
// CASE: none | none_drift | table_only | noise3_given | noise3 | EFFECT.COMPONENT | two | outside_NAME
// One line a run: case seed verdict names named_right class_right detectable truth value sigma error_before error_after
// holdout_before holdout_after worst_parameter_sigmas. scripts/study runs the whole table and counts.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "calib/evidence/diagnosis.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

RigConfig unit(std::uint64_t seed) {
  RigConfig config = default_rig_config();
  config.seed = 1000 + seed / 4;  // four recordings a unit
  config.noise_seed = 7000 + seed;
  return config;
}

void set_effect(RigConfig& config, const std::string& key, double value) {
  double* place = find_effect(config.effects, key);
  if (!place) {
    std::fprintf(stderr, "no effect %s\n", key.c_str());
    std::exit(1);
  }
  *place = value;
}

// The smallest magnitude that a clean recording of this unit would catch (5 sigma), per component.
double detectable_of(const Diagnosis& clean, const std::string& key) {
  for (const CandidateScore& c : clean.candidates)
    if (c.column.key() == key) return c.visible ? c.detectable : 0.0;
  return 0.0;
}

std::string join(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& n : names) text += (text.empty() ? "" : "+") + n;
  return text.empty() ? "-" : text;
}

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

bool in_class(const Diagnosis& d, const std::string& name) {
  if (contains(d.effect_names, name)) return true;
  for (const auto& [effect, aliases] : d.aliases)
    if (contains(d.effect_names, effect) && contains(aliases, name)) return true;
  return false;
}

struct Case {
  std::string name;
  double times = 2.0;   // effect magnitude in units of what the recording says it can detect
  bool stages = false;  // also how the selection went, on stderr
};

void print_stages(const Diagnosis& d) {
  for (const Statement& n : d.statements.nodes)
    std::fprintf(stderr, "  %.3f %s %s %s %s\n", n.probability, n.sensor.c_str(), n.quantity.c_str(), n.driver.c_str(),
                 n.formula.c_str());
  for (const std::string& name : d.gated_out)
    std::fprintf(stderr, "  not confirmed on held-out data: %s\n", name.c_str());
  for (const OmnibusTest& t : d.omnibus.tests)
    std::fprintf(stderr, "  fit %-20s %8.1f of %6.1f  log10 p %7.2f  %s\n", t.family.c_str(), t.chi_square, t.degrees,
                 t.log10_p, t.what.c_str());
  for (const Fault& f : d.extended.faults)
    std::fprintf(stderr, "  fault %lld-%lld: %s, %s\n", static_cast<long long>(f.first_sample),
                 static_cast<long long>(f.last_sample), f.what.c_str(), f.action.c_str());
  const NoiseModel& n = d.base.noise;
  std::fprintf(stderr,
               "  base noise: %.5f deg/sqrt(h), %.3f ug/sqrt(Hz), bias instability %.5f deg/h, %.3f ug; %s, %s\n",
               n.angle_random_walk[0] / radprs_per_degprh, n.velocity_random_walk[0] / mpsprs_per_ugprHz,
               n.gyro_bias_instability_radps / radps_per_degph, n.accel_bias_instability_mps2 / mpsprs_per_ugprHz,
               d.base.message.c_str(), d.extended.whiteness.message.c_str());
}

void run_case(const Case& what, std::uint64_t seed, const Sequence& sequence, const Sequence& holdout_sequence) {
  RigConfig config = unit(seed);
  DiagnosisOptions options;
  std::vector<std::pair<std::string, double>> truth;
  double detectable = 0.0;
  const auto add = [&](const std::string& key) {
    RigConfig clean = config;
    clean.effects = RigEffects{};
    const RigRecording reference = record_on_rig(sequence, clean);
    // Biases are compared at the temperature the estimator refers them to.
    config.temperature.reference_c = reference.recording.mean_temperature_c;
    DiagnosisOptions scores_only;
    scores_only.max_components = 0;
    detectable = detectable_of(diagnose(reference.recording, scores_only), key);
    const double value = what.times * detectable * (seed % 2 == 0 ? 1.0 : -1.0);
    set_effect(config, key, value);
    truth.emplace_back(key, value);
  };
  if (what.name == "none_drift") {
    config.noise.gyro_bias_instability_degph = 0.003;
    config.noise.accel_bias_instability_ug = 2.0;
  } else if (what.name == "table_only") {
    config.table_errors.random_arcmin = 10.0;
    config.table_errors.creep_arcsec = {3.0, 3.0, 3.0};
  } else if (what.name == "noise3" || what.name == "noise3_given") {
    config.noise.gyro_random_walk_deg_per_rt_h *= 3.0;
    config.noise.accel_random_walk_ug_per_rt_hz *= 3.0;
    if (what.name == "noise3_given") {
      NoiseModel given;
      given.angle_random_walk.setConstant(0.002 * radprs_per_degprh);
      given.velocity_random_walk.setConstant(8.0 * mpsprs_per_ugprHz);
      given.accel_pulse_mps = config.accel_pulse_mps;
      options.estimate.noise = given;
    }
  } else if (what.name == "two") {
    static const char* const pairs[][2] = {{"accel_second_order.y", "accel_bias_temperature.z"},
                                           {"accel_delay.tau", "gyro_scale_asymmetry.x"},
                                           {"accel_size_effect.x_ry", "gyro_g_sensitivity.xy"},
                                           {"gyro_bias_temperature.x", "accel_second_order.z"},
                                           {"accel_cross_coupling.y_xz", "accel_bias_drift.y"}};
    const auto& pair = pairs[seed % 5];
    add(pair[0]);
    add(pair[1]);
  } else if (what.name == "outside_gyro_step") {
    config.outside.gyro_bias_step = {static_cast<int>(seed % 3), 2000.0 + 300.0 * static_cast<double>(seed % 7), 0.05};
  } else if (what.name == "outside_accel_step") {
    config.outside.accel_bias_step = {static_cast<int>(seed % 3), 2000.0 + 300.0 * static_cast<double>(seed % 7), 8.0};
  } else if (what.name == "outside_gyro_angle") {
    config.outside.gyro_angle_periodic.axis = static_cast<int>(seed % 3);
    config.outside.gyro_angle_periodic.table_axis = seed % 2 == 0 ? Axis::roll : Axis::pitch;
    config.outside.gyro_angle_periodic.size_degph = 0.1;
    config.outside.gyro_angle_periodic.order = 1;
  } else if (what.name == "outside_accel_periodic") {
    config.outside.accel_time_periodic.axis = static_cast<int>(seed % 3);
    config.outside.accel_time_periodic.size_ug = 10.0;
    config.outside.accel_time_periodic.period_s = 1500.0 + 400.0 * static_cast<double>(seed % 5);
  } else if (what.name == "outside_accel_hysteresis") {
    config.outside.accel_hysteresis = {static_cast<int>(seed % 3), 15.0};
  } else if (what.name != "none") {
    add(what.name);
  }
  const RigRecording made = record_on_rig(sequence, config);
  RigConfig second = config;
  second.noise_seed = 500000 + seed;
  const RigRecording held = record_on_rig(holdout_sequence, second);
  options.holdouts = {&held.recording};
  const Diagnosis d = diagnose(made.recording, options);
  if (what.stages) print_stages(d);

  bool named = !truth.empty();
  bool classed = !truth.empty();
  double value = 0.0, sigma = 0.0;
  for (const auto& [key, size] : truth) {
    const std::string name = key.substr(0, key.find('.'));
    named = named && contains(d.effect_names, name);
    classed = classed && in_class(d, name);
    for (const EstimatedEffect& e : d.extended.effects)
      if (e.column.key() == key) {
        value = e.value;
        sigma = e.sigma;
      }
  }
  const ParameterVector error = to_vector(d.extended.parameters) - to_vector(made.truth);
  double worst = 0.0;
  for (int k = 0; k < parameter_count; ++k)
    if (d.extended.sigma[k] > 0.0) worst = std::max(worst, std::abs(error[k]) / d.extended.sigma[k]);
  std::printf("%s %llu %s %s %d %d %.6g %.6g %.6g %.6g %.5f %.5f %.5f %.5f %.2f\n", what.name.c_str(),
              static_cast<unsigned long long>(seed), to_string(d.verdict), join(d.effect_names).c_str(), named, classed,
              detectable, truth.empty() ? 0.0 : truth.back().second, value, sigma, d.error_before, d.error_after,
              d.holdout_before.normalised_rms, d.holdout_after.normalised_rms, worst);
  std::fflush(stdout);
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr,
                 "usage: study_diagnosis CASE SEED_FIRST SEED_COUNT [--times M] [--stages] [--sequence NAME]\n");
    return 1;
  }
  turncal::Case what{argv[1]};
  std::string name = "fourteen_step.seq";
  for (int k = 4; k < argc; ++k) {
    if (std::strcmp(argv[k], "--times") == 0 && k + 1 < argc) what.times = std::strtod(argv[k + 1], nullptr);
    if (std::strcmp(argv[k], "--stages") == 0) what.stages = true;
    if (std::strcmp(argv[k], "--sequence") == 0 && k + 1 < argc) name = argv[k + 1];
  }
  const turncal::Sequence sequence = turncal::must_read_sequence(name);
  const turncal::Sequence holdout = turncal::must_read_sequence("holdout.seq");
  const unsigned long first = std::strtoul(argv[2], nullptr, 10);
  const unsigned long count = std::strtoul(argv[3], nullptr, 10);
  for (unsigned long seed = first; seed < first + count; ++seed) turncal::run_case(what, seed, sequence, holdout);
}
