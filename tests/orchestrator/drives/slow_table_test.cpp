// A table that is slow to answer, and the units beside it: they are read while it is awaited.

#include "tests/orchestrator/drives/modbus_run.h"
#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

constexpr double answer_s = 0.15;

template <class Plan>
auto slowly() {
  return [](const auto&, Plan& plan) {
    for (auto& piece : plan.pieces) piece.delay_s = answer_s;
  };
}

// A pseudo-terminal holds 0.1 s of a unit at 1 kHz.
template <class Table>
void expect_looks_while_it_waits(Table& table) {
  int looks = 0;
  table.driver.set_meanwhile([&] { ++looks; });
  for (const Axis axis : all_axes) EXPECT_OK(table.driver.status(axis));
  EXPECT_GT(looks, 3 * answer_s / 0.03);
  table.driver.set_meanwhile(nullptr);
  looks = 0;
  EXPECT_OK(table.driver.status(Axis::pitch));
  EXPECT_EQ(looks, 0);
}

TEST(SlowTable, UnitsAreReadWhileItsAnswerIsAwaited) {
  FaultTable<TwinStation> modbus(map_of(plain_map_text("tcp")));
  modbus.station.disturb(slowly<AnswerPlan>());
  expect_looks_while_it_waits(modbus);
  FaultTable<DialectStation> dialect(shipped_dialect("three_axis_dollar", true));
  dialect.station.disturb(slowly<AnswerPlan>());
  expect_looks_while_it_waits(dialect);
}

struct HookedTable : FrontTable {
  using FrontTable::FrontTable;
  void set_meanwhile(std::function<void()> meanwhile) override { hook = std::move(meanwhile); }
  std::function<void()> hook;
};

// A run lets its units be read by the driver, and takes the hook away when it is over.
TEST(SlowTable, ARunReadsItsUnitsMeanwhile) {
  RigStation s(two_steps_text);
  HookedTable table(s.devices.table);
  int hooked = 0;
  table.on_status = [&] {
    if (!table.hook) return Status();
    ++hooked;
    table.hook();
    return Status();
  };
  ended(s.run_on(table), RunState::done);
  EXPECT_GT(hooked, 100);
  EXPECT_FALSE(table.hook);
  EXPECT_EQ(s.sink.sample_count, two_steps_samples);
}

// The rig's unit as behind a line: what it sends while time passes is there when it is read.
class BufferedImu : public FrontImu {
 public:
  using FrontImu::FrontImu;
  void pass(double seconds) {
    std::array<ImuSample, 64> block;
    const Result<std::size_t> got = imu_.read(block, seconds);
    if (got) buffer_.insert(buffer_.end(), block.begin(), block.begin() + std::ptrdiff_t(*got));
  }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override {
    if (buffer_.empty()) return timeout_s > 0.0 ? imu_.read(out, timeout_s) : Result<std::size_t>(std::size_t{0});
    const std::size_t count = std::min(out.size(), buffer_.size());
    std::copy_n(buffer_.begin(), count, out.begin());
    buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(count));
    return count;
  }

 private:
  std::vector<ImuSample> buffer_;
};

// Its answers take longer than a dwell may: the samples are there, and the unit is not called slow.
TEST(SlowTable, ALateAnswerIsNotTheUnitsFault) {
  RigStation s(two_steps_text);
  BufferedImu imu(s.devices.imu);
  HookedTable table(s.devices.table);
  bool lasts = false;
  table.on_status = [&] {
    for (int i = 0; table.hook && lasts && i < 1000; ++i) {  // 10 s, a look away every 10 ms
      imu.pass(0.01);
      table.hook();
    }
    return Status();
  };
  s.watcher.on_tick = [&](const RunSnapshot& now) { lasts = now.state == RunState::dwelling; };
  const RunOutcome outcome = ended(s.run_with(imu, table), RunState::done);
  EXPECT_EQ(outcome.units[0].lost_samples, 0u);
}

}  // namespace
}  // namespace turncal
