// `recalibrate` on a cluster: scripts/fleet-slurm starts one and runs these; without it they skip.
#include <sys/resource.h>

#include <thread>

#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

constexpr int slurm_units = 8;

class OnSlurm : public Program {
 protected:
  static void SetUpTestSuite() {
    if (!control_) return;
    archive_ = "/tmp/turncal_slurm_archive_" + std::to_string(::getpid());
    for (int k = 1; k <= slurm_units; ++k) {
      const std::string command = std::string(TURNCAL_BINARY) + " run --dry-run --quiet --no-diagnosis --sequence " +
                                  TURNCAL_SOURCE_DIR "/sequences/forty_minutes.seq --unit SN" + std::to_string(k) +
                                  " --out " + archive_ + "/SN" + std::to_string(k) + " > /dev/null";
      ASSERT_EQ(std::system(command.c_str()), 0) << command;
    }
    std::ofstream(archive_ + "/broken.tcr") << "no recording";
  }
  static void TearDownTestSuite() {
    if (control_) std::filesystem::remove_all(archive_);
  }
  void SetUp() override {
    if (!control_) GTEST_SKIP() << "needs a cluster: scripts/fleet-slurm";
    Program::SetUp();
    ASSERT_EQ(control("start"), 0);
  }
  static int control(const std::string& words) { return std::system((std::string(control_) + " " + words).c_str()); }
  static void wait_for_tasks() {
    for (int k = 0; k < 200 && control("running") != 0; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));  // in the middle
  }
  std::vector<std::string> command(const std::string& store) const {
    return {"recalibrate", archive_, "--out", path(store), "--engine", "slurm", "--chunks", "3", "--as-version", "v"};
  }
  // Every recording once, nothing half-made, nothing left over.
  void expect_whole(const std::string& store) const {
    int folders = 0;
    std::set<std::string> serials;
    for (const auto& entry : std::filesystem::directory_iterator(path(store) + "/v")) {
      if (!entry.is_directory() || entry.path().filename().string().starts_with('.')) continue;
      ++folders;
      std::set<std::string> names;
      for (const auto& file : std::filesystem::directory_iterator(entry)) names.insert(file.path().filename().string());
      EXPECT_EQ(names, (std::set<std::string>{"parameters.conf", "statistics.tcs", "diagnosis.conf"}));
      const std::string text = file_text(entry.path() / "parameters.conf");
      serials.insert(text.substr(text.find("unit_serial"), 20));
    }
    EXPECT_EQ(folders, slurm_units);
    EXPECT_EQ(serials.size(), std::size_t(slurm_units));
    const std::string table = file_text(path(store) + "/v/recordings.csv");
    EXPECT_EQ(std::ranges::count(table, '\n'), 1 + slurm_units + 1) << table;
    EXPECT_SAYS(table, "\nunreadable," + archive_ + "/broken.tcr,");
    EXPECT_TRUE(std::filesystem::is_empty(path(store) + "/.jobs"));
  }

  static inline const char* control_ = std::getenv("SLURM_CONF") ? std::getenv("TURNCAL_TEST_CONTROL") : nullptr;
  static inline std::string archive_;
};

TEST_F(OnSlurm, DoesEachRecordingOnceAndSaysHowFarItIs) {
  const ProgramResult result = ends(command("store"), 0);
  EXPECT_SAYS(result.out, "8 done, 0 already done, 0 cannot be calibrated, 1 cannot be read");
  EXPECT_SAYS(result.out, "RUNNING");
  expect_whole("store");
  const ProgramResult again = run(command("store"));
  EXPECT_SAYS(again.out, "0 done, 8 already done");
  expect_whole("store");
}

TEST_F(OnSlurm, SubmitsChunksAgainThatWereKilledOrCancelled) {
  const pid_t pid = start(command("store"));
  wait_for_tasks();
  EXPECT_EQ(control("kill-task"), 0);
  wait_for_tasks();
  EXPECT_EQ(std::system("scancel --state=RUNNING --user=$(id -un)"), 0);
  const ProgramResult result = finish(pid);
  EXPECT_EQ(result.code, 0) << result.err << result.out;
  expect_whole("store");
}

TEST_F(OnSlurm, GoesOnWhenANodeDies) {
  const pid_t pid = start(command("store"));
  wait_for_tasks();
  EXPECT_EQ(control("kill-node n1"), 0);
  const ProgramResult result = finish(pid);
  EXPECT_EQ(result.code, 0) << result.err << result.out;
  expect_whole("store");
}

TEST_F(OnSlurm, TwoSubmissionsAtOnceMakeOneStore) {
  const pid_t one = start(command("store")), other = start(command("store"));
  EXPECT_EQ(finish(one).code, 0);
  EXPECT_EQ(finish(other).code, 0);
  expect_whole("store");
}

// Slurm gives its tasks the limits of whoever submits: files above 20 kB cannot be written, as on a disk that is full.
TEST_F(OnSlurm, SaysWhichChunksCannotWriteAndGoesOnLater) {
  rlimit limit{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &limit), 0);
  rlimit small = limit;
  small.rlim_cur = 20000;
  ::setrlimit(RLIMIT_FSIZE, &small);
  const pid_t pid = start(command("store"));
  ::setrlimit(RLIMIT_FSIZE, &limit);
  const ProgramResult result = finish(pid);
  EXPECT_EQ(result.code, 50) << result.out;
  EXPECT_EQ(result.err_lines(), 1) << result.err;
  EXPECT_SAYS(result.err, "3 of 3 chunks failed 3 times");
  for (const auto& entry : std::filesystem::directory_iterator(path("store/v")))
    EXPECT_TRUE(entry.path().filename().string().starts_with('.') || !entry.is_directory()) << entry.path();
  EXPECT_EQ(run(command("store")).code, 0);
  std::filesystem::remove_all(path("store/.jobs"));  // of the first: its logs
  std::filesystem::create_directories(path("store/.jobs"));
  expect_whole("store");
}

}  // namespace
}  // namespace turncal
