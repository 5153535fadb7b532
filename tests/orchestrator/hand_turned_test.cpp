// `turncal import --map`, `segment`, `calibrate` and `diagnose` on units turned by hand, as black boxes: a synthetic unit, and
// the measured data of ../shared with the figures of docs/accuracy.md.
#include <fmt/format.h>

#include "imu_io/base/text.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_text.h"
#include "tests/calib/hand_rotations.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

const std::string measured_beside = TURNCAL_SOURCE_DIR;
const std::string measured = measured_beside + "/../shared/data/measured/";

#define SKIP_WITHOUT_DATA() \
  if (!std::filesystem::exists(measured)) GTEST_SKIP() << "measured data are not here: " << measured

struct BeforeAfter {
  double before = NAN, after = NAN;
};

class HandTurned : public Program {
 protected:
  std::string synthetic(const std::string& name, const HandPlan& plan) const {
    const HandData hand = make_hand_data(plan);
    write(name + "/recording.conf",
          "format = 1\nsample_period_s = 0.01\nlatitude_deg = 0\ngravity_mps2 = 9.81\nunit_serial = hand\n"
          "gyro_increment = rad\naccel_increment = mps\n");
    std::string segments = std::string(segments_csv_header) + "\n";
    for (const Segment& s : hand.segments)
      segments += "0," + std::string(to_string(s.kind)) + "," + std::to_string(s.start_sample) + "," +
                  std::to_string(s.end_sample) + ",0,0,0\n";
    write(name + "/segments.csv", segments);
    std::string imu = "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n";
    for (const ImuSample& s : hand.samples) {
      imu += std::to_string(s.counter);
      for (const double x : s.gyro) imu += "," + format_number(x);
      for (const double x : s.accel) imu += "," + format_number(x);
      imu += "\n";
    }
    write(name + "/imu.csv", imu);
    return name;
  }
  static HandPlan with_g_sensitivity(unsigned seed) {
    HandPlan plan;
    plan.seed = seed;
    plan.effect = [](const DisturbedMoment& m) {
      const double x = 600.0 * degph * m.force_g.y(), z = -500.0 * degph * m.force_g.x();
      return AddedReading{.gyro_radps = {x, 0.0, z}};
    };
    return plan;
  }
  std::string segmented(const std::string& map, const std::string& csv, const std::string& name) const {
    EXPECT_EQ(run({"import", "--map", map, measured + csv, "--out", name + "_raw"}).code, 0);
    EXPECT_EQ(run({"segment", name + "_raw", "--out", name}).code, 0);
    return name;
  }
  std::string map_of(const std::string& name) const { return measured_beside + "/docs/maps/" + name + ".map"; }
  // Whatever the verdict is, what is not trusted has a reason, the same in parameters.conf.
  std::map<std::string, std::string> conf(const std::string& folder) const {
    auto said = entries(file_text(path(folder + "/diagnosis.conf")));
    auto file =
        path_exists(path(folder + "/parameters.conf")) ? entries(file_text(path(folder + "/parameters.conf"))) : said;
    EXPECT_EQ(said["quality.trusted"], said["quality.reason"].empty() ? "true" : "false");
    EXPECT_EQ(file["quality.reason"], said["quality.reason"]);
    return said;
  }
  // "# cross-validation: gyros at rest rms: 0.0711 before, 0.0194 after, deg/s"
  BeforeAfter figure(const std::string& folder, const std::string& what) const {
    BeforeAfter result;
    for (std::string word; const std::string& line : lines_of(file_text(path(folder + "/diagnosis.conf"))))
      if (line.starts_with("# " + what + ": "))
        std::istringstream(line.substr(what.size() + 4)) >> result.before >> word >> result.after;
    EXPECT_TRUE(std::isfinite(result.before)) << what;
    return result;
  }
};

// A gyro that gives one value, with a map that is not in doubt, by bytes or in text: every way in says it, and nothing is calibrated from it.
TEST_F(HandTurned, ADeadGyroIsSaid) {
  synthetic("rec", {});
  std::string text, csv = "gx,gy,gz,ax,ay,az\n";
  for (const std::string& line : lines_of(file_text(path("rec/imu.csv")))) {
    std::vector<std::string> cells = lines_of(line, ',');
    if (cells.size() == 7 && cells[0] != "sample") {
      cells[2] = "0";
      csv += fmt::format("{}\n", fmt::join(cells.begin() + 1, cells.end(), ","));
    }
    text += fmt::format("{}\n", fmt::join(cells, ","));
  }
  write("rec/imu.csv", text);
  write("log.csv", csv);
  write("map.conf",
        "gyro.columns = gx, gy, gz\ngyro.unit = rad\naccel.columns = ax, ay, az\naccel.unit = m/s\nrate_hz = 100\n"
        "gravity_mps2 = 9.81\nunit_serial = hand\n");
  const std::string said = "gyro y gave the same value, 0, in all samples";
  EXPECT_SAYS(ends("import rec --out binary", 0).out, said);
  EXPECT_SAYS(ends("import log.csv --map map.conf --out table", 0).out, said);
  for (const char* recording : {"rec", "binary", "table"})
    EXPECT_SAYS(ends(std::string("calibrate ") + recording + " --out out", 20).err, said);
}

