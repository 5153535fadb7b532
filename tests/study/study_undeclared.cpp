// Effects drawn at random, that nobody declared (docs/diagnosis-study.md): what does the diagnosis say of them?
//
//   study_undeclared SEED_FIRST SEED_COUNT [--draws N] [--largest M] [--only WORD] [--keep WORD] [--clean] [--tests] [--fit] [--sites] [--real-pulses] [--sequence NAME]
// --sites: every seed is at a latitude of its own, -65 to 65 deg; with --fit --tests a line says what latitude the gyros feel.
// --only: effects are drawn until their description (column 3) holds the word, "gyro_scale" or "scatter".
// --keep: of the effects drawn, those that hold the word are diagnosed: a part of a study, again.
// Every seed is a unit on a table, with noise, temperature history and (three in ten) bias instability and random walk of its own; on
// its recording and holdout N effects are laid one after another. --clean: none is; --fit: the base model is fitted and
// tested, and no effect looked for. An effect is a random smooth function of one of
// time, a table angle, a component of force or rate, or temperature; a product of two; steps in time; a number for every turn or every dwell
// - on a bias or a scale factor of one sensor. Its size is drawn from invisible to gross. What of it a bias or the sensor's row of the
// matrix would take up is taken off first (least squares over the recording), so that the truth of the 24 parameters stands.
// One line a run: seed draw effect size verdict trusted names(aliases) candidates worst_parameter_sigmas parameter log10_p family
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>

#include <Eigen/Core>

#include "calib/evidence/diagnosis.h"
#include "calib/evidence/felt_latitude.h"
#include "calib/evidence/lack_of_fit.h"
#include "calib/model/limits.h"
#include "tests/disturbance.h"
#include "tests/rig_recorder.h"
#include "tests/study/taken_up.h"

