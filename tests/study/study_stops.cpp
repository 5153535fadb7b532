// How late a stop goes out while what a run writes and shows hangs: study_stops [--runs N] [--jobs N] [--seed N] [--real-time].
//
// Each run is a StationRun in the wall clock's time (100 times faster), with the two queues of a live run, on a table and a unit that are
// simulated here. At a drawn moment some of disk (journal, recording, log), terminal, page and civil clock begin to hang, all at once or none;
// soon after a stop is asked for as a signal handler does, and in half of the runs a second one. In half of them the table
// runs on after the stop, so that the fastest stop has to follow by itself.
//
// Printed, by what hangs and by the state: the times in ms from the request to the stop, from the second request to the fastest stop, and of
// the fastest stop that followed by itself beyond the time that the braking stop is given. Exit 1 where one is beyond 100 ms.
#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "orchestrator/devices/live_devices.h"
#include "tests/orchestrator/hanging_station.h"

namespace turncal {
namespace {

constexpr double limit_ms = 100.0;

class HangingObserver : public RunObserver {
 public:
  explicit HangingObserver(const Hook& hook) : hook_(hook) {}
  void on_transition(const TransitionRecord&) override { hook_.pass(); }
  void on_progress(const RunSnapshot&) override { hook_.pass(); }

 private:
  const Hook& hook_;
};

class Both : public RunObserver {
 public:
  explicit Both(std::vector<RunObserver*> all) : all_(std::move(all)) {}
  void on_transition(const TransitionRecord& record) override {
    for (RunObserver* one : all_) one->on_transition(record);
    state = record.to;
    calibrating = calibrating || record.to == RunState::calibrating;
  }
  void on_progress(const RunSnapshot& at) override {
    for (RunObserver* one : all_) one->on_progress(at);
  }
  std::atomic<RunState> state{RunState::idle};
  std::atomic<bool> calibrating{false};