TEST_F(HandTurned, DiagnosesAndWritesTheThreeFiles) {
  synthetic("rec", with_g_sensitivity(3));
  const ProgramResult result = ends({"diagnose", "rec", "--out", "out", "--verbose"}, 20);
  EXPECT_EQ(result.err, "");
  const auto c = conf("out");
  EXPECT_EQ(c.at("verdict"), "extended");
  EXPECT_EQ(c.at("effects"), "gyro_g_sensitivity");
  for (const auto& [key, truth] : {std::pair{"gyro_g_sensitivity.xy", 600.0}, {"gyro_g_sensitivity.zx", -500.0}}) {
    ASSERT_EQ(c.count("effect." + std::string(key)), 1u) << key;
    EXPECT_NEAR(std::stod(c.at("effect." + std::string(key))), truth,
                4.0 * std::stod(c.at("sigma.effect." + std::string(key))));
  }
  EXPECT_EQ(c.at("holdout.source"), "cross-validation over rests and rotations");
  EXPECT_LT(std::stod(c.at("holdout.after")), 0.7 * std::stod(c.at("holdout.before")));
  EXPECT_LT(std::stod(c.at("error.after")), 0.7 * std::stod(c.at("error.before")));
  EXPECT_SAYS(c.at("undetectable"), "gyro_magnetic");
  EXPECT_EQ(c.count("detectable.accel_second_order.x"), 1u);
  const auto parameters = good(read_parameter_file(path("out/parameters.conf")));
  EXPECT_EQ(parameters->method, "rests");
  EXPECT_EQ(parameters->model, "extended");
  EXPECT_GE(parameters->effects.size(), 2u);
  const std::string table =
      result.out.substr(result.out.find("verdict"), result.out.find("\n\ndiagnosis") - result.out.find("verdict"));
  EXPECT_LE(std::ranges::count(table, '\n') + 1, 30) << table;
  run({"calibrate", "rec", "--out", "parameters"});
  EXPECT_SAYS(file_text(path("parameters/parameters.conf")), "quality.trusted = false");
}

TEST_F(HandTurned, ASecondRecordingIsTheGateAndTheErrorIsThere) {
  HandPlan plan = with_g_sensitivity(3);
  synthetic("rec", plan);
  // The same unit: make_hand_data draws it from the seed first, the poses after it.
  plan.rests = 14;
  synthetic("other", plan);
  ends({"diagnose", "rec", "--holdout", "other", "--out", "out"}, 20);
  EXPECT_EQ(conf("out").at("holdout.source"), "second recording");
  const BeforeAfter direction = figure("out", "second recording: gravity direction after a rotation rms");
  EXPECT_LT(direction.after, 0.6 * direction.before);
}

TEST_F(HandTurned, ACleanUnitIsClean) {
  HandPlan plan;
  plan.seed = 2;
  synthetic("rec", plan);
  EXPECT_EQ(run({"diagnose", "rec", "--out", "out"}).code, 0);
  EXPECT_EQ(conf("out").at("verdict"), "clean");
  EXPECT_EQ(conf("out").at("effects"), "");
  const ProgramResult calibrated = ends({"calibrate", "rec", "--out", "parameters", "--verbose"}, 0);
  EXPECT_SAYS(calibrated.out, "20 rests and 19 rotations by hand");
  EXPECT_SAYS(file_text(path("parameters/parameters.conf")), "quality.trusted = true");
  EXPECT_EQ(run({"apply", "rec", "--parameters", "parameters/parameters.conf", "--out", "applied.csv"}).code, 0);
}

TEST_F(HandTurned, RefusesWhatItCannotUse) {
  HandPlan plan;
  plan.rests = 3;
  synthetic("few", plan);
  expect_refused({"diagnose", "few", "--out", "out"}, "a calibration needs 4 rests");
  expect_refused({"calibrate", "few", "--out", "out"}, "a calibration needs 4 rests");
  plan.rests = 12;
  synthetic("rec", plan);
  expect_refused("calibrate rec --method closed-form --out out", "all table angles are 0, as of a unit turned by hand");
  expect_refused({"diagnose", "rec", "--arw", "0.1", "--vrw", "10", "--out", "out"}, "expected no --arw");
}

