// `turncal verify` as a program: north seeking on the rig, judged; readings of references; and what is refused.
#include <gtest/gtest.h>

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Verify : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    write("good.rig",
          "noise.gyro_random_walk_deg_per_rt_h = 0.0001\nnoise.gyro_bias_instability_degph = 0\n"
          "noise.accel_random_walk_ug_per_rt_hz = 1\nnoise.accel_bias_instability_ug = 0\n");
    write("short.seq",
          "format = 1\nname = short\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n"
          "  align 6000\n  align 6000\nstep 2\n  initial H 90 P 0 R 0\n  dwell 6000\n  dwell 6000\n");
  }
  // True parameters of the rig's unit, but for `change` of one of them, and noise as it is.
  void write_parameters(const std::string& name, int parameter = 0, double change = 0.0) {
    if (!std::filesystem::exists(folder_ / "one")) {
      write("one.seq",
            "format = 1\nname = one\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 0\n"
            "  align 200\n  dwell 200\n");
      ASSERT_EQ(run({"run", "--dry-run", "--unit", "SN7", "--out", "one", "--capture-only", "--rig", path("good.rig"),
                     "--sequence", path("one.seq")})
                    .code,
                0);
    }
    KeyValueFile truth = *KeyValueFile::parse(file_text(folder_ / "one/truth.conf"), "truth.conf");
    ParameterFile file;
    describe_recording((*RecordingSource::open(path("one")))->info(), file);
    for (std::size_t k = 0; k < parameter_keys.size(); ++k)
      file.parameters[static_cast<Eigen::Index>(k)] = truth.number(parameter_keys[k]);
    file.parameters[parameter] += change;
    file.model = "base";
    file.method = "joint";
    file.simulated = true;
    file.recording_hash = std::string(32, '0');
    file.software_version = "test";
    file.time_utc = "2026-01-31T12:00:00Z";
    for (const char* axis : {"x", "y", "z"}) {
      file.add_further(std::string("noise.angle_random_walk.") + axis + "_deg_per_rt_h", 0.0001);
      file.add_further(std::string("noise.velocity_random_walk.") + axis + "_ug_per_rt_hz", 1.0);
    }
    const Status written = write_parameter_file(file, path(name));
    ASSERT_TRUE(written.ok()) << written.error().message;
  }
  KeyValueFile result(const std::string& name) { return *KeyValueFile::parse(file_text(folder_ / name), name); }
};

TEST_F(Verify, SeeksNorthInFourHeadings) {
  write_parameters("true.conf");
  const ProgramResult verified = run({"verify", "--dry-run", "--unit", "SN7", "--parameters", path("true.conf"),
                                      "--rig", path("good.rig"), "--out", "v"});
  ASSERT_EQ(verified.code, 0) << verified.err << verified.out;
  KeyValueFile conf = result("v/verification.conf");
  for (int p = 1; p <= 4; ++p) {
    const std::string prefix = "position." + std::to_string(p) + ".";
    EXPECT_EQ(conf.number(prefix + "table_deg"), 90.0 * (p - 1));
    EXPECT_TRUE(conf.has(prefix + "4.pitch_deg"));
    EXPECT_FALSE(conf.has(prefix + "5.pitch_deg"));
    EXPECT_NEAR(conf.number(prefix + "mean.heading_deg"), 90.0 * (p - 1), 0.012);
    EXPECT_LT(conf.number(prefix + "deviation.heading_deg"), 0.012);
    EXPECT_GT(conf.number(prefix + "sigma.heading_deg"), 0.0005);
  }
  EXPECT_NEAR(conf.number("align_s"), 300.0, 0.2);
  EXPECT_EQ(conf.number("limit.heading_deg"), 0.012);
  const std::string verdict = conf.text("verdict.result");
  EXPECT_TRUE(verdict == "pass" || verdict == "conditional_pass") << verdict;
  EXPECT_NE(verified.out.find("[dry run] verdict  " + verdict), std::string::npos);
  // Judged again from its recording: the same bytes.
  ASSERT_EQ(run({"verify", "--recording", "v", "--parameters", path("true.conf"), "--out", "again"}).code, 0);
  EXPECT_EQ(file_text(folder_ / "again/verification.conf"), file_text(folder_ / "v/verification.conf"));
  // A gyro bias of 0.02 deg/h is a heading error of 0.09 deg, the other way round at 180.
  write_parameters("wrong.conf", 0, 0.02);
  const ProgramResult failed = run({"verify", "--recording", "v", "--parameters", path("wrong.conf"), "--out", "w"});
  EXPECT_EQ(failed.code, 20) << failed.out;
  EXPECT_EQ(failed.err_lines(), 1);
  EXPECT_EQ(result("w/verification.conf").text("verdict.heading"), "fail");
  // The station's own limit, wide enough.
  write("wide.station", "format = 1\n" + std::string("site.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\n"
                                                     "table.driver = mock\nimu.driver = rig\nlimit.heading_deg = 1\n"));
  EXPECT_EQ(run({"verify", "--recording", "v", "--parameters", path("wrong.conf"), "--out", "wide", "--station",
                 path("wide.station")})
                .code,
            0);
}

