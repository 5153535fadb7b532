// `turncal diagnose` as a black box: what it writes, exit codes, refusals; on the rig's recordings and on those of another simulator.
#include <cstdlib>
#include <map>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

const std::string recordings = std::string(TURNCAL_SOURCE_DIR) + "/../shared/data/recordings/";

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
  EXPECT_EQ(conf.count("alias.accel_delay"), 1u);
  EXPECT_EQ(conf.at("holdout.source"), "cross-validation over dwells");
  EXPECT_LT(std::stod(conf.at("holdout.after")), std::stod(conf.at("holdout.before")));
  EXPECT_LT(std::stod(conf.at("error.after")), std::stod(conf.at("error.before")));
  // In miles: with one effect, leaving it out is the base model.
  EXPECT_EQ(conf.at("navigation.source"), "fitted recording");
  const double worth = std::stod(conf.at("navigation.accel_delay_nm_per_h"));
  EXPECT_GT(worth, 0.01);
  EXPECT_LT(worth, std::stod(conf.at("navigation.before_nm_per_h")) + std::stod(conf.at("navigation.after_nm_per_h")));
  EXPECT_SAYS(result.out, "fitted recording: free navigation, rms of 8 starts");
  // The effect is in the parameter file, to the digit, which is marked as simulated.
  const auto parameters = read_parameter_file(path("out/parameters.conf"));
  ASSERT_TRUE(parameters.ok()) << parameters.error().message;
  ASSERT_EQ(parameters->effects.size(), 1u);
  EXPECT_EQ(parameters->effects[0].name, "accel_delay");
  EXPECT_EQ(parameters->effects[0].component, "tau");
  EXPECT_EQ(parameters->effects[0].value, value);
  EXPECT_EQ(parameters->model, "extended");
  EXPECT_TRUE(parameters->simulated);
  EXPECT_TRUE(parameters->reference_temperature_c);
  const std::string html = file_text(path("out/report.html"));
  EXPECT_SAYS(html, "accel_delay, time delay of the accelerometers");
  EXPECT_SAYS(html, "Simulated data");
  EXPECT_LT(html.size(), 3u << 20);
  // The terminal gets the same, short; its last lines are those of a terminal that did not ask for more, and stand on the page.
  const std::string last = "verdict         Extended; parameters trusted\nreason          added: accel_delay, tau 0.3";
  EXPECT_SAYS(result.out, last);
  EXPECT_TRUE(result.out.ends_with(" sigma)\nopen out/report.html\n")) << result.out;
  EXPECT_SAYS(html, "<td>Extended; parameters trusted</td>");
  EXPECT_SAYS(result.out, "verdict         Extended: one effect beyond the 24 parameters");
  EXPECT_SAYS(result.out, "out/report.html");
  EXPECT_LE(std::count(result.out.begin(), result.out.end(), '\n'), 30 + 10);

  // For programs: the file as one object, and the residuals as numbers.
  const ProgramResult json =
      ends({"diagnose", "rec", "--out", "out", "--format", "json", "--residuals", path("residuals.csv")}, 20);
  EXPECT_TRUE(json.out.starts_with("{\n\"verdict\":\"extended\",\n\"quality.trusted\":true,\n")) << json.out;
  EXPECT_SAYS(json.out, "\n\"effect.accel_delay.tau\":" + conf.at("effect.accel_delay.tau") + ",\n");
  const std::string residuals = file_text(path("residuals.csv"));
  EXPECT_TRUE(residuals.starts_with("time_s,segment,since_rotation_s,temperature_c,force_x_mps2,"));
  EXPECT_GT(std::count(residuals.begin(), residuals.end(), '\n'), 4000);

  // Again, without gnuplot: another report, the same answer, the same exit code.
  const char* const old_path = std::getenv("PATH");
  const std::string kept = old_path != nullptr ? old_path : "";
  ::setenv("PATH", path("nowhere").c_str(), 1);
  const ProgramResult without = run({"diagnose", "rec", "--out", "out"});
  ::setenv("PATH", kept.c_str(), 1);
  EXPECT_EQ(without.code, 20);
  EXPECT_EQ(without.err, "");
  EXPECT_SAYS(without.out, last);
  EXPECT_LE(std::count(without.out.begin(), without.out.end(), '\n'), 8) << without.out;
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
  expect_refused({"diagnose", "missing", "--out", "out"}, "missing");
  expect_refused("diagnose rec --out rec", "--out rec: expected another folder than that of the source, rec");
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
  expect_refused({"diagnose", "rec", "--out", "out", "--vrw", "8"}, "--arw and --vrw fix the noise together");
  expect_refused({"diagnose", "rec", "--out", "out", "--arw", "-1", "--vrw", "8"}, "--arw");
  expect_refused("diagnose rec --out out --gyro-bias-instability 0.001", "expected --arw and --vrw with them");
}

TEST_F(Diagnose, TakesSeveralRecordingsOfOneUnitAndSeveralHoldouts) {
  rig_recording("one", "seed = 7\nnoise.seed = 1\n");
  rig_recording("two", "seed = 7\nnoise.seed = 2\n");
  rig_recording("third", "seed = 7\nnoise.seed = 3\n", "holdout.seq");
  rig_recording("fourth", "seed = 7\nnoise.seed = 4\n", "holdout.seq");
  rig_recording("north", "seed = 7\nsite.latitude_deg = 60\n", "short_demo.seq");
  const ProgramResult result =
      run({"diagnose", "one", "two", "--holdout", "third", "--holdout", "fourth", "--out", "out"});
  EXPECT_EQ(result.code, 0) << result.out << result.err;
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

class DiagnoseShared : public Diagnose {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(recordings + "clean/imu.csv"))
      GTEST_SKIP() << "the recordings of the independent simulator are not here: " << recordings;
    Diagnose::SetUp();
  }
  std::map<std::string, std::string> diagnose_shared(const std::string& name, int code) const {
    const ProgramResult result =
        run({"diagnose", recordings + name, "--holdout", recordings + name + "/holdout", "--out", name});
    EXPECT_EQ(result.code, code) << result.out << result.err;
    return entries(file_text(path(name + "/diagnosis.conf")));
  }
};

TEST_F(DiagnoseShared, CleanIsClean) {
  const auto conf = diagnose_shared("clean", 0);
  EXPECT_EQ(conf.at("verdict"), "clean");
  EXPECT_EQ(conf.at("effects"), "");
  EXPECT_EQ(conf.at("holdout.source"), "second recording");
  EXPECT_EQ(conf.at("error.before"), conf.at("error.after"));
}

TEST_F(DiagnoseShared, UndeclaredEffectsLowerTheErrorOnTheHoldout) {
  for (const char* name : {"undeclared-1", "undeclared-2"}) {
    const auto conf = diagnose_shared(name, 20);
    EXPECT_EQ(conf.at("verdict"), "extended") << name;
    EXPECT_NE(conf.at("effects"), "") << name;
    EXPECT_LT(std::stod(conf.at("holdout.after")), std::stod(conf.at("holdout.before"))) << name;
    EXPECT_LT(std::stod(conf.at("holdout.velocity_rms_after_mps")),
              std::stod(conf.at("holdout.velocity_rms_before_mps")))
        << name;
  }
}

}  // namespace
}  // namespace turncal