namespace turncal {
namespace {

using Eigen::Vector3d;
using Random = std::mt19937_64;

double uniform(Random& r, double low, double high) { return std::uniform_real_distribution<double>(low, high)(r); }
int one_of(Random& r, int n) { return std::uniform_int_distribution<int>(0, n - 1)(r); }
double normal(Random& r) { return std::normal_distribution<double>()(r); }

// Smooth on [-1, 1], or periodic in 2 pi: of order one.
std::function<double(double)> smooth(Random& r, bool periodic) {
  struct Wave {
    double size, frequency, phase;
  };
  std::vector<Wave> waves;
  for (int k = 0, n = 1 + one_of(r, 4); k < n; ++k)
    waves.push_back({normal(r), periodic ? 1.0 + one_of(r, 5) : uniform(r, 0.3, 8.0), uniform(r, 0.0, 2.0 * pi)});
  const double norm = std::sqrt(static_cast<double>(waves.size()));
  return [waves, norm](double x) {
    double sum = 0.0;
    for (const Wave& w : waves) sum += w.size * std::cos(w.frequency * x + w.phase);
    return sum / norm;
  };
}

struct Term {
  std::string what;
  std::function<double(const DisturbedMoment&)> at;
};

Term draw_term(Random& r) {
  const int axis = one_of(r, 3);
  static constexpr const char* table[] = {"heading", "pitch", "roll"};
  static constexpr const char* body[] = {"x", "y", "z"};
  switch (one_of(r, 8)) {
    case 0: {
      const auto f = smooth(r, false);
      return {"time", [f](const DisturbedMoment& m) { return f(2.0 * m.time_s / 6342.0 - 1.0); }};
    }
    case 1: {
      const auto f = smooth(r, true);
      return {std::string("angle_") + table[axis],
              [f, axis](const DisturbedMoment& m) { return f(m.table_rad[axis]); }};
    }
    case 2: {
      const auto f = smooth(r, false);
      return {std::string("force_") + body[axis], [f, axis](const DisturbedMoment& m) { return f(m.force_g[axis]); }};
    }
    case 3: {
      const auto f = smooth(r, false);
      return {std::string("rate_") + body[axis],
              [f, axis](const DisturbedMoment& m) { return f(m.rate_radps[axis] / 0.1745) - f(0.0); }};
    }
    case 4: {
      const auto f = smooth(r, false);
      return {"temperature", [f](const DisturbedMoment& m) { return f((m.temperature_c - 27.0) / 3.0); }};
    }
    case 5: {
      std::vector<std::pair<double, double>> steps;
      for (int k = 0, n = 1 + one_of(r, 3); k < n; ++k) steps.emplace_back(uniform(r, 200.0, 6000.0), normal(r));
      return {"steps", [steps](const DisturbedMoment& m) {
                double sum = 0.0;
                for (const auto& [time, size] : steps) sum += m.time_s > time ? size : 0.0;
                return sum;
              }};
    }
    default: {
      const std::uint64_t seed = r();
      return {"scatter", [seed](const DisturbedMoment& m) {
                Random own(seed + 7919u * static_cast<std::uint64_t>(m.turn));
                own.discard(3);
                return normal(own);
              }};
    }
  }
}

struct Drawn {
  std::string what;
  double size = 0.0;
  int channel = 0;  // 0 gyro bias, 1 gyro scale factor, 2 accelerometer bias, 3 accelerometer scale factor
  int axis = 0;
  Disturbance disturbance;
};

Drawn draw_any(Random& r, double largest) {
  Drawn d;
  Term term = draw_term(r);
  if (one_of(r, 4) == 0) {
    const Term other = draw_term(r);
    term = {term.what + "*" + other.what,
            [a = term.at, b = other.at](const DisturbedMoment& m) { return a(m) * b(m); }};
  }
  d.channel = one_of(r, 4);
  d.axis = one_of(r, 3);
  static constexpr const char* names[] = {"gyro_bias", "gyro_scale", "accel_bias", "accel_scale"};
  static constexpr double units[] = {0.01 * pi / 180.0 / 3600.0, 2e-6, 2e-6 * 9.80665, 2e-6};
  d.what = std::string(names[d.channel]) + "_" + "xyz"[d.axis] + ":" + term.what;
  d.size = std::exp(uniform(r, std::log(0.1), std::log(largest)));
  const double amplitude = d.size * units[d.channel];
  d.disturbance = [at = term.at, amplitude, channel = d.channel, axis = d.axis](const DisturbedMoment& m) {
    AddedReading added;
    const double value = amplitude * at(m);
    if (channel == 0) added.gyro_radps[axis] = value;
    if (channel == 1) added.gyro_radps[axis] = value * m.rate_radps[axis];
    if (channel == 2) added.accel_mps2[axis] = value;
    if (channel == 3) added.accel_mps2[axis] = value * 9.80665 * m.force_g[axis];
    return added;
  };
  return d;
}

Drawn draw(Random& r, double largest, const std::string& only) {
  for (;;)
    if (Drawn d = draw_any(r, largest); d.what.find(only) != std::string::npos) return d;
}

std::string join(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& n : names) text += (text.empty() ? "" : "+") + n;
  return text.empty() ? "-" : text;
}

// Each name with its alias class: "gyro_bias_drift(gyro_bias_temperature)".
std::vector<std::string> classes(const Diagnosis& d) {
  std::vector<std::string> all;
  for (const std::string& name : d.effect_names) {
    std::string others;
    if (const auto found = d.aliases.find(name); found != d.aliases.end())
      for (const std::string& other : found->second) others += (others.empty() ? "" : ",") + other;
    all.push_back(others.empty() ? name : name + "(" + others + ")");
  }
  return all;
}

void report(std::uint64_t seed, int draw, const Drawn& drawn, const Diagnosis& d, const CompressedRecording& recording,
            const Parameters& truth, bool tests) {
  Eigen::Index at = 0;
  const double worst = errors_in_sigmas(d.extended, recording, truth).cwiseAbs().maxCoeff(&at);
  const std::string_view parameter = worst > 0.0 ? parameter_keys[static_cast<std::size_t>(at)] : "-";
  std::string family = d.lack_of_fit.worst.family.empty() ? "-" : d.lack_of_fit.worst.family;
  std::replace(family.begin(), family.end(), ' ', '_');
  std::printf("%llu %d %s %.3g %s %d %s %s %.2f %s %.2f %s\n", static_cast<unsigned long long>(seed), draw,
              drawn.what.c_str(), drawn.size, to_string(d.verdict), d.trusted, join(classes(d)).c_str(),
              join(d.candidate_names).c_str(), worst, std::string(parameter).c_str(), d.lack_of_fit.worst.log10_p,
              family.c_str());
  if (tests) {
    const NoiseModel& noise = d.extended.noise;
    std::printf("reason %llu level %.3f correlation %.3f: %s\n", static_cast<unsigned long long>(seed),
                d.extended.whiteness.level, d.lack_of_fit.innovation_correlation, d.reason.c_str());
    std::printf(
        "noise %llu %.5f %.3f %.5f %.3f\n", static_cast<unsigned long long>(seed),
        noise.angle_random_walk.mean() / radprs_per_degprh, noise.velocity_random_walk.mean() / mpsprs_per_ugprHz,
        noise.gyro_bias_instability_radps / radps_per_degph, noise.accel_bias_instability_mps2 / mpsprs_per_ugprHz);
    for (const NameCheck& c : d.name_checks)
      std::printf("name %llu %d %s %.1f %.1f %s\n", static_cast<unsigned long long>(seed), draw, c.name.c_str(), c.gain,
                  c.family_gain, c.family.c_str());
    for (const SelectionStage& s : d.stages)
      std::printf("stage %llu %d %s %.2f %.1f\n", static_cast<unsigned long long>(seed), draw, s.chosen.key().c_str(),
                  s.z, s.gain);
    for (const LackOfFitTest& t : d.lack_of_fit.tests) {
      std::string name = t.family;
      std::replace(name.begin(), name.end(), ' ', '_');
      std::printf("test %llu %d %s %.2f %.1f %.3f\n", static_cast<unsigned long long>(seed), draw, name.c_str(),
                  t.chi_square, t.degrees, t.log10_p);
    }
  }
  std::fflush(stdout);
}

// What the recording knows of what was laid on it. `sigmas`: what a test would come to that knew its shape and all but its size, the
// parameters estimated beside it; below 4 or so nobody could see it. `shift`: what it does to the parameters of any such fit, in sigmas.
void report_seen(std::uint64_t seed, int draw, const CompressedRecording& clean, const CompressedRecording& disturbed,
                 const JointResult& fit) {
  FilterSetup setup = fit.setup;
  setup.keep_innovations = true;
  const FilterResult without = run_filter(clean, fit.parameters, {}, setup);
  const FilterResult with = run_filter(disturbed, fit.parameters, {}, setup);
  double square = 0.0;
  for (std::size_t k = 0; k < without.innovations.size(); ++k)
    square += (with.innovations[k].normalised - without.innovations[k].normalised).squaredNorm();
  const Eigen::VectorXd change = with.gradient - without.gradient;
  const SubsetSolution solved = solve_subset(without.information, change, fit.free, fit.ranges);
  double largest = 0.0;
  std::string_view parameter = "-";
  for (std::size_t i = 0; i < fit.free.size(); ++i) {
    const double z = solved.step[static_cast<Eigen::Index>(i)] /
                     std::sqrt(solved.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)));
    if (std::abs(z) <= std::abs(largest)) continue;
    largest = z;
    parameter = parameter_keys[static_cast<std::size_t>(fit.free[i])];
  }
  const double left = square + Eigen::VectorXd(change(fit.free)).dot(solved.step);
  std::printf("seen %llu %d sigmas %.2f shift %.2f %s\n", static_cast<unsigned long long>(seed), draw,
              std::sqrt(std::max(left, 0.0)), largest, std::string(parameter).c_str());
}

