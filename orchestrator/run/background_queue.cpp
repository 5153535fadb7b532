#include "orchestrator/run/background_queue.h"

#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <chrono>
#include <exception>

#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"

namespace turncal {

std::jthread start_without_signals(std::function<void()> work) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  std::jthread thread(std::move(work));
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  return thread;
}

BackgroundQueue::BackgroundQueue(By by, double limit_s) : limit_s_(limit_s) {
  if (by == By::caller) return;
  jobs_.resize(capacity);
  thread_ = start_without_signals([this] { work(); });
}

BackgroundQueue::~BackgroundQueue() {
  if (!thread_.joinable()) return;
  while (pending() > 0) wait_a_little();
  ends_ = true;
  post([] {});  // wakes the thread
}

bool BackgroundQueue::post(std::function<void()> job) {
  if (!thread_.joinable()) {
    busy_since_s_ = monotonic_s();
    job();
    busy_since_s_ = 0.0;
    return true;
  }
  const std::uint64_t number = posted();
  if (pending() >= capacity) return false;
  jobs_[number % capacity] = std::move(job);
  posted_.store(number + 1, std::memory_order_release);
  posted_.notify_one();
  return true;
}

void BackgroundQueue::work() {
  for (std::uint64_t number = 0; !ends_; ++number) {
    posted_.wait(number, std::memory_order_acquire);
    const std::function<void()> job = std::exchange(jobs_[number % capacity], nullptr);
    busy_since_s_ = monotonic_s();
    try {
      if (!threw_) job();
    } catch (const std::exception& error) {
      thrown_ = error.what();
      threw_ = true;
    }
    busy_since_s_ = 0.0;
    done_.store(number + 1, std::memory_order_release);
  }
}

bool BackgroundQueue::stuck() const {
  const double since_s = busy_since_s_;
  return since_s > 0.0 && monotonic_s() - since_s > limit_s_;
}

Status BackgroundQueue::status() const {
  if (threw_) return device_error("could not be written: " + thrown_);
  if (stuck()) return device_error("the disk has not answered for " + format_number(limit_s_) + " s");
  return {};
}

bool BackgroundQueue::drain() const {
  while (pending() > 0 && !stuck()) wait_a_little();
  return pending() == 0;
}

StorageLimit::StorageLimit(std::function<bool()> passed, std::function<void()> hangs)
    : thread_(start_without_signals([this, passed = std::move(passed), hangs = std::move(hangs)] {
        while (!done_.try_acquire_for(std::chrono::milliseconds(100)))
          if (passed()) return hangs();
      })) {}

StorageLimit::StorageLimit(std::function<void()> hangs, double limit_s)
    : StorageLimit([from_s = monotonic_s(), limit_s] { return monotonic_s() - from_s > limit_s; }, std::move(hangs)) {}

void BackgroundQueue::wait_a_little() {
  const timespec pause{0, 200'000};
  ::nanosleep(&pause, nullptr);
}

}  // namespace turncal
