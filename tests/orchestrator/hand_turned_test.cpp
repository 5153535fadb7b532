// `turncal import --map`, `segment`, `calibrate` and `diagnose` on units turned by hand: the measured data of ../shared with the figures of
// docs/accuracy.md. What is refused and what is not trusted: tests/golden/turned.sh.
#include "imu_io/base/files.h"
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
