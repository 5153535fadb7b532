// What a FrameDecoder does after a silence that the unit's counter alone cannot explain: samples are held until their arrival tells.
#include <algorithm>
#include <cmath>

#include "imu_io/frames/frame_decoder.h"

namespace turncal {
namespace {

constexpr double off_time_s = 0.05;     // of a sample that adapters and a busy host do not explain
constexpr double pace_window_s = 0.25;  // after two of them that are alike samples come at the unit's pace
constexpr double catching_up = 0.02;    // a line that catches up delivers at least so much faster than the unit sends
constexpr double quiet_s = 0.1;         // a line that is empty for so long holds nothing back

}  // namespace

// Its counter alone says that the sample is from long before it came.
bool FrameDecoder::is_unsure(const PlacedCounter& placed) const {
  const CounterTracker& tracker = state_.tracker;
  if (placed.outcome == CounterOutcome::stray || placed.outcome == CounterOutcome::first) return false;
  if (!tracker.has_last() || tracker.rejoining() || tracker.wrap_s() >= narrow_wrap_s || placed.shortest == 0)
    return false;
  return placed.late_s > std::min(off_time_s, tracker.slack_s(0.0)) + 2e-4 * placed.late_s;
}

void FrameDecoder::begin_hold(const PlacedCounter& placed, double raw) {
  Hold& hold = state_.hold;
  if (hold.active) {  // another silence before the first was decided
    const double late_s = held_late_s();
    if (hold.from_zero || !is_whole_wraps(late_s)) {
      hold.jump = placed.counter;  // what is late is late by both
      return;
    }
    release(wraps_in(late_s));
  }
  hold = {};
  hold.active = true;
  hold.from_counter = state_.tracker.last_counter();
  hold.from_s = state_.tracker.latest_arrival_s();
  hold.jump = hold.from_counter + placed.ahead;
  hold.from_zero = raw < step_ && placed.ahead > 1;
  state_.base.known = false;  // a cumulative field may span what was lost
  hold.window_end_s = arrival_.latest_s + pace_window_s;
  hold.window_late_s = hold.before_late_s = std::numeric_limits<double>::infinity();
}

void FrameDecoder::judge_hold() {
  Hold& hold = state_.hold;
  hold.last_s = arrival_.latest_s;
  const double late_s = held_late_s();
  hold.window_late_s = std::min(hold.window_late_s, late_s);
  if (late_s <= std::min(off_time_s, state_.tracker.slack_s(0.0))) {
    if (hold.from_zero) {
      decide(late_s);
    } else {
      release(0);
    }
  } else if (ready_.size() >= most_held) {
    decide(std::numeric_limits<double>::quiet_NaN());
  } else if (arrival_.latest_s >= hold.window_end_s) {
    const double window_late_s = hold.window_late_s;
    if (window_late_s > hold.before_late_s - catching_up * pace_window_s) {
      decide(window_late_s);
      return;
    }
    hold.before_late_s = window_late_s;
    hold.window_late_s = std::numeric_limits<double>::infinity();
    hold.window_end_s = arrival_.latest_s + pace_window_s;
  }
}

void FrameDecoder::idle(double now_s) {
  const Hold& hold = state_.hold;
  if (!hold.active || now_s - hold.last_s < std::max(quiet_s, 4.0 * period_s_)) return;
  decide(held_late_s());
}

// Of the last held sample, if nothing was lost.
double FrameDecoder::held_late_s() const {
  const Hold& hold = state_.hold;
  return hold.last_s - hold.from_s - period_s_ * static_cast<double>(state_.tracker.last_counter() - hold.from_counter);
}

std::int64_t FrameDecoder::wraps_in(double late_s) const {
  return std::max<std::int64_t>(std::llround(late_s / state_.tracker.wrap_s()), 0);
}

bool FrameDecoder::is_whole_wraps(double late_s) const {
  const double wrap_s = state_.tracker.wrap_s();
  const double off_s = std::abs(late_s - static_cast<double>(wraps_in(late_s)) * wrap_s);
  return off_s <= std::min(0.25 * wrap_s, off_time_s + 2e-4 * (state_.hold.last_s - state_.hold.from_s));
}

void FrameDecoder::decide(double late_s) {
  if (std::isfinite(late_s) && is_whole_wraps(late_s) && !state_.hold.from_zero) {
    release(wraps_in(late_s));
    return;
  }
  restart("the unit was silent, and its counter cannot tell what was lost,");
}

void FrameDecoder::release(std::int64_t wraps) {
  const std::int64_t lost = wraps * state_.tracker.wrap_samples();
  for (std::size_t i = ready_free_; i < ready_.size(); ++i) {
    if (ready_[i].counter >= state_.hold.jump) ready_[i].counter += lost;
  }
  if (waiting_ && waiting_sample_.counter >= state_.hold.jump) waiting_sample_.counter += lost;
  if (lost > 0) {
    state_.tracker.shift(lost);
    state_.lost += static_cast<std::uint64_t>(lost);
  }
  state_.hold.active = false;
  ready_free_ = ready_.size();
}

}  // namespace turncal
