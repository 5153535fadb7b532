// A queue for the writes and displays of a run, so that the loop that watches the table never waits for a disk or a terminal.
//
// The queue is bounded. One thread (the loop) posts; a thread of the queue does the jobs in order. The loop takes no lock and makes no call
// that can block: it posts, keeps watching, and asks whether a job is done. The loop itself judges a queue that is full or a job that takes
// longer than the limit (StationRun: storage_failed, the table is stopped first).
//
// By::caller does every job within post(): in simulated time, which stands still meanwhile, so that runs are reproducible. The caller then
// has to check whether it is stuck.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <semaphore>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

// Starts a thread that takes no signals. They go to the loop or the command, and end its waits.
std::jthread start_without_signals(std::function<void()> work);

class BackgroundQueue {
 public:
  enum class By { caller, thread };
  static constexpr double answer_limit_s = 10.0;  // wall time; a disk that has to spin up takes less
  static constexpr std::size_t capacity = 4096;   // jobs

  explicit BackgroundQueue(By by, double limit_s = answer_limit_s);
  ~BackgroundQueue();  // waits until everything is done
  BackgroundQueue(const BackgroundQueue&) = delete;
  BackgroundQueue& operator=(const BackgroundQueue&) = delete;

  // Returns false, and does not take the job, when the queue is full. Only one thread may post.
  bool post(std::function<void()> job);
  std::uint64_t posted() const { return posted_.load(std::memory_order_relaxed); }
  bool done(std::uint64_t count) const { return done_.load(std::memory_order_acquire) >= count; }
  std::uint64_t pending() const { return posted() - done_.load(std::memory_order_acquire); }
  bool stuck() const;  // the present job takes longer than the limit
  // Returns an error when the queue is stuck or a job threw; the loop polls it. No job is done after one that threw, so that what is
  // written has no holes.
  Status status() const;
  // Waits until all jobs are done, but no longer than the limit for each. Returns false when the queue is stuck.
  bool drain() const;
  static void wait_a_little();  // 0.2 ms

 private:
  void work();

  const double limit_s_;
  // A ring: slot n % capacity belongs to the poster until n is posted, then to the worker.
  std::vector<std::function<void()>> jobs_;
  std::atomic<std::uint64_t> posted_{0}, done_{0};
  std::atomic<double> busy_since_s_{0.0};  // monotonic clock; 0: idle
  std::atomic<bool> ends_{false}, threw_{false};
  std::string thrown_;  // its text; written before threw_
  std::jthread thread_;
};

// Limits the time of writes that are in no queue, while no table moves: if its scope lasts longer than the limit, a thread of its own calls
// `hangs`, which has to end the program, because nobody can be told while the disk does not answer.
class StorageLimit {
 public:
  // Time for several writes in a row, and for a database that another process may hold for 10 s.
  static constexpr double together_s = 3.0 * BackgroundQueue::answer_limit_s;
  explicit StorageLimit(std::function<void()> hangs, double limit_s = together_s);
  StorageLimit(std::function<bool()> passed, std::function<void()> hangs);  // `passed` is polled ten times a second
  ~StorageLimit() { done_.release(); }                                      // within the limit
  StorageLimit(const StorageLimit&) = delete;
  StorageLimit& operator=(const StorageLimit&) = delete;

 private:
  std::binary_semaphore done_{0};
  std::jthread thread_;
};

// A write that was posted to a queue. If the queue did not take it, it counts as done at once, with an error.
class PendingWrite {
 public:
  PendingWrite(BackgroundQueue& queue, std::function<Status()> write)
      : queue_(&queue), status_(std::make_shared<Status>(device_error("it was not written"))) {
    if (!queue.post([status = status_, write = std::move(write)] { *status = write(); }))
      *status_ = device_error("more waits to be written than can be held: the disk is too slow");
    else
      ticket_ = queue.posted();
  }
  bool done() const { return queue_->done(ticket_); }
  Status status() const {  // REQUIRES done()
    const Status of_all = queue_->status();
    return of_all ? *status_ : of_all;
  }

 private:
  BackgroundQueue* queue_;
  std::shared_ptr<Status> status_;  // outlives a caller that no longer waits
  std::uint64_t ticket_ = 0;
};

// Passes events on to an observer that may block, through a queue. Snapshots are skipped while others wait; nothing else is.
class BackgroundObserver : public RunObserver {
 public:
  BackgroundObserver(RunObserver& observer, BackgroundQueue& queue) : observer_(observer), queue_(queue) {}
  void on_transition(const TransitionRecord& record) override {
    queue_.post([&observer = observer_, record] { observer.on_transition(record); });
  }
  void on_dropout(const Dropout& dropout) override {
    queue_.post([&observer = observer_, dropout] { observer.on_dropout(dropout); });
  }
  void on_progress(const RunSnapshot& snapshot) override {
    if (queue_.pending() < most_waiting)
      queue_.post([&observer = observer_, snapshot] { observer.on_progress(snapshot); });
  }

 private:
  static constexpr std::uint64_t most_waiting = 16;
  RunObserver& observer_;
  BackgroundQueue& queue_;
};

}  // namespace turncal
