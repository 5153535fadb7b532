// Unwraps a unit's counter. The counter is the time. The host's time of arrival only shows how often the counter may have
// wrapped, and whether a jump is plausible.
//
// A frame arrived within [earliest, latest] of the host's monotonic clock: the wait for it ended at `latest`, and the line was
// known to be empty at `earliest`. (A delayed reader finds many frames at once. The interval is then long and excludes nothing.)
// Let n be the number of samples since the last frame; the counter gives n mod wrap:
//   n is n mod wrap, unless at least n P + slack has certainly passed: then it is the n nearest to the time that has passed
//   n = 1 is always accepted; n = 0 is a duplicate
//   n > 1 is a gap if that much time may have passed (+ slack); otherwise the frame is a stray
// P is the period. The slack allows for delays of adapters (16 ms) and of a busy host: a quarter of a wrap, at most 0.5 s,
// plus 200 ppm of the time that has passed.
// A gap of more wraps than the two clocks can resolve is still a gap; its length is then the best estimate.
#pragma once

#include <cstdint>

namespace turncal {

struct Arrival {
  double earliest_s = 0.0;
  double latest_s = 0.0;
};

enum class CounterOutcome { first, next, gap, duplicate, stray };

struct PlacedCounter {
  CounterOutcome outcome = CounterOutcome::stray;
  std::int64_t counter = 0;  // unwrapped; the last one's for a duplicate, undefined for a stray
  std::int64_t ahead = 0;    // samples since the last accepted one
  // The samples since the last frame by the counter alone, without the wraps added from the time (a whole wrap instead of 0), and
  // the least delay of the arrival behind that count.
  std::int64_t shortest = 0;
  double late_s = 0.0;
};

class CounterTracker {
 public:
  // step and modulus are in the counter's units, and modulus / step is a whole number. modulus 0: the unit has no counter.
  CounterTracker(double period_s, double step, double modulus);

  // Places a raw counter value without changing the state. REQUIRES: raw is not NaN.
  PlacedCounter place(double raw, const Arrival& arrival) const;
  // For a unit without a counter: a frame is the next one, unless skipped bytes (as a number of frames) or a silence show a gap.
  PlacedCounter place_uncounted(double frames_skipped, const Arrival& arrival) const;
  // Makes a placed frame the last one.
  void accept(const PlacedCounter& placed, double raw, const Arrival& arrival);
  // To call after the link was down, when the unit may have been off. An implausible counter is then a gap as long as the time that has passed.
  void rejoin() { rejoining_ = has_last_; }

  // Adds samples that were found to be lost before the last frame.
  void shift(std::int64_t samples) { last_counter_ += samples; }

  std::int64_t wrap_samples() const { return std::int64_t(wrap_); }
  // The delay of a sample that does not count as a loss.
  double slack_s(double elapsed_s) const;
  double latest_arrival_s() const { return last_arrival_.latest_s; }
  bool rejoining() const { return rejoining_; }
  bool has_last() const { return has_last_; }
  std::int64_t last_counter() const { return last_counter_; }
  double wrap_s() const { return wrap_ * period_s_; }

 private:
  double period_s_;
  double step_;
  double modulus_;
  double wrap_;  // samples
  bool has_last_ = false;
  bool rejoining_ = false;
  std::int64_t last_counter_ = 0;
  double last_raw_ = 0.0;
  Arrival last_arrival_;
};

}  // namespace turncal
