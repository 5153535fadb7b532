// `turncal convert`: what it writes and what it refuses.

#include "imu_io/recordings/parameter_file.h"
#include "tests/imu_io/recording_samples.h"
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Convert : public Program {
 protected:
  void SetUp() override {
    Program::SetUp();
    ASSERT_OK(write_parameter_file(test::make_parameter_file(), path("parameters.conf")));
  }
};

TEST_F(Convert, WritesAllFormsOrNone) {
  for (int again = 0; again < 2; ++again)  // the second time over what is there
    EXPECT_EQ(run("convert parameters.conf --header c.h --binary c.bin --yaml c.yaml").code, 0);
  expect_refused("convert parameters.conf --header x.h --yaml nowhere/x.yaml", "nowhere/x.yaml");
}

TEST_F(Convert, RefusesWhatItCannotUse) {
  expect_refused("convert parameters.conf", "expected --header, --binary or --yaml");
  expect_refused("convert nothing.conf --yaml c.yaml", "nothing.conf");
  const std::string before = file_text(folder_ / "parameters.conf");
  for (const char* form : {"--header", "--binary", "--yaml"})
    expect_refused({"convert", "parameters.conf", form, "parameters.conf"},
                   "expected another file than the parameter file");
  write("other.conf", "something = else\n");
  expect_refused("convert parameters.conf --yaml other.conf", "holds something else");
  EXPECT_EQ(file_text(folder_ / "parameters.conf"), before);
  expect_refused("convert parameters.conf --header c.h --yaml ./c.h", "--yaml ./c.h: expected another");
  expect_refused("convert parameters.conf --binary nowhere/c.bin", "nowhere/c.bin");
}

}  // namespace
}  // namespace turncal