TEST_F(Verify, RefusesWhatItCannotUse) {
  write_parameters("true.conf");
  const auto with = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments = {"verify", "--parameters", path("true.conf"), "--out", "v"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  expect_refused({"verify"}, "--parameters is required");
  expect_refused({"verify", "--parameters", path("true.conf")}, "--out is required");
  expect_refused(with({}), "--unit is required");
  expect_refused(with({"--dry-run", "--unit", "SN8"}), "SN8");
  expect_refused(with({"--dry-run", "--unit", "SN7", "--sequence", "nothing.seq"}), "nothing.seq");
  expect_refused(with({"--recording", "one", "--dry-run"}), "--recording: expected no --unit");
  expect_refused(with({"--recording", "one"}), "alignment: 1 s at rest, expected at least 20 s");
  expect_refused({"verify", "--references", "none.csv"}, "none.csv");
  expect_refused({"verify", "--references", "none.csv", "--dry-run"}, "--references: expected no other option");
  // A unit that lies on its side.
  write("side.seq",
        "format = 1\nname = side\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n  initial H 0 P 0 R 90\n"
        "  align 6000\n  dwell 6000\n");
  ASSERT_EQ(run({"run", "--dry-run", "--unit", "SN7", "--out", "side", "--capture-only", "--rig", path("good.rig"),
                 "--sequence", path("side.seq")})
                .code,
            0);
  expect_refused(with({"--recording", "side"}), "expected the table at pitch 0 and roll 0");
}

constexpr const char* head =
    "heading_deg,roll_deg,pitch_deg,reference_heading_deg,reference_roll_deg,reference_pitch_deg\n";

TEST_F(Verify, ReadingsOfReferences) {
  write("table3.csv", std::string(head) +
                          "20.186751,0.009256,-0.017475,20.186751,0.009256,-0.017475\n"
                          "74.261759,0.017019,0.052811,74.262023,0.017211,0.052833\n"
                          "20.017897,0.012601,-0.013012,20.017913,0.012871,-0.014151\n");
  const ProgramResult passed = run({"verify", "--references", path("table3.csv"), "--out", "refs"});
  EXPECT_EQ(passed.code, 0) << passed.err;
  KeyValueFile conf = result("refs/references.conf");
  EXPECT_NEAR(conf.number("error.2.heading_deg"), -0.000264, 1e-10);
  EXPECT_NEAR(conf.number("worst.pitch_deg"), 0.001139, 1e-10);
  EXPECT_EQ(conf.text("verdict.result"), "pass");
  write("off.csv", std::string(head) + "20,0,0,20,0,0\n359.995,0,0,0.005,0,0\n");
  const ProgramResult failed = run({"verify", "--references", path("off.csv")});
  EXPECT_EQ(failed.code, 20);
  EXPECT_NE(failed.out.find("-0.010000"), std::string::npos) << failed.out;
  write("one.csv", std::string(head) + "20,0,0,20,0,0\n");
  expect_refused({"verify", "--references", path("one.csv")}, "1 rows, expected two and more");
  write("word.csv", std::string(head) + "20,0,0,20,0,0\n20,zero,0,20,0,0\n");
  expect_refused({"verify", "--references", path("word.csv")}, "word.csv");
  write("far.csv", std::string(head) + "20,0,0,20,0,0\n2000,0,0,20,0,0\n");
  expect_refused({"verify", "--references", path("far.csv")}, "far.csv:3: expected angles from -360 to 360 deg");
}

}  // namespace
}  // namespace turncal
