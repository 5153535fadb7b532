// Archives of recordings on several threads and in chunks. What is made of them: tests/golden/archives.sh.
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

// Two units of a station.
class Archive : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    for (const std::string unit : {"SN1", "SN2"})
      Program::made("archive/" + unit, quick_run("archive/" + unit, "--no-diagnosis --quiet", unit));
  }
  ProgramResult recalibrate(const Arguments& more) const {
    return run(Arguments{"recalibrate", path("archive"), "--no-diagnosis"} + more);
  }
  std::set<std::string> below(const std::string& folder) const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path(folder)))
      names.insert(std::filesystem::relative(entry.path(), path(folder)).string());
    return names;
  }
};

TEST_F(Archive, CountsCopiesOnceAlsoWhenTwoThreadsTakeThemAtOnce) {
  std::filesystem::create_directories(path("copies"));
  for (const char* name : {"a.tcr", "b.tcr", "c.tcr", "d.tcr"})
    std::filesystem::copy_file(path("archive/SN1/recording.tcr"), path(std::string("copies/") + name));
  const ProgramResult result = ends("recalibrate copies --no-diagnosis --out store", 0);
  EXPECT_SAYS(result.out, "1 done, 3 already done");
}

TEST_F(Archive, ChunksAndTwoAtOnceMakeTheSame) {
  ASSERT_EQ(recalibrate("--out store").code, 0);
  for (const char* k : {"0", "1"}) ASSERT_EQ(recalibrate({"--out", path("chunks"), "--chunk", k, "2"}).code, 0);
  const auto made = [this](const std::string& store) {
    std::set<std::string> names = below(store);
    std::erase_if(names, [](const std::string& name) { return name.ends_with(".csv"); });
    return names;
  };
  EXPECT_EQ(made("chunks"), made("store"));

  const std::vector<std::string> command = {"recalibrate", path("archive"), "--no-diagnosis", "--out", path("both")};
  const pid_t one = start(command), other = start(command);
  EXPECT_EQ(finish(one).code, 0);
  EXPECT_EQ(finish(other).code, 0);
  EXPECT_EQ(made("both"), made("store"));
}

}  // namespace
}  // namespace turncal