// A not_tested verdict leaves no parameters, not even those of an earlier diagnosis in the folder.
TEST_F(HandTurned, WrongUnitsAreSaidAndNothingIsWritten) {
  HandPlan plan;
  plan.seed = 2;
  synthetic("right", plan);
  EXPECT_EQ(run({"diagnose", "right", "--out", "out"}).code, 0);
  EXPECT_TRUE(std::filesystem::exists(path("out/parameters.conf")));
  plan.scale_accel = 1.0 / standard_gravity_mps2;
  synthetic("in_g", plan);
  ends({"diagnose", "in_g", "--out", "out"}, 20);
  EXPECT_SAYS(conf("out").at("quality.reason"), "look as if they were in g");
  EXPECT_EQ(conf("out").at("verdict"), "not_tested");
  EXPECT_FALSE(std::filesystem::exists(path("out/parameters.conf")));
  expect_refused({"calibrate", "in_g", "--out", "calibrated"}, "look as if they were in g", 20);
  const ProgramResult segmented_again = run({"segment", "in_g", "--out", "segmented"});
  EXPECT_SAYS(segmented_again.out, "units: gravity reads 0.994 where 9.81");
  EXPECT_SAYS(run("allan segmented").out, "units: gravity reads 0.99");
  const std::string map =
      "rate_hz = 100\ngyro.columns = gyro_x, gyro_y, gyro_z\ngyro.unit = rad\naccel.columns = accel_x, accel_y, "
      "accel_z\naccel.unit = m/s\ngravity_mps2 = 9.81\nunit_serial = hand\n";
  for (const char* scale : {"0.75", "1", "1.3"}) {
    write("scaled.map", map + "accel.scale = " + scale + "\n");
    if (std::string_view(scale) == "1")
      ends("import right/imu.csv --map scaled.map --out imported", 0);
    else
      expect_refused("import right/imu.csv --map scaled.map --out scaled", "units: gravity reads");
  }
  EXPECT_FALSE(std::filesystem::exists(path("scaled")));
}

// docs/accuracy.md, story 1.
TEST_F(HandTurned, MeasuredXsens) {
  SKIP_WITHOUT_DATA();
  segmented(map_of("xsens_mti_imutk"), "xsens_mti_imutk/xsens_first_half.csv", "xsens");
  EXPECT_EQ(run({"diagnose", "xsens", "--out", "out"}).code, 20);
  EXPECT_EQ(conf("out").at("effects"), "gyro_g_sensitivity");
  const BeforeAfter fitted = figure("out", "fitted: gravity direction after a rotation rms");
  const BeforeAfter left_out = figure("out", "cross-validation: gravity direction after a rotation rms");
  EXPECT_NEAR(fitted.before, 6.73, 0.05);
  EXPECT_NEAR(fitted.after, 1.65, 0.05);
  EXPECT_NEAR(left_out.before, 9.55, 0.1);
  EXPECT_NEAR(left_out.after, 2.58, 0.1);
  EXPECT_NEAR(figure("out", "fitted: gravity norm at rest rms").before, 0.926, 0.01);
  EXPECT_SAYS(conf("out").at("quality.reason"), "gravity norm at rest is 4.2 times");
  // Not trusted without the g-sensitivity.
  EXPECT_EQ(run({"calibrate", "xsens", "--out", "parameters"}).code, 20);
  // As it was imported, without segments: the same rests are found.
  EXPECT_EQ(run({"diagnose", "xsens_raw", "--out", "raw"}).code, 20);
  EXPECT_EQ(conf("raw"), conf("out"));
}

// Story 3: data that are too few have no name.
TEST_F(HandTurned, MeasuredFew) {
  SKIP_WITHOUT_DATA();
  segmented(map_of("imucal_ferraris"), "imucal_ferraris/example_ferraris_session.csv", "ferraris");
  const ProgramResult few = ends({"diagnose", "ferraris", "--out", "few", "--verbose"}, 20);
  EXPECT_EQ(conf("few").at("verdict"), "unexplained");
  EXPECT_EQ(conf("few").at("quality.trusted"), "false");
  EXPECT_EQ(conf("few").at("effects"), "");
  EXPECT_SAYS(few.out, "the fit depends on individual rests");
}

}  // namespace
}  // namespace turncal
