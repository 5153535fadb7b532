// `turncal diagnose` as a black box: what it writes, exit codes, refusals.

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Diagnose : public Program {
 protected:
  // A run on the rig, recorded only. An empty sequence: the fourteen steps.
  std::string rig_recording(const std::string& name, const std::string& rig, const std::string& sequence = "",
                            const std::string& unit = "SN1") const {
    std::vector<std::string> arguments = {"run", "--dry-run", "--capture-only",         "--unit", unit, "--out",
                                          name,  "--rig",     write(name + ".rig", rig)};
    if (!sequence.empty()) {
      arguments.push_back("--sequence");
      arguments.push_back(std::string(TURNCAL_SOURCE_DIR) + "/sequences/" + sequence);
    }
    ends(arguments, 0);
    return path(name);
  }
};

TEST_F(Diagnose, FindsTheDelayThatTheRigWasGivenAndSaysWhatItDid) {
  rig_recording("rec", "seed = 7\neffect.accel_delay.tau = 0.3\n");
  const ProgramResult result = ends({"diagnose", "rec", "--out", "out", "--verbose"}, 20);
  EXPECT_EQ(result.err, "");
  const auto conf = entries(file_text(path("out/diagnosis.conf")));
  ASSERT_EQ(conf.at("verdict"), "extended");
  EXPECT_EQ(conf.at("effects"), "accel_delay");
  const double value = std::stod(conf.at("effect.accel_delay.tau"));
  const double sigma = std::stod(conf.at("sigma.effect.accel_delay.tau"));
  EXPECT_NEAR(value, 0.3, 3.5 * sigma);
  EXPECT_LT(sigma, 0.01);
  EXPECT_EQ(conf.at("holdout.source"), "cross-validation over dwells");
  EXPECT_LT(std::stod(conf.at("holdout.after")), std::stod(conf.at("holdout.before")));
  EXPECT_LT(std::stod(conf.at("error.after")), std::stod(conf.at("error.before")));
  // In miles: with one effect, leaving it out is the base model.
  EXPECT_EQ(conf.at("navigation.source"), "fitted recording");
  const double worth = std::stod(conf.at("navigation.accel_delay_nm_per_h"));
  EXPECT_GT(worth, 0.01);
  EXPECT_LT(worth, std::stod(conf.at("navigation.before_nm_per_h")) + std::stod(conf.at("navigation.after_nm_per_h")));
  // The effect is in the parameter file, to the digit, which is marked as simulated.
  const auto parameters = good(read_parameter_file(path("out/parameters.conf")));
  ASSERT_EQ(parameters->effects.size(), 1u);
  EXPECT_EQ(parameters->effects[0].name, "accel_delay");
  EXPECT_EQ(parameters->effects[0].component, "tau");
  EXPECT_EQ(parameters->effects[0].value, value);
  EXPECT_EQ(parameters->model, "extended");
  EXPECT_TRUE(parameters->simulated);
  EXPECT_TRUE(parameters->reference_temperature_c);
  // The terminal gets the same, short; its last lines are those of a terminal that did not ask for more.
  const std::string last = "verdict         Extended; parameters trusted\nreason          added: accel_delay, tau 0.3";
  EXPECT_SAYS(result.out, last);
  EXPECT_TRUE(result.out.ends_with(" sigma), probability more than 0.99\nopen out/report.html\n")) << result.out;

  // Again, without gnuplot: another report, the same answer, the same exit code.
  const char* const old_path = std::getenv("PATH");
  const std::string kept = old_path != nullptr ? old_path : "";
  ::setenv("PATH", path("nowhere").c_str(), 1);
  const ProgramResult without = run({"diagnose", "rec", "--out", "out"});
  ::setenv("PATH", kept.c_str(), 1);
  EXPECT_EQ(without.code, 20);
  EXPECT_EQ(without.err, "");
  EXPECT_SAYS(without.out, last);
  EXPECT_LE(std::ranges::count(without.out, '\n'), 8) << without.out;
  EXPECT_SAYS(without.out, "report without plots: no plots: gnuplot is not installed");
  EXPECT_EQ(entries(file_text(path("out/diagnosis.conf"))), conf);
  EXPECT_SAYS_NOT(file_text(path("out/report.html")), "<svg");
}

TEST_F(Diagnose, RefusesInOneLine) {
  rig_recording("rec", "seed = 1\n", "short_demo.seq");
  rig_recording("other", "seed = 2\n", "short_demo.seq", "SN2");
  write("file", "not a folder");
  expect_refused({"diagnose"}, "recording");
  expect_refused({"diagnose", "rec"}, "--out");
  expect_refused("diagnose rec/recording.tcr --out ./rec/",
                 "expected another folder than that of the source, rec/recording.tcr");
  expect_refused("diagnose rec --holdout other --out other", "expected another folder than that of the source, other");
  expect_refused({"diagnose", "rec", "--holdout", "missing", "--out", "out"}, "missing");
  expect_refused("diagnose rec --holdout rec --out out",
                 "rec/recording.tcr: is given twice: expected recordings that differ");
  expect_refused("diagnose rec --holdout other --out out",
                 "other/recording.tcr: unit_serial = 'SN2': expected 'SN1', as in rec/recording.tcr");
  expect_refused({"diagnose", "rec", "--out", "file"}, "file");
  expect_refused({"diagnose", "rec", "--out", "out", "--arw", "0.002"}, "--arw and --vrw fix the noise together");
  expect_refused({"diagnose", "rec", "--out", "out", "--arw", "-1", "--vrw", "8"}, "--arw");
  expect_refused("diagnose rec --out out --gyro-bias-instability 0.001", "expected --arw and --vrw with them");
}

