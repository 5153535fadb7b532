// Standard output that holds nobody up, and prefixes of lines.
#include "imu_io/base/console.h"
#include "tests/test.h"

namespace turncal {
namespace {

double steady_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

// A pipe of one page, full, with nobody at its end.
class FullPipe : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(::pipe(ends_), 0);
    ASSERT_GE(::fcntl(ends_[1], F_SETPIPE_SZ, 4096), 4096);
    ::fcntl(ends_[0], F_SETFL, O_NONBLOCK);
    const std::string page(4096, '.');
    ASSERT_EQ(::write(ends_[1], page.data(), page.size()), 4096);
  }
  void TearDown() override {
    ::close(ends_[0]);
    ::close(ends_[1]);
  }
  std::string all_read() const {
    std::string text(8192, '\0');
    const ssize_t size = ::read(ends_[0], text.data(), text.size());
    text.resize(size > 0 ? std::size_t(size) : 0);
    return text;
  }
  int ends_[2] = {-1, -1};
  std::ostringstream stream_;
};

TEST_F(FullPipe, HoldsNobodyUpAndShowsAllWhenItIsRead) {
  const Console console(stream_, ends_[1]);
  const Unhindered now;
  const double began_s = steady_s();
  stream_ << "one" << std::endl << "two\n" << std::flush;
  EXPECT_LT(steady_s() - began_s, 1.0);
  EXPECT_EQ(all_read(), std::string(4096, '.'));
  stream_ << "three" << std::endl;
  EXPECT_EQ(all_read(), "one\ntwo\nthree\n");
  EXPECT_EQ(::fcntl(ends_[1], F_GETFL) & O_NONBLOCK, 0) << "others have this descriptor, too";
}

TEST_F(FullPipe, KeepsSoMuchAndSaysWhatIsLeftOut) {
  const Console console(stream_, ends_[1]);
  const Unhindered now;
  const std::string line = std::string(1023, 'x') + "\n";
  for (std::size_t k = 0; k < Console::most_kept / line.size() + 2; ++k) stream_ << line << std::flush;
  std::string text;
  for (std::string part = all_read(); !part.empty(); part = all_read()) {
    text += part;
    stream_ << std::flush;
  }
  EXPECT_EQ(text.size(), 4096 + Console::most_kept);
  stream_ << "more" << std::endl;
  EXPECT_EQ(all_read(), "[2 lines were not printed]\nmore\n");
}

TEST_F(FullPipe, IsWaitedForAfterwardsButNotForEver) {
  { const Unhindered before; }
  const double began_s = steady_s();
  {
    const Console console(stream_, ends_[1]);
    stream_ << "the end" << std::endl;
    EXPECT_NEAR(steady_s() - began_s, Console::last_wait_s, 1.0);
    stream_ << "really" << std::endl;
  }
  EXPECT_LT(steady_s() - began_s, Console::last_wait_s + 1.0) << "once, not with each line";
}

TEST(Console, SaysWhatCannotBeWritten) {
  const int full = ::open("/dev/full", O_WRONLY);
  ASSERT_GE(full, 0);
  std::ostringstream stream;
  {
    const Console console(stream, full);
    stream << "word" << std::flush;
    EXPECT_TRUE(stream.bad());
  }
  ::close(full);
}

TEST(LinePrefix, StandsInFrontOfEveryLineWhileItLives) {
  std::ostringstream out;
  out << "before\n";
  {
    const LinePrefix marked(out, "[t] ");
    out << "one\n\nt"
        << "wo" << std::endl
        << "three";
    out << ", and on\n";
    const LinePrefix inner(out, "[b] ");
    out << "x\n";
  }
  out << "after\n";
  EXPECT_EQ(out.str(), "before\n[t] one\n[t]\n[t] two\n[t] three, and on\n[t] [b] x\nafter\n");
  std::ostringstream drawn;
  const LinePrefix marked(drawn, "[t] ");
  drawn << "\r10 %"
        << "\r11 %"
        << "\x1b[2K\r"
        << "done\n";
  EXPECT_EQ(drawn.str(), "\r[t] 10 %\r[t] 11 %\x1b[2K\r[t] done\n") << "a line drawn again has it again";
}

TEST(LinePrefix, NoneChangesNothingAndAFailureStays) {
  std::ostringstream out;
  {
    const LinePrefix none(out, "");
    out << "x\n";
  }
  EXPECT_EQ(out.str(), "x\n");
  std::ostringstream broken;
  {
    const LinePrefix marked(broken, "[t] ");
    broken.setstate(std::ios::badbit);
  }
  EXPECT_TRUE(broken.bad());
}

}  // namespace
}  // namespace turncal
