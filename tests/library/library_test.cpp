// The face of libturncal beside the program: the same results to the digit, the same lines of errors, and from two threads as from one.
#include <gtest/gtest.h>
#include <turncal/allan.h>
#include <turncal/calibrate.h>
#include <turncal/diagnose.h>
#include <turncal/predict.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

namespace turncal {
namespace {

namespace fs = std::filesystem;
const std::string sequences = TURNCAL_SOURCE_DIR "/sequences/";

std::string text_of(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

// A dry run of a unit whose accelerometer has a K2, recorded once for all tests.
class Library : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder = new fs::path(fs::temp_directory_path() / ("turncal-library-" + std::to_string(getpid())));
    fs::create_directories(*folder);
    std::ofstream(*folder / "k2.rig") << "effect.accel_second_order.x = 60\n";
    ASSERT_EQ(program("run --dry-run --quiet --capture-only --unit LIB --rig k2.rig --out run --sequence " + sequences +
                      "short_demo.seq"),
              "");
  }
  static void TearDownTestSuite() {
    fs::remove_all(*folder);
    delete folder;
  }
  // What it printed; errors are in the file "errors".
  static std::string program(const std::string& arguments) {
    const std::string command = "cd " + folder->string() + " && " TURNCAL_BINARY " " + arguments + " > said 2> errors";
    last = std::system(command.c_str());
    return text_of(*folder / "said");
  }
  static std::string path(const std::string& name) { return (*folder / name).string(); }
  static fs::path* folder;
  static int last;
};
fs::path* Library::folder = nullptr;
int Library::last = 0;

// Without what says when it was made.
std::map<std::string, std::string> keys(const Parameters& parameters) {
  std::map<std::string, std::string> all;
  for (const auto& [key, value] : parameters.items()) all[key] = value;
  all.erase("time_utc");
  return all;
}

TEST_F(Library, CalibratesAndDiagnosesAsTheCommandsDo) {
  const Recording recording = Recording::load(path("run"));
  program("calibrate run --out calibrated");
  const Calibration calibration = calibrate(recording);
  const Parameters file = Parameters::read(path("calibrated/parameters.conf"));
  EXPECT_EQ(keys(calibration.parameters), keys(file));
  EXPECT_EQ(file.text(), text_of(path("calibrated/parameters.conf")));
  EXPECT_EQ(calibration.distrust.empty(), calibration.parameters.trusted());
  EXPECT_EQ(file.items().size(), keys(file).size() + 1) << "a key twice";

  program("diagnose run --out diagnosed");
  const Diagnosis diagnosis = diagnose(recording);
  EXPECT_EQ(diagnosis.text, text_of(path("diagnosed/diagnosis.conf")));
  EXPECT_EQ(diagnosis.verdict, "extended");
  ASSERT_TRUE(diagnosis.parameters);
  EXPECT_EQ(keys(*diagnosis.parameters), keys(Parameters::read(path("diagnosed/parameters.conf"))));
  EXPECT_NE(diagnosis.report.html().find("accel_second_order"), std::string::npos);
}

TEST_F(Library, AppliesAsTheCommandDoes) {
  program("calibrate run --out for_apply");
  program("apply run --parameters for_apply/parameters.conf --out applied.tcr");
  const Recording command = Recording::load(path("applied.tcr"));
  const Recording applied = apply(Recording::load(path("run")), Parameters::read(path("for_apply/parameters.conf")));
  EXPECT_EQ(applied.hash(), command.hash());
  EXPECT_EQ(applied.info().gyro_increment, IncrementKind::physical);
  EXPECT_EQ(applied.samples().size(), command.samples().size());
}

TEST_F(Library, AllanAndPredictionAreThoseOfTheCommands) {
  program("allan run --out allan");
  const Allan noise = allan(Recording::load(path("run")));
  EXPECT_EQ(noise.csv, text_of(path("allan/allan.csv")));
  EXPECT_EQ(noise.imu_yaml, text_of(path("allan/imu.yaml")));
  EXPECT_GT(noise.axes[0].coefficients[1].value, 0.0);

  const std::string sequence = sequences + "two_axes.seq";
  const Prediction prediction = predict({sequence}, {.arw_deg_per_rt_h = 0.004});
  EXPECT_EQ(prediction.report.text(), program("predict --arw 0.004 --sequence " + sequence));
  EXPECT_GT(prediction.sequences.front().sigma[0], 0.0);
}

TEST_F(Library, FindsTheRestsThatTheCommandFinds) {
  program("segment run --out segmented");
  const Recording found = Recording::load(path("run")).with_rests();
  EXPECT_EQ(found.hash(), Recording::load(path("segmented")).hash());
}

TEST_F(Library, AnErrorIsTheLineAndTheCodeOfTheProgram) {
  const auto as_the_program = [](const std::string& arguments, const auto& call) {
    program(arguments);
    try {
      call();
      ADD_FAILURE() << "no error: " << arguments;
    } catch (const Error& error) {
      EXPECT_EQ("turncal: " + std::string(error.what()) + "\n", text_of(path("errors")));
      EXPECT_EQ(error.exit_code(), WEXITSTATUS(last)) << arguments;
    }
  };
  std::ofstream(path("no.conf")) << "N01 = 1\n";
  std::ofstream(path("level.seq")) << "format = 1\nname = level\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n"
                                      "  initial H 0 P 0 R 0\n  align 4000\n  dwell 4000\n";
  program("run --dry-run --quiet --capture-only --unit OTHER --sequence level.seq --out other");
  program("calibrate run --out of_run");
  fs::current_path(*folder);
  const Recording other = Recording::load("other");
  as_the_program("calibrate none --out x", [] { Recording::load("none"); });
  as_the_program("apply other --parameters no.conf --out x.csv", [] { Parameters::read("no.conf"); });
  as_the_program("calibrate other --out x", [&] { calibrate(other); });
  as_the_program("apply other --parameters of_run/parameters.conf --out x.csv",
                 [&] { apply(other, Parameters::read("of_run/parameters.conf")); });
  as_the_program("diagnose other --holdout run --out x",
                 [&] { diagnose(other, {.holdouts = {Recording::load("run")}}); });
  as_the_program("predict --arw 0 --sequence none", [] { predict({"none"}, {.arw_deg_per_rt_h = 0.0}); });
  EXPECT_THROW(calibrate(std::span<const Recording>{}), Error);
  EXPECT_THROW(calibrate(other, {.method = "guess"}), Error);
}

TEST_F(Library, TwoThreadsGetWhatOneGets) {
  const Recording recording = Recording::load(path("run"));
  const auto all = [&] {
    const CalibrateOptions at{.time_utc = "2026-01-31T12:00:00Z"};
    const Calibration calibration = calibrate(recording, at);
    return calibration.parameters.text() + apply(recording, calibration.parameters).hash() + allan(recording).csv +
           diagnose(recording, {.time_utc = at.time_utc}).text + predict({sequences + "short_demo.seq"}).report.text();
  };
  std::string one, two;
  std::thread beside([&] { two = all(); });
  one = all();
  beside.join();
  EXPECT_EQ(one, two);
  EXPECT_EQ(one, all());
}

}  // namespace
}  // namespace turncal
