// Writes and displays of a run go through a queue, so that the loop that watches the table never waits for a disk or a terminal.
//
// A queue of bounded length between one thread that posts (the loop) and one of its own that does the jobs in their order. The loop takes
// no lock and makes no call that can block: it posts, goes on watching, and asks whether a job is done. A queue that is full, or a job that
// takes longer than the limit, is judged by the loop (StationRun: storage_failed, the table is stopped first).
//
// By::caller does every job within post(): for simulated time, which stands still meanwhile, so that runs are reproducible. Then the caller
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

// Signals are the loop's, or the command's: one that arrives ends its waits.
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

  // False: the queue is full, and the job is not taken. One thread posts.
  bool post(std::function<void()> job);
  std::uint64_t posted() const { return posted_.load(std::memory_order_relaxed); }
  bool done(std::uint64_t count) const { return done_.load(std::memory_order_acquire) >= count; }
  std::uint64_t pending() const { return posted() - done_.load(std::memory_order_acquire); }
  bool stuck() const;  // the job that is being done takes longer than the limit
  // For the loop to look at: an error when the queue is stuck, or when a job threw. After that no job is done any more, so that what is
  // written has no holes.
  Status status() const;
  // Waits until all is done, no longer than the limit for a job. False: stuck.
  bool drain() const;
  static void wait_a_little();  // 0.2 ms

 private:
  void work();

  const double limit_s_;
  // A ring: slot n % capacity belongs to the poster until n is posted, then to the worker.
  std::vector<std::function<void()>> jobs_;
  std::atomic<std::uint64_t> posted_{0}, done_{0};
  std::atomic<double> busy_since_s_{0.0};  // monotonic; 0: nothing is being done
  std::atomic<bool> ends_{false}, threw_{false};
  std::string thrown_;  // what; written before threw_
  std::jthread thread_;
};

// Of writes that are in no queue, while no table moves: what its scope does may take no longer than the limit, else `hangs` is called, by a
// thread of its own, and has to end the program: whoever waits for a disk that does not answer cannot be told.
class StorageLimit {
 public:
  // Several writes, one after the other, and a database that somebody else may hold for 10 s.
  static constexpr double together_s = 3.0 * BackgroundQueue::answer_limit_s;
  explicit StorageLimit(std::function<void()> hangs, double limit_s = together_s);
  StorageLimit(std::function<bool()> passed, std::function<void()> hangs);  // asked ten times a second
  ~StorageLimit() { done_.release(); }                                      // within the limit
  StorageLimit(const StorageLimit&) = delete;
  StorageLimit& operator=(const StorageLimit&) = delete;

 private:
  std::binary_semaphore done_{0};
  std::jthread thread_;
};

// A write that was handed to a queue. One that the queue could not take is done at once, with an error.
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
  std::shared_ptr<Status> status_;  // outlives whoever waits no longer
  std::uint64_t ticket_ = 0;
};

// An observer that may block: what it is told waits in a queue. Snapshots are left out while others wait, the rest is not.
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
