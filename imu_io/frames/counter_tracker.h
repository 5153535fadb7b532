// Unwraps a unit's counter. The counter is the time; when the host received a frame only tells how often the counter may have
// wrapped, and whether a jump can be true.
//
// A frame arrived somewhere in [earliest, latest] of the host's monotonic clock: waiting for it ended at `latest`, and the line was
// known to be empty at `earliest`. (A reader that was kept from reading finds many frames at once: then the two lie far apart,
// and nothing is concluded from them.) Let n be the samples since the last frame, of which the counter gives n mod wrap:
//   n is n mod wrap, unless at least n P - slack have surely passed: then the n nearest to the time that has
//   n = 1 is always believed; n = 0 is a duplicate
//   n > 1 is a gap if that much time may have passed (+ slack), else the counter cannot be true: stray
// with P the period and slack a quarter of a wrap, at most 0.5 s, and 200 ppm of the time that has passed: the lateness that
// adapters (16 ms) and a busy host add.
// A gap of more wraps than the clocks' agreement can tell is still a gap; its length is then the best estimate.
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
  std::int64_t counter = 0;  // unwrapped; of a duplicate the last one's; of a stray nothing
  std::int64_t ahead = 0;    // samples since the last accepted one
  // What the counter says by itself, without the wraps that the time added (a whole wrap in place of 0), and how long before the
  // frame's arrival that was at the least.
  std::int64_t shortest = 0;
  double late_s = 0.0;
};

class CounterTracker {
 public:
  // step and modulus in the counter's own units, modulus / step whole. modulus 0: the unit has no counter.
  CounterTracker(double period_s, double step, double modulus);

  // raw must not be NaN. Changes nothing.
  PlacedCounter place(double raw, const Arrival& arrival) const;
  // For a unit without a counter: a frame counts as the next one; bytes thrown away (as a number of frames) and silence are gaps.
  PlacedCounter place_uncounted(double frames_skipped, const Arrival& arrival) const;
  // What place() returned counts from now on.
  void accept(const PlacedCounter& placed, double raw, const Arrival& arrival);
  // The link was down, the unit may have been off: a counter that cannot be true goes on by the time that has passed, with a gap.
  void rejoin() { rejoining_ = has_last_; }

  // So many samples more were lost before the last one.
  void shift(std::int64_t samples) { last_counter_ += samples; }

  std::int64_t wrap_samples() const { return std::int64_t(wrap_); }
  // By how much a sample may be late for other reasons than a loss.
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
