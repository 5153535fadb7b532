// A table that takes 150 ms an answer, and units at 1 kHz beside it: they are read while it is awaited.

#include <thread>

#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"
#include "imu_io/lines/unit_end.h"
#include "imu_io/units/serial_imu.h"
#include "tests/orchestrator/drives/modbus_run.h"
#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

constexpr double answer_s = 0.15;
constexpr std::size_t unit_count = 3;

// Sends frames at 1 kHz into three pseudo-terminals, in a thread of its own; what nobody reads in time is lost.
class Units {
 public:
  Units() {
    const Result<FrameDescription> found = find_frame("laser_gyro");
    EXPECT_TRUE(found.ok());
    frame_ = *found;
    frame_.sample_period_s = 0.001;
    for (std::size_t i = 0; i < unit_count; ++i) {
      Result<Pty> pty = Pty::create(folder_ / ("unit" + std::to_string(i)));
      EXPECT_TRUE(pty.ok());
      ptys_.push_back(std::move(*pty));
      SerialImuSettings settings;
      settings.device = folder_ / ("unit" + std::to_string(i));
      settings.simulated = true;
      imus.push_back(std::make_unique<SerialImu>(frame_, settings));
      EXPECT_TRUE(imus.back()->open().ok());
    }
    thread_ = std::thread([this] { send(); });
  }
  ~Units() {
    ended_ = true;
    thread_.join();
  }
  void read_all() {
    std::array<ImuSample, 256> block;
    for (const auto& imu : imus) {
      for (;;) {
        const Result<std::size_t> got = good(imu->read(block, 0.0));
        if (*got == 0) break;
      }
    }
  }
  void read_on() {  // for 0.1 s
    for (int i = 0; i < 20; ++i, read_all()) ::usleep(5000);
  }
  std::uint64_t lost() const {
    std::uint64_t all = 0;
    for (const auto& imu : imus) all += imu->counters().lost_samples;
    return all;
  }
  std::uint64_t samples() const {
    std::uint64_t least = ~std::uint64_t{0};
    for (const auto& imu : imus) least = std::min(least, imu->counters().samples);
    return least;
  }
  std::vector<std::unique_ptr<SerialImu>> imus;

 private:
  void send() {
    FrameEncoder encoder(frame_);
    std::vector<std::byte> bytes(encoder.length());
    const double began_s = monotonic_s();
    for (std::int64_t next = 0; !ended_;) {
      const auto due = std::int64_t((monotonic_s() - began_s) * 1000.0);
      for (; next < due; ++next) {
        ImuSample sample;
        sample.counter = next;
        EXPECT_TRUE(encoder.encode(sample, bytes).ok());
        for (Pty& pty : ptys_) static_cast<void>(pty.write_all(bytes, 0.0).ok());  // a full line loses it
      }
      ::usleep(1000);
    }
  }
  TemporaryFolder folder_;
  FrameDescription frame_;
  std::vector<Pty> ptys_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

template <class Plan>
auto slowly() {
  return [](const auto&, Plan& plan) {
    for (auto& piece : plan.pieces) piece.delay_s = answer_s;
  };
}

template <class Table>
void expect_nothing_lost(Table& table) {
  Units units;
  units.read_all();
  std::uint64_t lost_unread = 0;
  for (const bool read_meanwhile : {false, true}) {
    table.driver.set_meanwhile(read_meanwhile ? std::function<void()>([&] { units.read_all(); }) : nullptr);
    units.read_on();  // what was lost before shows in the frames after it
    const std::uint64_t before = units.lost();
    const double began_s = monotonic_s();
    for (int i = 0; i < 6; ++i) {  // 2.7 s and more: beyond what a pseudo-terminal holds
      for (const Axis axis : all_axes) const Result<AxisStatus> now = good(table.driver.status(axis));
    }
    units.read_all();
    EXPECT_GT(monotonic_s() - began_s, 18 * answer_s) << "the table is slow";
    units.read_on();
    if (read_meanwhile) {
      EXPECT_EQ(units.lost() - before, 0u);
    } else {
      lost_unread = units.lost() - before;
    }
  }
  EXPECT_GT(lost_unread, 0u) << "the test would show a loss";
  EXPECT_GT(units.samples(), 1000u);
}

TEST(SlowTable, UnitsAreReadWhileItsAnswerIsAwaited) {
  FaultTable<TwinStation> modbus(map_of(plain_map_text("tcp")));
  modbus.station.disturb(slowly<AnswerPlan>());
  expect_nothing_lost(modbus);
}

TEST(SlowTable, UnitsAreReadWhileADialectIsAwaited) {
  FaultTable<DialectStation> dialect(shipped_dialect("three_axis_dollar", true));
  dialect.station.disturb(slowly<AnswerPlan>());
  expect_nothing_lost(dialect);
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
