// Monte Carlo of the joint estimate (docs/accuracy.md): seeded rig runs, each with a unit of its own.
//
//   study_joint SEED_FIRST SEED_COUNT [--instability G A] [--table ARCMIN] [--sequence NAME] [--walks ARW VRW] [--real]
//               [--no-instability-fit] [--given] [--correlation S] [--gyro-pulse ARCSEC]
// --walks: of the rig (deg/sqrt(h), ug/sqrt(Hz)); --real: increments are real numbers, not pulses; --instability: bias
// instability of the gyros (deg/h) and accelerometers (ug); --table: sigma of its random errors
// (arcmin); --given: the estimator is given the rig's random walks instead of measuring them; --correlation: time of the process that
// stands for flicker (s).
// One line a run: seed NEES level ARW VRW sigma_bg sigma_ba iterations faults (estimate - truth) / sigma of the 21 free
// parameters. The estimate starts from those of Wang (2020), 8 % off in scale. scripts/study-joint makes the table.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "calib/joint/joint_estimate.h"
#include "calib/joint/noise_fit.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

void run(std::uint64_t seed, RigConfig config, const Sequence& sequence, JointOptions options, bool given,
         double correlation_s) {
  config.seed = 100 + seed;
  config.noise_seed = 900000 + seed;
  if (given) {
    NoiseModel noise;
    noise.angle_random_walk.setConstant(config.noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh);
    noise.velocity_random_walk.setConstant(config.noise.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz);
    noise.accel_pulse_mps = config.accel_pulse_mps;
    options.noise = noise;
  }
  const RigRecording made = record_on_rig(sequence, config);
  if (correlation_s > 0.0) {
    const Parameters start = options.start.value_or(start_parameters(made.recording.info));
    options.start_noise = start_noise(made.recording, allan_deviation(made.recording, start), start);
    options.start_noise->bias_correlation_s = correlation_s;
  }
  const JointResult r = joint_estimate(made.recording, options);
  const Eigen::VectorXd error = (to_vector(r.parameters) - to_vector(made.truth))(r.free);
  std::printf("%llu %.3f %.4f %.6f %.4f %.6f %.4f %d %zu", static_cast<unsigned long long>(seed), nees(r, made.truth),
              r.whiteness.level, r.noise.angle_random_walk.mean() / radprs_per_degprh,
              r.noise.velocity_random_walk.mean() / mpsprs_per_ugprHz,
              r.noise.gyro_bias_instability_radps / radps_per_degph,
              r.noise.accel_bias_instability_mps2 / mpsprs_per_ugprHz, r.iterations, r.faults.size());
  for (const double in_sigmas : error.cwiseQuotient(r.covariance.diagonal().cwiseSqrt()))
    std::printf(" %.3f", in_sigmas);
  std::printf("%s\n", r.converged ? "" : " NOT CONVERGED");
  std::fflush(stdout);
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc < 3) {
    std::fprintf(stderr,
                 "usage: study_joint SEED_FIRST SEED_COUNT [--instability G A] [--table ARCMIN] [--sequence NAME] "
                 "[--walks ARW VRW] [--real] [--no-instability-fit] [--given] [--correlation S]\n");
    return 1;
  }
  RigConfig config = default_rig_config();
  JointOptions options;
  bool given = false;
  double correlation_s = 0.0;
  std::string sequence = "fourteen_step.seq";
  for (int k = 3; k < argc; ++k) {
    if (std::strcmp(argv[k], "--instability") == 0 && k + 2 < argc) {
      config.noise.gyro_bias_instability_degph = std::strtod(argv[++k], nullptr);
      config.noise.accel_bias_instability_ug = std::strtod(argv[++k], nullptr);
    } else if (std::strcmp(argv[k], "--walks") == 0 && k + 2 < argc) {
      config.noise.gyro_random_walk_deg_per_rt_h = std::strtod(argv[++k], nullptr);
      config.noise.accel_random_walk_ug_per_rt_hz = std::strtod(argv[++k], nullptr);
    } else if (std::strcmp(argv[k], "--real") == 0) {
      config.quantisation = RigQuantisation::off;
    } else if (std::strcmp(argv[k], "--gyro-pulse") == 0 && k + 1 < argc) {
      config.gyro_pulse_arcsec = std::strtod(argv[++k], nullptr);
    } else if (std::strcmp(argv[k], "--table") == 0 && k + 1 < argc) {
      config.table_errors.random_arcmin = std::strtod(argv[++k], nullptr);
    } else if (std::strcmp(argv[k], "--sequence") == 0 && k + 1 < argc) {
      sequence = argv[++k];
    } else if (std::strcmp(argv[k], "--no-instability-fit") == 0) {
      options.fit_bias_instability = false;
    } else if (std::strcmp(argv[k], "--correlation") == 0 && k + 1 < argc) {
      correlation_s = std::strtod(argv[++k], nullptr);
    } else if (std::strcmp(argv[k], "--given") == 0) {
      given = true;
    } else {
      std::fprintf(stderr, "study_joint: '%s' is not understood\n", argv[k]);
      return 1;
    }
  }
  const Sequence plan = must_read_sequence(sequence);
  const std::uint64_t first = std::strtoull(argv[1], nullptr, 10);
  const std::uint64_t count = std::strtoull(argv[2], nullptr, 10);
  for (std::uint64_t seed = first; seed < first + count; ++seed) run(seed, config, plan, options, given, correlation_s);
}