TEST_F(Diagnose, TakesSeveralRecordingsOfOneUnitAndSeveralHoldouts) {
  rig_recording("one", "seed = 7\nnoise.seed = 1\n");
  rig_recording("two", "seed = 7\nnoise.seed = 2\n");
  rig_recording("third", "seed = 7\nnoise.seed = 3\n", "holdout.seq");
  rig_recording("fourth", "seed = 7\nnoise.seed = 4\n", "holdout.seq");
  rig_recording("north", "seed = 7\nsite.latitude_deg = 60\n", "short_demo.seq");
  const ProgramResult result = ends("diagnose one two --holdout third --holdout fourth --out out --verbose", 0);
  EXPECT_SAYS(result.out, "turn-on repeatability of A01: ");
  const auto conf = entries(file_text(path("out/diagnosis.conf")));
  EXPECT_EQ(conf.at("verdict"), "clean");
  EXPECT_EQ(conf.at("holdout.source"), "2 other recordings");
  EXPECT_NEAR(std::stod(conf.at("recording.2.A01")), std::stod(conf.at("recording.1.A01")), 3e-6);
  const auto parameters = entries(file_text(path("out/parameters.conf")));
  EXPECT_EQ(parameters.at("record.recordings"), "2");
  EXPECT_EQ(parameters.at("record.recording.2.A01"), conf.at("recording.2.A01"));
  EXPECT_EQ(parameters.at("record.recording.2.started_utc"), "2026-01-01T00:00:00Z");  // by the rig's clock
  EXPECT_EQ(parameters.count("quality.turn_on_repeatability.N02"), 1u);
  EXPECT_EQ(parameters.at("quality.trusted"), "true");
  expect_refused({"diagnose", "one", "one", "--out", "out"}, "is given twice: expected recordings that differ");
  expect_refused({"diagnose", "one", "two", "--holdout", "two", "--out", "out"}, "is given twice");
  expect_refused({"diagnose", "one", "north", "--out", "out"}, "latitude_deg = 60: expected 29.53, as in one");
}

TEST_F(Diagnose, AUnitIsNotRecordedTwiceAtATime) {
  for (const int k : {1, 2}) {
    const std::string name = "r" + std::to_string(k);
    rig_recording(name, "seed = 7\nnoise.seed = " + std::to_string(k) + "\n", "forty_minutes.seq");
    ASSERT_EQ(run({"export", name, "--out", name + "t"}).code, 0);
  }
  const auto started = [this](const std::string& name, const std::string& utc) {
    std::string conf = file_text(path(name + "/recording.conf"));
    conf.erase(conf.find("started_utc"));  // and `simulated` after it: the rig's clock begins all runs at one time
    write(name + "/recording.conf", conf + (utc.empty() ? "" : "started_utc = " + utc + "\n"));
  };
  started("r1t", "2026-01-31T12:00:00Z");
  started("r2t", "2026-01-31T12:20:00Z");
  const std::string refusal = "r2t: started_utc = 2026-01-31T12:20:00Z, while r1t was being recorded";
  expect_refused({"calibrate", "r1t", "r2t", "--out", "out"}, refusal);
  expect_refused({"calibrate", "r2t", "r1t", "--out", "out"}, refusal);
  started("r2t", "2026-01-31T13:00:00Z");
  EXPECT_EQ(run({"calibrate", "r1t", "r2t", "--out", "out"}).code, 0);
  const auto file = entries(file_text(path("out/parameters.conf")));
  EXPECT_EQ(file.at("record.measured_utc"), "2026-01-31T12:00:00Z");
  EXPECT_EQ(file.at("record.recording.2.started_utc"), "2026-01-31T13:00:00Z");
  started("r2t", "");
  EXPECT_EQ(run({"calibrate", "r1t", "r2t", "--out", "out"}).code, 0);
}

TEST_F(Diagnose, GivenNoiseIsUsedAndSaidToBeGiven) {
  rig_recording("rec", "seed = 11\n");
  const ProgramResult result = run({"diagnose", "rec", "--out", "out", "--arw", "0.002", "--vrw", "8", "--verbose"});
  EXPECT_TRUE(result.code == 0 || result.code == 20) << result.err;
  const auto parameters = entries(file_text(path("out/parameters.conf")));
  EXPECT_EQ(parameters.at("noise.source"), "given");
  EXPECT_NEAR(std::stod(parameters.at("noise.angle_random_walk.x_deg_per_rt_h")), 0.002, 1e-12);
  EXPECT_NEAR(std::stod(parameters.at("noise.velocity_random_walk.z_ug_per_rt_hz")), 8.0, 1e-9);
  EXPECT_SAYS(result.out, "configured: ARW 0.00200");
  // A noise three times too small explains nothing: no effect may be named for it.
  const ProgramResult small =
      ends({"diagnose", "rec", "--out", "small", "--arw", "0.0007", "--vrw", "2.7", "--verbose"}, 20);
  const auto conf = entries(file_text(path("small/diagnosis.conf")));
  EXPECT_EQ(conf.at("verdict"), "noise_model");
  EXPECT_EQ(conf.at("effects"), "");
}

}  // namespace
}  // namespace turncal
