// The planned recording against the rig, which shares no model code with it and is held to numbers worked by hand itself.
#include "calib/prediction/planned_motion.h"

#include "calib/joint/joint_estimate.h"
#include "calib/statistics/block_motion.h"
#include "orchestrator/jobs/preflight.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"

namespace turncal {
namespace {

RecordingInfo site() {
  RecordingInfo info;
  info.latitude_deg = 29.53;
  info.gravity_mps2 = 9.7914;
  info.accel_pulse_mps = 0.0005;
  return info;
}

PlannedMotionItem dwell(std::int64_t samples, SegmentKind kind = SegmentKind::still) {
  return {.samples = samples, .dwell_kind = kind};
}

PlannedMotionItem turn(Axis axis, double from_deg, double to_deg, std::int64_t samples) {
  return {.kind = PlannedMotionItem::Kind::move,
          .samples = samples,
          .axis = axis,
          .from_deg = from_deg,
          .to_deg = to_deg,
          .rate_degps = 10.0,
          .acceleration_degps2 = 20.0};
}

PlannedMotion plan_of(const Sequence& sequence, double settle_s = 0.5) {
  PlanLimits limits;
  limits.settle_s = settle_s;
  return planned_motion(sequence, make_plan(sequence, limits));
}

// Block for block what an errorless rig delivers, on all axes, out of plane, with triangular moves and fast ones.
TEST(PlannedMotion, IsWhatAnErrorlessRigDelivers) {
  const Result<Sequence> crooked = good(parse_sequence(
      "format = 1\nname = crooked\nrate_degps = 30\nacceleration_degps2 = 60\n"
      "step 1\n  initial H 45 P 35 R -20\n  align 400\n  rotate H +90\n  rotate P -2\n  dwell 250\n  rotate R +200 "
      "rate 50\n"
      "  rotate H -3.3 acceleration 7\n  dwell 250\n  rotate P +180\n  dwell 250\n",
      "crooked.seq"));
  const RigConfig config = noise_free(perfect_rig_config());
  Rig rig(config);
  const RecordingInfo info = rig_recording_info(rig);
  for (const Sequence& sequence : {must_read_sequence("short_demo.seq"), *crooked}) {
    const CompressedRecording made = record_on_rig(sequence, config).recording;
    const CompressedRecording planned = planned_recording(info, plan_of(sequence), start_parameters(info));
    ASSERT_EQ(planned.blocks.size(), made.blocks.size()) << sequence.name;
    EXPECT_EQ(planned.samples, made.samples);
    ASSERT_EQ(planned.segments.size(), made.segments.size());
    for (std::size_t k = 0; k < planned.segments.size(); ++k) {
      EXPECT_EQ(planned.segments[k].kind, made.segments[k].kind) << k;
      EXPECT_EQ(planned.segments[k].end_sample, made.segments[k].end_sample) << k;
      EXPECT_NEAR(planned.segments[k].roll_deg, made.segments[k].roll_deg, 1e-9) << k;
    }
    EXPECT_TRUE(planned.events.empty());
    for (std::size_t k = 0; k < planned.blocks.size(); ++k) {
      const Block& p = planned.blocks[k];
      const Block& m = made.blocks[k];
      ASSERT_EQ(p.samples, m.samples) << sequence.name << " block " << k;
      ASSERT_EQ(p.segment, m.segment);
      EXPECT_EQ(p.whole_second, m.whole_second);
      // Counts: 1e-6 of a gyro pulse is 5e-12 rad; 1e-5 of an accelerometer's is 5e-9 m/s, a tenth of what two-point Gauss
      // may miss of g/2 a t^3 in the sample in which an acceleration of a = 60 deg/s^2 begins.
      ASSERT_LT((p.gyro - m.gyro).norm(), 1e-6) << sequence.name << " block " << k;
      ASSERT_LT((p.accel - m.accel).norm(), 1e-5) << sequence.name << " block " << k;
      ASSERT_LT((p.gyro_time - m.gyro_time).norm(), 1e-6);
      ASSERT_LT((p.accel_time - m.accel_time).norm(), 1e-6);
      ASSERT_LT((p.coning - m.coning).norm(), 1e-3);  // pulses squared, of sums up to 1e7
      // A sum of products: the accelerometer's 1e-5 pulses beside the pulses of the gyros over the block.
      ASSERT_LT((p.sculling - m.sculling).norm(), 1e-3 + 1e-5 * p.gyro.norm());
    }
  }
}

TEST(PlannedMotion, ParametersOfTheUnitAreFoundAgain) {
  const RecordingInfo info = site();
  Parameters unit = start_parameters(info);
  unit.N0_degph = {0.05, -0.08, 0.11};
  unit.A0_g = {0.002, -0.003, 0.004};
  unit.n(0, 1) = 1.3e-3;
  unit.n(2, 0) = -0.7e-3;
  unit.n(1, 1) += 2e-4;
  unit.a(0, 0) = 1.03;
  unit.a(1, 2) = 6e-4;
  const PlannedMotion motion = plan_of(must_read_sequence("short_demo.seq"));
  JointOptions options;
  options.noise = NoiseModel{};
  options.look_for_faults = false;
  const JointResult result = joint_estimate(planned_recording(info, motion, unit), options);
  ASSERT_TRUE(result.converged) << result.message;
  const ParameterVector error = to_vector(result.parameters) - to_vector(unit);
  for (const int k : result.free) EXPECT_LT(std::abs(error[k]), 0.02 * result.sigma[k]) << parameter_keys[k];
}

TEST(PlannedMotion, HardAccelerationIsNoGlitch) {
  PlannedMotion motion;
  motion.items = {dwell(400), turn(Axis::pitch, 0.0, 90.0, 2000), dwell(400)};
  motion.items[1].rate_degps = 400.0;
  motion.items[1].acceleration_degps2 = 4000.0;
  EXPECT_TRUE(planned_recording(site(), motion, start_parameters(site())).events.empty());
}

TEST(PlannedMotion, TemperatureRisesAsTold) {
  PlannedMotion motion;
  motion.items = {dwell(200000)};
  CompressedRecording recording = planned_recording(site(), motion, start_parameters(site()));
  EXPECT_FALSE(recording.info.has_temperature);
  EXPECT_TRUE(std::isnan(recording.mean_temperature_c));
  recording = planned_recording(site(), motion, start_parameters(site()), TemperatureProfile{20.0, 6.0, 400.0});
  EXPECT_TRUE(recording.info.has_temperature);
  // The second that ends at 400 s: 20 + 6 (1 - exp(-399.5/400)).
  EXPECT_NEAR(recording.blocks[399].temperature_c, 20.0 + 6.0 * (1.0 - std::exp(-399.4975 / 400.0)), 1e-4);
}

}  // namespace
}  // namespace turncal
