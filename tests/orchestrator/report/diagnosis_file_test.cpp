// diagnosis.conf and parameters.conf, as they are written of a diagnosis.
#include <gtest/gtest.h>

#include <limits>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/diagnosis_file.h"
#include "orchestrator/report/report.h"
#include "tests/imu_io/temporary_folder.h"
#include "tests/orchestrator/report/sample_diagnosis.h"
#include "tests/outcome.h"

namespace turncal {
namespace {

TEST(DiagnosisFile, HoldsTheContractForAnAddedEffect) {
  Sample sample = extended_sample();
  sample.diagnosis.candidates.resize(4);  // the three of accel_second_order and one of accel_scale_asymmetry
  EXPECT_EQ(format_diagnosis(sample.diagnosis),
            "# turncal diagnosis: which effect the 24 parameters lack, and the error before and after it was added\n"
            "# reason: held-out error 3.2 before, 1.01 after\n"
            "verdict = extended\n"
            "quality.trusted = false\n"
            "effects = accel_second_order\n"
            "missing.probability = 1\n"
            "missing.1.sensor = accelerometer x\n"
            "missing.1.quantity = bias\n"
            "missing.1.driver = force\n"
            "missing.1.formula =\n"
            "missing.1.probability = 0.998\n"
            "missing.2.sensor = accelerometer x\n"
            "missing.2.quantity = bias\n"
            "missing.2.driver = force\n"
            "missing.2.formula = accel_second_order\n"
            "missing.2.probability = 0.725\n"
            "effect.accel_second_order.x = 20.25\n"
            "sigma.effect.accel_second_order.x = 0.75\n"
            "effect.accel_second_order.z = -3.5\n"
            "sigma.effect.accel_second_order.z = 1.25\n"
            "alias.accel_second_order = accel_scale_asymmetry\n"
            "undetectable = accel_size_effect\n"
            "detectable.accel_second_order.x = 2.5\n"
            "detectable.accel_second_order.y = 3\n"
            "detectable.accel_second_order.z = 3.5\n"
            "detectable.accel_scale_asymmetry.x = 2.5\n"
            "error.before = 2.5\n"
            "error.after = 1.002\n"
            "holdout.before = 3.2\n"
            "holdout.after = 1.01\n"
            "holdout.velocity_rms_before_mps = 0.0071\n"
            "holdout.velocity_rms_after_mps = 0.0014\n"
            "holdout.source = second recording\n");
}

TEST(DiagnosisFile, SaysThatAHoldoutIsJudgedByItsOwnNoise) {
  Diagnosis diagnosis = extended_sample().diagnosis;
  diagnosis.holdout_own_noise = 2.5;
  const std::string text = format_diagnosis(diagnosis);
  EXPECT_TRUE(text.ends_with("\nholdout.source = second recording\nholdout.own_noise = 2.5\n")) << text;
}

TEST(DiagnosisFile, KeepsEveryKeyWhenThereIsNothingToSay) {
  Diagnosis empty;
  empty.reason = "first line\nsecond line";  // must not become a line of its own
  empty.error_before = empty.error_after = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(format_diagnosis(empty),
            "# turncal diagnosis: which effect the 24 parameters lack, and the error before and after it was added\n"
            "# reason: first line second line\n"
            "verdict = unexplained\n"
            "quality.trusted = false\n"
            "effects =\n"
            "undetectable =\n"
            "error.before =\n"
            "error.after =\n"
            "holdout.before =\n"
            "holdout.after =\n"
            "holdout.velocity_rms_before_mps =\n"
            "holdout.velocity_rms_after_mps =\n"
            "holdout.source =\n");
}

TEST(DiagnosisFile, IsReadBackKeyByKey) {
  Sample sample = clean_sample();
  sample.diagnosis.error_before = 1.0 / 3.0;  // shortest round trip
  auto file = KeyValueFile::parse(format_diagnosis(sample.diagnosis), "diagnosis.conf");
  ASSERT_OK(file);
  EXPECT_EQ(file->text("verdict"), "clean");
  EXPECT_TRUE(file->list("effects").empty());
  EXPECT_EQ(file->number("error.before"), 1.0 / 3.0);
  EXPECT_EQ(file->list("undetectable"), std::vector<std::string>{"accel_size_effect"});
  EXPECT_FALSE(file->has("detectable.accel_size_effect.x_rx"));
  EXPECT_EQ(file->number("detectable.gyro_accel_flexure.zz"), 5.0 * (0.5 + 0.1 * 8));
  const char* verdicts[] = {"clean", "extended", "unexplained", "noise_model"};
  for (int k = 0; k < 4; ++k) {
    sample.diagnosis.verdict = static_cast<Verdict>(k);
    EXPECT_SAYS(format_diagnosis(sample.diagnosis), std::string("\nverdict = ") + verdicts[k] + "\n");
  }
}

TEST(DiagnosisParameters, HoldEffectsStrongestFirstNoiseAndVerdict) {
  Sample sample = extended_sample();
  sample.recording.info.unit_serial = "SN7";
  Diagnosis& d = sample.diagnosis;
  d.extended.effects.insert(d.extended.effects.begin(), estimated("gyro_warm_up", 1, 0.02, 0.01, 240.0));
  d.extended.sigma[5] = 0.0;  // A03 not determined
  const ParameterFile file = diagnosis_parameters(d, sample_context(sample));
  const auto text = format_parameter_file(file);
  ASSERT_OK(text);
  const auto read = parse_parameter_file(*text, "parameters.conf");
  ASSERT_OK(read);
  EXPECT_EQ(read->model, "extended");
  EXPECT_EQ(read->method, "joint");
  EXPECT_EQ(read->recording_hash, "00112233445566778899aabbccddeeff");
  EXPECT_EQ(read->unit_serial, "SN7");
  EXPECT_EQ(read->reference_temperature_c, 25.5);
  const std::vector<EffectValue> expected = {{"accel_second_order", "x", 20.25, 0.75},
                                             {"accel_second_order", "z", -3.5, 1.25},
                                             {"gyro_warm_up", "y", 0.02, 0.01},
                                             {"gyro_warm_up", "tau_s", 240.0, {}}};
  EXPECT_EQ(read->effects, expected);
  EXPECT_EQ(read->sigma[0], 0.002);
  EXPECT_FALSE(read->sigma[5]);   // not determined: no sigma
  EXPECT_FALSE(read->sigma[18]);  // a21
  const auto further = [&](const std::string& key) -> std::string {
    for (const auto& [k, v] : read->further)
      if (k == key) return v;
    return "missing";
  };
  EXPECT_EQ(further("verdict.diagnosis"), "extended");
  EXPECT_EQ(further("noise.source"), "measured");
  EXPECT_NEAR(std::stod(further("noise.angle_random_walk.y_deg_per_rt_h")), 0.002, 1e-12);
  EXPECT_NEAR(std::stod(further("noise.velocity_random_walk.z_ug_per_rt_hz")), 8.0, 1e-9);
}

}  // namespace
}  // namespace turncal
