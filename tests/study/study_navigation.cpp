// Whether free navigation drifts as predicted (docs/verification.md): each run calibrates a unit of its own on the rig, records it anew at
// rest, and navigates that with the calibration.
//
//   study_navigation SEED_FIRST SEED_COUNT [--free SECONDS]
// First line: the prediction, before any data: sigma of north and east (m), rms NM/h. Then a line a run: seed, north and east error at
// the end (m), its square in the metric of the predicted covariance, radial error rate (NM/h), heading error of the alignment (deg).
// scripts/study-navigation makes the table.
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "calib/joint/joint_estimate.h"
#include "calib/prediction/predict.h"
#include "orchestrator/jobs/preflight.h"
#include "sequences/plan.h"
#include "tests/rig_recorder.h"

namespace turncal {
namespace {

constexpr double align_s = 300.0;

RigConfig rig_config(std::uint64_t seed, std::uint64_t noise_seed) {
  RigConfig config;
  config.seed = 500 + seed;
  config.noise_seed = noise_seed;
  return config;
}

// A recording at rest in intervals of motion, with the parameters of the calibration.
struct Rest {
  std::vector<MotionInterval> intervals;
  double heading_deg = 0.0;  // the true one
};
Rest record_rest(const RigConfig& config, const Parameters& parameters, double seconds) {
  Rig rig(config);
  const RecordingInfo info = rig_recording_info(rig);
  const SensorModel model = sensor_model(parameters, info);
  IncrementIntegrator integrator(info.sample_period_s, 20);
  std::vector<ImuSample> chunk(2000);
  for (long left = std::lround(seconds / info.sample_period_s); left > 0; left -= 2000) {
    rig.advance(chunk);
    for (const ImuSample& s : chunk)
      integrator.add(s.counter,
                     model.gyro_scale * Eigen::Vector3d(s.gyro[0], s.gyro[1], s.gyro[2]) -
                         info.sample_period_s * model.gyro_bias_radps,
                     model.accel_scale * Eigen::Vector3d(s.accel[0], s.accel[1], s.accel[2]) -
                         info.sample_period_s * model.accel_bias_mps2,
                     true);
  }
  const std::array<double, 9> C = rig.attitude_nb();
  return {integrator.intervals(), std::atan2(C[6], C[0]) / rad_per_deg};
}

ExpectedDrift predict_it(const Sequence& sequence, double free_s) {
  Rig rig(rig_config(1, 1));
  const RecordingInfo info = rig_recording_info(rig);
  PredictOptions options;
  options.noise.angle_random_walk.setConstant(rig.config().noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh);
  options.noise.velocity_random_walk.setConstant(rig.config().noise.accel_random_walk_ug_per_rt_hz * mpsprs_per_ugprHz);
  const PlanLimits limits{.settle_s = 0.5, .sample_period_s = info.sample_period_s};
  const Prediction prediction = predict(info, planned_motion(sequence, make_plan(sequence, limits)), options);
  return predicted_drift(info, prediction, options, {.align_s = align_s, .free_s = free_s});
}

void run(std::uint64_t seed, const Sequence& sequence, double free_s, const Eigen::Matrix2d& predicted) {
  const RigRecording made = record_on_rig(sequence, rig_config(seed, 700000 + seed));
  const JointResult estimate = joint_estimate(made.recording);
  const Rest rest = record_rest(rig_config(seed, 800000 + seed), estimate.parameters, align_s + free_s);
  FreeNavigationSetup setup;
  setup.site = {made.recording.info.latitude_deg * rad_per_deg, made.recording.info.gravity_mps2};
  setup.noise = estimate.noise;
  setup.align_s = align_s;
  setup.expected = false;
  const FreeNavigation navigation = must(navigate_freely(rest.intervals, setup));
  const Eigen::Vector2d end = navigation.track.back().moved_m;
  const double heading = angles_of(navigation.aligned.q_nb).heading_rad / rad_per_deg - rest.heading_deg;
  std::printf("%llu %.1f %.1f %.4f %.4f %.5f\n", static_cast<unsigned long long>(seed), end[0], end[1],
              end.dot(predicted.inverse() * end), navigation.nm_per_h, std::remainder(heading, 360.0));
  std::fflush(stdout);
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  const bool with_time = argc == 5 && std::strcmp(argv[3], "--free") == 0;
  if (argc != 3 && !with_time) {
    std::fprintf(stderr, "usage: study_navigation SEED_FIRST SEED_COUNT [--free SECONDS]\n");
    return 1;
  }
  const double free_s = with_time ? std::strtod(argv[4], nullptr) : 3600.0;
  const Sequence sequence = must_read_sequence("fourteen_step.seq");
  const ExpectedDrift drift = predict_it(sequence, free_s);
  const Eigen::Matrix2d predicted = drift.points.back().covariance_m2;
  std::printf("predicted %.1f %.1f %.4f %.5f %.0f\n", std::sqrt(predicted(0, 0)), std::sqrt(predicted(1, 1)),
              expected_nm_per_h(predicted, free_s), drift.align_sigma_rad[1] / rad_per_deg, free_s);
  const auto first = std::uint64_t(std::strtoll(argv[1], nullptr, 10));
  for (std::uint64_t k = 0; k < std::uint64_t(std::strtoll(argv[2], nullptr, 10)); ++k)
    run(first + k, sequence, free_s, predicted);
  return 0;
}
