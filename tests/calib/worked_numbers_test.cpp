// The worked numbers of docs/estimator.md, one for each step: the rig with a single parameter that is wrong,
// navigated with nominal parameters, must show the velocity that was computed by hand there, with its sign. The numbers
// are literals from the document: neither the rig nor the estimator had a part in them.
#include "calib/closed_form/closed_form.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"

namespace turncal {
namespace {

// What one of the fourteen steps measures with nominal parameters when the unit's own `key` is off by `error`. Dwells of the others are short.
StepMeasurement measure(const std::string& key, double error, int step) {
  RigConfig config = noise_free(perfect_rig_config());
  const auto place = std::ranges::find(parameter_keys, key);
  EXPECT_NE(place, parameter_keys.end()) << key;
  const auto index = std::size_t(place - parameter_keys.begin());
  config.truth[index] = to_vector(Parameters{})[index] + error;
  Sequence sequence = fourteen_steps();
  for (Step& other : sequence.steps)
    for (SequenceItem& item : other.items)
      if (other.number != step) item.dwell.samples = std::min<std::int64_t>(item.dwell.samples, 2400);
  const CompressedRecording recording = record_on_rig(sequence, config).recording;
  EXPECT_DOUBLE_EQ(recording.info.gravity_mps2, 9.7914);
  EXPECT_DOUBLE_EQ(recording.info.latitude_deg, 29.53);

  StepMeasurement measured;
  const auto note = [&](const StepMeasurement& m, Parameters&) { measured = m.step == step ? m : measured; };
  must(closed_form_calibrate(recording, Parameters{}, {.max_passes = 1, .correct = note}));
  EXPECT_EQ(measured.step, step);
  return measured;
}

// By hand everything is of first order in the error and the earth stands still while the table turns. The earth turns
// by 0.6 deg in 147 s, which mixes 1 % of an attitude error about one axis into another: hence half a per cent of a
// typical velocity (0.1 m/s), and half a per cent of the number itself.
void expect_velocity(double measured_mps, double by_hand_mps, const char* what) {
  EXPECT_NEAR(measured_mps, by_hand_mps, 0.005 * std::abs(by_hand_mps) + 5e-4) << what;
}

struct Worked {
  int step;
  const char* key;
  double error;   // of the parameter: truth minus used
  double V1_mps;  // east
  double V2_mps;
};

constexpr double n_unit = 0.932920;
constexpr Worked list[] = {{2, "n11", 1e-4 * n_unit, -0.61521, 0.61521},
                           {3, "n33", 1e-4 * n_unit, -0.61521, 0.61521},
                           {4, "n22", 1e-4 * n_unit, -0.61521, 0.61521},
                           {5, "A03", 1e-4, -0.19613, -0.19613},
                           {6, "A01", 1e-4, 0.19613, 0.19613},
                           {7, "A02", 1e-4, 0.09807, -0.09807},
                           {7, "a23", 1e-4, 0.09791, 0.09791},
                           {8, "a12", 1e-4, -0.09791, -0.09791},
                           {9, "a13", 1e-4, -0.09791, -0.09791},
                           {10, "n21", 1e-4 * n_unit, -0.09791, -0.09791},
                           {10, "n31", 1e-4 * n_unit, -0.09791, 0.09791},
                           {11, "n12", 1e-4 * n_unit, 0.09791, 0.09791},
                           {11, "n32", 1e-4 * n_unit, 0.09791, -0.09791},
                           {12, "n23", 1e-4 * n_unit, 0.09791, 0.09791},
                           {12, "n13", 1e-4 * n_unit, -0.09791, 0.09791}};

TEST(WorkedNumbers, TheRigShowsTheVelocityComputedByHand) {
  for (const Worked& w : list) {
    SCOPED_TRACE(testing::Message() << "step " << w.step << ", " << w.key);
    const StepMeasurement m = measure(w.key, w.error, w.step);
    EXPECT_NEAR(m.leg1.dwell_s, 100.0, 1e-9);
    expect_velocity(m.leg1.velocity_mps.z(), w.V1_mps, "V1");
    expect_velocity(m.leg2.velocity_mps.z(), w.V2_mps, "V2");
    // and the formula of the step turns it into the error of the parameter, within 1 % (first order)
    Parameters corrected;
    correct_parameters(m, corrected);
    const ParameterVector change = to_vector(corrected) - to_vector(Parameters{});
    const auto index = std::ranges::find(parameter_keys, w.key) - parameter_keys.begin();
    EXPECT_NEAR(change[index], w.error, 0.01 * std::abs(w.error));
  }
}

// a11 = 1.001, used 1: the x axis reads g / 1.001 both ways. A01 = 1e-3 g: counts hold f + A01, and nothing is taken off.
TEST(WorkedNumbers, ScaleFactorAndBiasOfStep1) {
  const StepMeasurement scale = measure("a11", 1e-3, 1), bias = measure("A01", 1e-3, 1);
  EXPECT_NEAR(scale.up[0].x(), 9.78162, 2e-5);
  EXPECT_NEAR(scale.down[0].x(), -9.78162, 2e-5);
  EXPECT_NEAR(bias.up[0].x(), 9.80121, 2e-5);
  EXPECT_NEAR(bias.down[0].x(), -9.78159, 2e-5);
}

TEST(WorkedNumbers, GyrosOfSteps13And14) {
  expect_velocity(measure("N01", 0.1, 13).leg1.velocity_mps.z(), 0.85446, "north gyro, east");
  EXPECT_NEAR(measure("N02", 0.1, 13).leg1.heading_change_rad / rad_per_deg, -0.016667, 0.005 * 0.016667);
  expect_velocity(measure("N03", 0.1, 13).leg1.velocity_mps.x(), -0.85446, "east gyro, north");
  expect_velocity(measure("N03", 0.1, 14).leg1.velocity_mps.z(), 0.85446, "north gyro, east");
}

}  // namespace
}  // namespace turncal