 private:
  std::vector<RunObserver*> all_;
};

struct Latency {
  std::string hangs, state;
  double stop_ms = -1.0, second_ms = -1.0, escalation_ms = -1.0;  // -1: not asked
};

Latency one_run(std::uint64_t seed, bool real_time) {
  std::mt19937_64 random(seed);
  const auto draw = [&random](double from, double to) { return std::uniform_real_distribution(from, to)(random); };
  const bool deaf = random() % 2 == 0, twice = random() % 2 == 0;
  Hook terminal_hook, page_hook;
  HangingObserver terminal(terminal_hook), page(page_hook);
  HangingStation s(deaf, BackgroundQueue::answer_limit_s);
  HangingObserver log(s.disk);
  DrawnTable& table = s.table;
  BackgroundQueue display(BackgroundQueue::By::thread);
  BackgroundObserver kept_log(log, s.storage), shown_terminal(terminal, display), shown_page(page, display);
  Both observers({&kept_log, &shown_terminal, &shown_page});
  const double began_s = monotonic_s();
  std::atomic<bool> over{false};
  std::thread run([&] {
    std::optional<RealTime> first;
    if (real_time) first.emplace();
    s.run(observers);
    over = true;
  });
  const auto ask = [&] {
    ++s.stop_requests;
    ::pthread_kill(run.native_handle(), SIGUSR1);
  };
  const double hang_ms = draw(0.0, 250.0);
  pause_ms(std::max(0.0, hang_ms - 1e3 * (monotonic_s() - began_s)));
  Latency latency;
  const std::uint64_t what = random() % 6;  // none, each, all
  const auto hang = [&](std::uint64_t which, const char* name, auto&& begin) {
    if (what != which && what != 5) return;
    begin();
    latency.hangs = what == 5 ? "all" : name;
  };
  latency.hangs = "nothing";
  hang(1, "disk", [&] { s.disk.hangs = true; });
  hang(2, "terminal", [&] { terminal_hook.hangs = true; });
  hang(3, "page", [&] { page_hook.hangs = true; });
  hang(4, "clock", [&] { s.clock.step_s = draw(-1e4, 1e4); });
  pause_ms(draw(0.0, 30.0));
  std::optional<RealTime> asker;  // a signal waits for no processor
  if (real_time) asker.emplace();
  const RunState at = observers.state;
  latency.state = to_string(at);
  table.asked_s = monotonic_s();
  ask();
  const double asked_s = table.asked_s;
  double second_s = 0.0;
  if (twice) {
    pause_ms(draw(0.0, 20.0));
    if (table.abort_s == 0.0) second_s = monotonic_s();
    ask();
  }
  asker.reset();
  while (!over && (table.stop_s == 0.0 || table.abort_s == 0.0) && monotonic_s() - asked_s < 5.0) pause_ms(0.2);
  pause_ms(2.0);
  s.disk.hangs = terminal_hook.hangs = page_hook.hangs = false;
  run.join();
  // A run that had switched its drives off, or not yet on, has nothing to stop.
  const bool live = live_states.contains(at) && !observers.calibrating;
  if (!live) latency.state += ", nothing to stop";
  const double stop_s = table.stop_s, abort_s = table.abort_s;
  // Until the request came in, the run may have got to its own end: parking has sent its stop before.
  if (live && stop_s > 0.0) latency.stop_ms = 1e3 * (stop_s - asked_s);
  if (live && stop_s == 0.0) latency.stop_ms = 1e3 * ((abort_s > 0.0 ? abort_s : monotonic_s()) - asked_s);
  if (live && second_s > 0.0 && abort_s > 0.0) latency.second_ms = 1e3 * (abort_s - second_s);
  double ramp_s = 0.0;
  for (const PlannedItem& item : s.plan().items)
    if (item.kind == SequenceItem::Kind::move) ramp_s = std::max(ramp_s, item.rate_degps / item.acceleration_degps2);
  const double brake_s = (2.0 * ramp_s + s.station.motion.stall_s) / speed_up;
  if (live && deaf && !twice && stop_s > 0.0 && abort_s > 0.0)
    latency.escalation_ms = 1e3 * (abort_s - stop_s - brake_s);
  return latency;
}

struct Spread {
  std::vector<double> ms;
  void add(double value) {
    if (value >= 0.0) ms.push_back(value);
  }
  std::string text() {
    if (ms.empty()) return "            -             ";
    std::ranges::sort(ms);
    char line[80];
    std::snprintf(line, sizeof line, "%6zu %7.2f %7.2f %7.2f", ms.size(), ms[ms.size() / 2],
                  ms[std::size_t(0.999 * double(ms.size() - 1))], ms.back());
    return line;
  }
};

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  std::size_t runs = 10000, jobs = 4;
  std::uint64_t seed = 1;
  bool real_time = false;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--real-time") {
      real_time = true;
    } else if (i + 1 < argc && (word == "--runs" || word == "--jobs" || word == "--seed")) {
      const std::uint64_t value = std::strtoull(argv[++i], nullptr, 10);
      (word == "--runs" ? runs : word == "--jobs" ? jobs : seed) = value;
    } else {
      std::fprintf(stderr, "study_stops: %s is not understood\n", argv[i]);
      return 1;
    }
  }
  struct sigaction ends_a_wait {};
  ends_a_wait.sa_handler = [](int) {};
  ::sigaction(SIGUSR1, &ends_a_wait, nullptr);
  std::mutex mutex;
  std::map<std::string, std::array<Spread, 3>> by_hang, by_state;
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> threads;
  for (std::size_t job = 0; job < jobs; ++job) {
    threads.emplace_back([&] {
      for (std::size_t i = next++; i < runs; i = next++) {
        const Latency one = one_run(seed * 1'000'003 + i, real_time);
        const std::lock_guard lock(mutex);
        for (std::array<Spread, 3>* spread : {&by_hang[one.hangs], &by_state[one.state], &by_hang["together"]}) {
          (*spread)[0].add(one.stop_ms);
          (*spread)[1].add(one.second_ms);
          (*spread)[2].add(one.escalation_ms);
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  std::printf("ms: runs, median, 99.9 %%, worst    %-30s %-30s %s\n", "request to stop", "second request to fastest",
              "fastest by itself, beyond its time");
  double worst = 0.0;
  for (auto* table : {&by_hang, &by_state}) {
    for (auto& [name, spreads] : *table) {
      std::printf("%-32s", name.c_str());
      for (Spread& spread : spreads) {
        std::printf("  %s", spread.text().c_str());
        if (!spread.ms.empty()) worst = std::max(worst, spread.ms.back());
      }
      std::printf("\n");
    }
    std::printf("\n");
  }
  std::printf("worst %.2f ms of %zu runs: %s\n", worst, runs, worst <= limit_ms ? "in time" : "TOO LATE");
  return worst <= limit_ms ? 0 : 1;
}
