#include "imu_io/frames/counter_tracker.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double off_grid = 0.25;        // of a step: the permitted jitter of a time stamp
constexpr double most_samples = 0x1p53;  // keeps counters exact in a double

}  // namespace

CounterTracker::CounterTracker(double period_s, double step, double modulus)
    : period_s_(period_s),
      step_(step),
      modulus_(modulus),
      wrap_(modulus > 0.0 ? std::nearbyint(modulus / step) : 1.0) {}

double CounterTracker::slack_s(double elapsed_s) const {
  return std::min(0.25 * wrap_s(), 0.5) + 2e-4 * std::max(elapsed_s, 0.0);
}

PlacedCounter CounterTracker::place(double raw, const Arrival& arrival) const {
  if (!(raw >= 0.0 && raw < modulus_)) return {};
  if (!has_last_) return {CounterOutcome::first, std::int64_t(std::nearbyint(raw / step_)), 0};
  double steps = (raw - last_raw_) / step_;
  if (steps < -off_grid) steps += modulus_ / step_;
  double n = std::nearbyint(steps);
  const bool on_grid = std::abs(steps - n) <= off_grid;
  if (n >= wrap_) n = 0.0;
  const double least_s = arrival.earliest_s - last_arrival_.latest_s;
  const double most_s = arrival.latest_s - last_arrival_.earliest_s;
  const double slack = slack_s(most_s);
  const double shortest = n < 1.0 ? wrap_ : n;
  if (n * period_s_ < least_s - slack) {
    const double wraps = std::round((0.5 * (least_s + most_s) / period_s_ - n) / wrap_);
    const double longer = n + std::max(wraps, 0.0) * wrap_;
    if (longer * period_s_ <= most_s + slack && longer < most_samples) n = longer;
  }
  const bool believable = on_grid && (n <= 1.0 || n * period_s_ <= most_s + slack);
  if (rejoining_ && (!believable || n < 1.0 || n * period_s_ < least_s - slack))
    n = std::clamp(std::round(0.5 * (least_s + most_s) / period_s_), 2.0, most_samples);
  else if (!believable)
    return {};
  const auto ahead = std::int64_t(n);
  const CounterOutcome outcome = ahead == 0   ? CounterOutcome::duplicate
                                 : ahead == 1 ? CounterOutcome::next
                                              : CounterOutcome::gap;
  return {outcome, last_counter_ + ahead, ahead, std::int64_t(shortest), least_s - shortest * period_s_};
}

PlacedCounter CounterTracker::place_uncounted(double frames_skipped, const Arrival& arrival) const {
  if (!has_last_) return {CounterOutcome::first, 0, 0};
  double n = 1.0 + std::nearbyint(std::min(frames_skipped, 1e9));
  // Frames that vanished as a whole show only in the time. Less than 50 ms may be a delay.
  const double least_s = arrival.earliest_s - last_arrival_.latest_s;
  if (least_s - std::max(4.0 * period_s_, 0.05) > n * period_s_)
    n = std::min(std::round(least_s / period_s_), most_samples);
  // At least one sample is missing after the link was down.
  if (rejoining_) n = std::max(n, 2.0);
  const auto ahead = std::int64_t(n);
  return {ahead == 1 ? CounterOutcome::next : CounterOutcome::gap, last_counter_ + ahead, ahead};
}

void CounterTracker::accept(const PlacedCounter& placed, double raw, const Arrival& arrival) {
  has_last_ = true;
  rejoining_ = false;
  last_counter_ = placed.counter;
  last_raw_ = raw;
  last_arrival_ = arrival;
}

}  // namespace turncal