// A unit that wanders: its biases over the whole recording, by the same unit with the same noise and no walk.
Parameters truth_over(const RigRecording& made, const Sequence& sequence, RigConfig config) {
  Parameters truth = made.truth;
  double& gyro = config.noise.gyro_rate_random_walk_degph_per_rt_h;
  double& accel = config.noise.accel_acceleration_random_walk_ug_per_rt_h;
  if (gyro == 0.0 && accel == 0.0) return truth;
  gyro = accel = 0.0;
  const RigRecording steady = record_on_rig(sequence, config);
  Vector3d turned = Vector3d::Zero(), pushed = Vector3d::Zero();
  double time_s = 0.0;
  for (const Block& b : made.recording.blocks) turned += b.gyro, pushed += b.accel, time_s += b.duration_s;
  for (const Block& b : steady.recording.blocks) turned -= b.gyro, pushed -= b.accel;
  const SensorModel model = sensor_model(made.truth, made.recording.info);
  truth.N0_degph += model.gyro_scale * turned / time_s / radps_per_degph;
  truth.A0_g += model.accel_scale * pushed / time_s / standard_gravity_mps2;
  return truth;
}

void report_latitude(std::uint64_t seed, const FeltLatitude& felt, double truth_deg) {
  const double off_deg = felt.latitude_rad / rad_per_deg - truth_deg, sigma_deg = felt.sigma_rad / rad_per_deg;
  std::printf("latitude %llu %.3f %.5f %.5f %.3f %d\n", static_cast<unsigned long long>(seed), truth_deg, off_deg,
              sigma_deg, off_deg / sigma_deg, felt.speaks_against(truth_deg * rad_per_deg, latitude_limits.least_deg));
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc < 3) {
    std::fprintf(stderr,
                 "usage: study_undeclared SEED_FIRST SEED_COUNT [--draws N] [--largest M] [--only WORD] [--keep WORD] "
                 "[--clean] [--tests] "
                 "[--fit] [--sites] [--real-pulses] [--sequence NAME]\n");
    return 1;
  }
  int draws = 4;
  double largest = 30.0;
  std::string only, keep, name = "fourteen_step.seq";
  bool clean = false, tests = false, fit_only = false, real_pulses = false, sites = false;
  for (int k = 3; k < argc; ++k) {
    if (std::strcmp(argv[k], "--draws") == 0 && k + 1 < argc)
      draws = static_cast<int>(std::strtol(argv[k + 1], nullptr, 10));
    if (std::strcmp(argv[k], "--largest") == 0 && k + 1 < argc) largest = std::strtod(argv[k + 1], nullptr);
    if (std::strcmp(argv[k], "--only") == 0 && k + 1 < argc) only = argv[k + 1];
    if (std::strcmp(argv[k], "--keep") == 0 && k + 1 < argc) keep = argv[k + 1];
    if (std::strcmp(argv[k], "--sequence") == 0 && k + 1 < argc) name = argv[k + 1];
    clean = clean || std::strcmp(argv[k], "--clean") == 0;
    tests = tests || std::strcmp(argv[k], "--tests") == 0;
    real_pulses = real_pulses || std::strcmp(argv[k], "--real-pulses") == 0;
    sites = sites || std::strcmp(argv[k], "--sites") == 0;
    fit_only = fit_only || std::strcmp(argv[k], "--fit") == 0;
  }
  const Sequence sequence = must_read_sequence(name);
  const Sequence second = must_read_sequence("holdout.seq");
  const std::uint64_t first = std::strtoull(argv[1], nullptr, 10), count = std::strtoull(argv[2], nullptr, 10);
  for (std::uint64_t seed = first; seed < first + count; ++seed) {
    Random r(seed * 1000003u + 17u);
    RigConfig config = default_rig_config();
    config.seed = 20000 + seed;
    config.noise_seed = 300000 + seed;
    config.table_errors.random_arcmin = uniform(r, 0.5, 10.0);
    config.noise.gyro_random_walk_deg_per_rt_h *= std::exp(uniform(r, -0.7, 0.7));
    config.noise.accel_random_walk_ug_per_rt_hz *= std::exp(uniform(r, -0.7, 0.7));
    config.temperature.rise_c = uniform(r, -4.0, 10.0);
    config.temperature.tau_s = uniform(r, 900.0, 6000.0);
    config.noise.gyro_bias_instability_degph = config.noise.accel_bias_instability_ug = 0.0;
    if (one_of(r, 10) < 3) {
      config.noise.gyro_bias_instability_degph = uniform(r, 0.0005, 0.003);
      config.noise.accel_bias_instability_ug = uniform(r, 0.3, 2.0);
      config.noise.gyro_rate_random_walk_degph_per_rt_h = uniform(r, 0.0, 0.002);
      config.noise.accel_acceleration_random_walk_ug_per_rt_h = uniform(r, 0.0, 1.0);
    }
    if (tests)
      std::printf("true_noise %llu %.5f %.3f %.5f %.3f %.5f %.3f\n", static_cast<unsigned long long>(seed),
                  config.noise.gyro_random_walk_deg_per_rt_h, config.noise.accel_random_walk_ug_per_rt_hz,
                  config.noise.gyro_bias_instability_degph, config.noise.accel_bias_instability_ug,
                  config.noise.gyro_rate_random_walk_degph_per_rt_h,
                  config.noise.accel_acceleration_random_walk_ug_per_rt_h);
    if (Random of_site(seed + 5u); sites) config.site.latitude_deg = uniform(of_site, -65.0, 65.0);
    if (real_pulses) config.quantisation = RigQuantisation::off;
    std::vector<Drawn> effects(1, Drawn{"none", 0.0, 0, 0, {}});
    if (!clean) {
      effects.clear();
      for (int k = 0; k < draws; ++k) effects.push_back(draw(r, largest, only));
    }
    const auto kept = [&](const Drawn& d) { return d.what.find(keep) != std::string::npos; };
    if (std::none_of(effects.begin(), effects.end(), kept)) continue;
    const RigRecording made = record_on_rig(sequence, config);
    RigConfig again = config;
    again.noise_seed = 600000 + seed;
    const RigRecording held = record_on_rig(second, again);
    const Parameters truth = truth_over(made, sequence, config);
    for (int k = 0; k < static_cast<int>(effects.size()); ++k) {
      const Drawn& drawn = effects[static_cast<std::size_t>(k)];
      if (!kept(drawn)) continue;
      CompressedRecording recording = made.recording, holdout = held.recording;
      if (!clean) {
        const Disturbance rest = without_parameters(drawn.disturbance, made.recording, made.truth);
        disturb(recording, made.truth, rest);
        disturb(holdout, made.truth, rest);
      }
      DiagnosisOptions options;
      options.holdouts = {&holdout};
      if (fit_only) {
        Diagnosis d;
        JointOptions with_rate;
        with_rate.candidates = latitude_columns();
        d.extended = joint_estimate(recording, with_rate);
        const auto felt = tests ? felt_latitude(recording, d.extended) : std::nullopt;
        if (felt) report_latitude(seed, *felt, config.site.latitude_deg);
        d.lack_of_fit = test_lack_of_fit(recording, d.extended, {&holdout}, options.limits.fit);
        d.trusted = d.lack_of_fit.passed;
        d.verdict = d.trusted ? Verdict::clean : Verdict::unexplained;
        report(seed, k, drawn, d, recording, truth, tests);
        continue;
      }
      report(seed, k, drawn, diagnose(recording, options), recording, truth, tests);
      if (tests && !clean) report_seen(seed, k, made.recording, recording, joint_estimate(made.recording));
    }
  }
}
