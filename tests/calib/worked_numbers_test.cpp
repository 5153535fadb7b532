// The worked numbers of docs/estimator.md, one for each step: the rig with a single parameter that is wrong,
// navigated with nominal parameters, must show the velocity that was computed by hand there, with its sign. The numbers
// are literals from the document: neither the rig nor the estimator had a part in them.
#include "calib/closed_form/closed_form.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"
#include "tests/turntable_drivers/rig/perfect_rig.h"

namespace turncal {
namespace {

// What the fourteen steps measure with nominal parameters when the unit's own `key` is off by `error`.
std::vector<StepMeasurement> measure(const std::string& key, double error) {
  RigConfig config = noise_free(perfect_rig_config());
  const auto place = std::ranges::find(parameter_keys, key);
  EXPECT_NE(place, parameter_keys.end()) << key;
  const auto index = std::size_t(place - parameter_keys.begin());
  config.truth[index] = to_vector(Parameters{})[index] + error;
  static const Sequence sequence = must_read_sequence("fourteen_step.seq");
  const CompressedRecording recording = record_on_rig(sequence, config).recording;
  EXPECT_DOUBLE_EQ(recording.info.gravity_mps2, 9.7914);
  EXPECT_DOUBLE_EQ(recording.info.latitude_deg, 29.53);

  std::vector<StepMeasurement> steps(closed_form_steps + 1);
  const auto note = [&](const StepMeasurement& m, Parameters&) { steps[m.step] = m; };
  must(closed_form_calibrate(recording, Parameters{}, {.max_passes = 1, .correct = note}));
  return steps;
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

void PrintTo(const Worked& worked, std::ostream* out) { *out << "step " << worked.step << ", " << worked.key; }

class WorkedNumbers : public ::testing::TestWithParam<Worked> {};

TEST_P(WorkedNumbers, TheRigShowsTheVelocityComputedByHand) {
  const Worked& w = GetParam();
  const StepMeasurement m = measure(w.key, w.error)[w.step];
  ASSERT_EQ(m.step, w.step);
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

constexpr double n_unit = 0.932920;
INSTANTIATE_TEST_SUITE_P(
    Steps, WorkedNumbers,
    ::testing::Values(
        Worked{2, "n11", 1e-4 * n_unit, -0.61521, 0.61521}, Worked{3, "n33", 1e-4 * n_unit, -0.61521, 0.61521},
        Worked{4, "n22", 1e-4 * n_unit, -0.61521, 0.61521}, Worked{5, "A03", 1e-4, -0.19613, -0.19613},
        Worked{6, "A01", 1e-4, 0.19613, 0.19613}, Worked{7, "A02", 1e-4, 0.09807, -0.09807},
        Worked{7, "a23", 1e-4, 0.09791, 0.09791}, Worked{8, "a12", 1e-4, -0.09791, -0.09791},
        Worked{9, "a13", 1e-4, -0.09791, -0.09791}, Worked{10, "n21", 1e-4 * n_unit, -0.09791, -0.09791},
        Worked{10, "n31", 1e-4 * n_unit, -0.09791, 0.09791}, Worked{11, "n12", 1e-4 * n_unit, 0.09791, 0.09791},
        Worked{11, "n32", 1e-4 * n_unit, 0.09791, -0.09791}, Worked{12, "n23", 1e-4 * n_unit, 0.09791, 0.09791},
        Worked{12, "n13", 1e-4 * n_unit, -0.09791, 0.09791}),
    [](const ::testing::TestParamInfo<Worked>& tested) {
      return "Step" + std::to_string(tested.param.step) + "_" + tested.param.key;
    });

TEST(WorkedNumbersStep1, ScaleFactor) {  // a11 = 1.001, used 1: the x axis reads g / 1.001 both ways
  const StepMeasurement m = measure("a11", 1e-3)[1];
  EXPECT_NEAR(m.up[0].x(), 9.78162, 2e-5);
  EXPECT_NEAR(m.down[0].x(), -9.78162, 2e-5);
}

TEST(WorkedNumbersStep1, Bias) {  // A01 = 1e-3 g: counts hold f + A01, and nothing is taken off
  const StepMeasurement m = measure("A01", 1e-3)[1];
  EXPECT_NEAR(m.up[0].x(), 9.80121, 2e-5);
  EXPECT_NEAR(m.down[0].x(), -9.78159, 2e-5);
}

TEST(WorkedNumbersStep13And14, Gyros) {
  expect_velocity(measure("N01", 0.1)[13].leg1.velocity_mps.z(), 0.85446, "north gyro, east");
  EXPECT_NEAR(measure("N02", 0.1)[13].leg1.heading_change_rad / rad_per_deg, -0.016667, 0.005 * 0.016667);
  const std::vector<StepMeasurement> third = measure("N03", 0.1);
  expect_velocity(third[13].leg1.velocity_mps.x(), -0.85446, "east gyro, north");
  expect_velocity(third[14].leg1.velocity_mps.z(), 0.85446, "north gyro, east");
}

// The other side of the coin: with nothing wrong nothing is seen.
TEST(WorkedNumbersStep0, APerfectUnitShowsNothing) {
  const std::vector<StepMeasurement> steps = measure("a21", 0.0);
  for (int step = 2; step <= closed_form_steps; ++step) {
    const StepMeasurement& m = steps[step];
    EXPECT_LT(std::abs(m.leg1.velocity_mps.z()), 1e-7) << step;
    if (step < 13) {
      EXPECT_LT(std::abs(m.leg2.velocity_mps.z()), 1e-7) << step;
    }
  }
}

}  // namespace
}  // namespace turncal
