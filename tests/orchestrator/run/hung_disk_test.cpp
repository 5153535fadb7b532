// A disk that hangs holds up nothing but what is written: the table is watched and stopped as always, and nothing is lost when it answers
// again. How late a stop goes out meanwhile: tests/study/study_stops.cpp.
#include "tests/test.h"

#include <thread>

#include "tests/orchestrator/hanging_station.h"

namespace turncal {
namespace {

class Entering : public RunObserver {
 public:
  void on_transition(const TransitionRecord& record) override {
    if (on_entering && record.to != record.from) on_entering(record.to);
  }
  void on_progress(const RunSnapshot&) override {}
  std::function<void(RunState)> on_entering;
};

struct WallStation : HangingStation {
  explicit WallStation(double limit_s) : HangingStation(false, limit_s) {
    station.motion.deadline_margin_s = 2000.0;  // 20 s of the wall clock: the machine may be busy
  }
  RunOutcome run() { return HangingStation::run(watcher); }
  // When the state is entered the disk begins to hang, before that is written; `then` may do more.
  void hang_in(RunState state, std::function<void()> then = {}) {
    watcher.on_entering = [this, state, then](RunState entered) {
      if (entered != state || hung_s != 0.0) return;
      hung_s = monotonic_s();
      table.asked_s = hung_s;
      disk.hangs = true;
      if (then) then();
    };
  }
  Entering watcher;
  double hung_s = 0.0;
};

// In the states that wait for the disk next: the move must not begin, the dwell must not count, before it answers.
class HungDisk : public testing::TestWithParam<RunState> {};

TEST_P(HungDisk, IsAFaultAfterItsLimitAndTheTableIsStoppedFirst) {
  WallStation s(0.3);
  s.hang_in(GetParam());
  const RunOutcome outcome = s.run();
  EXPECT_TRUE(outcome.storage_hangs);
  s.disk.hangs = false;
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(outcome.error.kind, ErrorKind::device);
  EXPECT_SAYS(outcome.error.message, "the disk has not answered for 0.3 s");
  EXPECT_SAYS(outcome.error.message, "its drives are off");
  EXPECT_GT(s.table.stop_s - s.hung_s, 0.2);
}

TEST_P(HungDisk, ThatAnswersAgainCostsNoSample) {
  WallStation s(10.0);
  std::thread helper;
  s.hang_in(GetParam(), [&] {
    helper = std::thread([&] {
      pause_ms(150.0);
      s.disk.hangs = false;
    });
  });
  const RunOutcome outcome = s.run();
  helper.join();
  EXPECT_EQ(outcome.state, RunState::done) << outcome.error.message;
  EXPECT_FALSE(outcome.storage_hangs);
  EXPECT_EQ(s.sink.missing, 0u);
  EXPECT_EQ(s.sink.next, outcome.units.front().next_sample);
}
TEST_P(HungDisk, ThatHasNoMemoryToWriteIsAFaultLikeAnother) {
  WallStation s(10.0);
  s.hang_in(GetParam(), [&] {
    s.disk.throws = true;
    s.disk.hangs = false;
  });
  const RunOutcome outcome = s.run();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_EQ(outcome.error.kind, ErrorKind::device);
  EXPECT_SAYS(outcome.error.message, "could not be written: std::bad_alloc");
  EXPECT_SAYS(outcome.error.message, "its drives are off");
  EXPECT_EQ(s.sink.missing, 0u);  // the recording ends where the disk did
}

INSTANTIATE_TEST_SUITE_P(In, HungDisk,
                         testing::Values(RunState::homing, RunState::moving, RunState::settling, RunState::dwelling),
                         [](const auto& which) { return std::string(to_string(which.param)); });

// The journal's word is awaited for ever here, and an axis begins to turn.
TEST(HungDiskWatch, AnAxisThatTurnsByItselfIsStopped) {
  WallStation s(100.0);
  std::thread helper;
  s.hang_in(RunState::dwelling, [&] {
    helper = std::thread([&] {
      pause_ms(100.0);  // the dwell is over, and its record waits
      s.table.turn_by_itself = true;
      while (s.table.abort_s == 0.0) pause_ms(1.0);
      s.disk.hangs = false;
    });
  });
  const RunOutcome outcome = s.run();
  helper.join();
  EXPECT_EQ(outcome.state, RunState::failed);
  EXPECT_SAYS(outcome.error.message, "moves although nothing sent it");
}

TEST(StorageLimit, IsHeardOfOnlyWhereItIsPassed) {
  std::atomic<int> heard{0};
  {
    const StorageLimit limit([&] { ++heard; }, 60.0);
  }
  EXPECT_EQ(heard, 0);
  const StorageLimit limit([&] { ++heard; }, 0.01);
  for (const Deadline patience(5.0); heard == 0 && !patience.passed();) pause_ms(1.0);
  EXPECT_EQ(heard, 1);
}

// As it is in a dry run.
TEST(StorageLimit, EndsWhoeverIsStuckInAQueueOfItsOwn) {
  BackgroundQueue queue(BackgroundQueue::By::caller, 0.05);
  std::atomic<bool> heard{false};
  const StorageLimit limit([&] { return queue.stuck(); }, [&] { heard = true; });
  queue.post([&] {
    for (const Deadline patience(5.0); !heard && !patience.passed();) pause_ms(1.0);
  });
  EXPECT_TRUE(heard);
  EXPECT_FALSE(queue.stuck());
}

TEST(BackgroundQueue, DoesItsJobsInOrderAndTellsWhenItIsFullOrStuck) {
  Hook hook;
  std::vector<int> done;
  {
    BackgroundQueue queue(BackgroundQueue::By::thread, 0.05);
    hook.hangs = true;
    queue.post([&] { hook.pass(); });
    std::size_t taken = 1;
    while (queue.post([&done, taken] { done.push_back(int(taken)); })) ++taken;
    EXPECT_EQ(taken, BackgroundQueue::capacity);
    EXPECT_FALSE(queue.drain());
    EXPECT_TRUE(queue.stuck());
    hook.hangs = false;
    for (const Deadline patience(5.0); queue.stuck() && !patience.passed();) pause_ms(1.0);
    EXPECT_TRUE(queue.drain());
    EXPECT_FALSE(queue.stuck());
    queue.post([&] { done.push_back(-1); });
  }
  ASSERT_EQ(done.size(), BackgroundQueue::capacity);
  for (std::size_t i = 0; i + 1 < done.size(); ++i) ASSERT_EQ(done[i], int(i) + 1);
  EXPECT_EQ(done.back(), -1);  // what is posted last is done before the queue goes
}

}  // namespace
}  // namespace turncal
