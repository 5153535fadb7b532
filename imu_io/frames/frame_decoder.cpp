#include "imu_io/frames/frame_decoder.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr int strays_for_restart = 3;
constexpr std::size_t most_held = 32768;  // samples
constexpr double narrow_wrap_s = 30.0;    // a counter that wraps later than this tells every silence a run survives
constexpr double off_time_s = 0.05;       // of a sample that adapters and a busy host do not explain
constexpr double pace_window_s = 0.25;    // after two of them that are alike samples come at the unit's pace
constexpr double catching_up = 0.02;      // a line that catches up delivers at least so much faster than the unit sends
constexpr double quiet_s = 0.1;           // a line that is empty for so long holds nothing back
constexpr double largest_pulses = 2147483647.0;  // what a recording holds

CounterTracker tracker_of(const FrameDescription& frame) {
  const auto& counter = frame.variants.front().counter;
  if (!counter) return CounterTracker(frame.sample_period_s, 1.0, 0.0);
  return CounterTracker(frame.sample_period_s, counter->step, counter->modulus);
}

// (now - before) modulo the modulus, as the nearest to 0.
double cumulative_step(std::uint64_t now, std::uint64_t before, std::uint64_t modulus) {
  if (modulus == 0) return static_cast<double>(static_cast<std::int64_t>(now - before));
  const std::uint64_t up = now >= before ? now - before : modulus - (before - now);
  if (up <= modulus / 2) return static_cast<double>(up);
  return -static_cast<double>(modulus - up);
}

}  // namespace

FrameDecoder::Variant FrameDecoder::variant_of(const FrameDescription& frame, const FrameVariant& from) {
  Variant variant;
  variant.length = from.length;
  for (std::size_t i = 0; i < 6; ++i) {
    const FrameTriad& triad = i < 3 ? from.gyro : from.accel;
    const std::size_t axis = i % 3;
    const auto place = static_cast<std::size_t>(triad.from[axis]);
    Element& element = variant.element[i];
    element.field = FieldCodec(triad.element[place]);
    element.has_down = triad.down.has_value();
    if (triad.down) element.down = FieldCodec((*triad.down)[place]);
    element.zero = triad.zero[place];
    element.factor =
        triad.sign[axis] * triad.scale[place] * (triad.kind == FieldKind::rate ? frame.sample_period_s : 1.0);
    element.low = triad.low;
    element.high = triad.high;
    element.cumulative = triad.kind == FieldKind::cumulative;
    element.modulus = triad.modulus;
    if (element.cumulative && element.modulus == 0 && element.field.bits() < 64) {
      element.modulus = std::uint64_t{1} << element.field.bits();
    }
    element.pulses = triad.pulses;
  }
  if (from.temperature) {
    for (const FrameField& field : from.temperature->places) variant.temperature.emplace_back(field);
    variant.temperature_zero = from.temperature->zero;
    variant.temperature_scale = from.temperature->scale;
    variant.multiplexed = from.temperature->when.has_value();
    variant.when = from.temperature->when.value_or(0);
  }
  if (from.multiplexer) variant.multiplexer = FieldCodec(*from.multiplexer);
  variant.has_counter = from.counter.has_value();
  if (from.counter) variant.counter = FieldCodec(from.counter->field);
  for (const FrameStatus& status : from.status) {
    variant.status.push_back({FieldCodec(status.field), status.mask, status.good});
  }
  return variant;
}

FrameDecoder::Variant FrameDecoder::joined(const Variant& gyro, const Variant& accel) {
  Variant both = gyro;
  const std::size_t by = gyro.length;
  both.length += accel.length;
  for (std::size_t i = 3; i < 6; ++i) {
    both.element[i] = accel.element[i];
    both.element[i].field = accel.element[i].field.shifted(by);
    both.element[i].down = accel.element[i].down.shifted(by);
  }
  for (const Status& status : accel.status) both.status.push_back({status.field.shifted(by), status.mask, status.good});
  if (gyro.temperature.empty()) {
    for (const FieldCodec& field : accel.temperature) both.temperature.push_back(field.shifted(by));
    both.temperature_zero = accel.temperature_zero;
    both.temperature_scale = accel.temperature_scale;
    both.multiplexed = accel.multiplexed;
    both.multiplexer = accel.multiplexer.shifted(by);
    both.when = accel.when;
  }
  return both;
}

FrameDecoder::FrameDecoder(const FrameDescription& frame)
    : scanner_(frame),
      split_(frame.split),
      weak_(frame.check.weak()),
      step_(frame.variants.front().counter ? frame.variants.front().counter->step : 1.0),
      modulus_(frame.variants.front().counter ? frame.variants.front().counter->modulus : 0.0),
      state_{tracker_of(frame), {}, false, std::numeric_limits<float>::quiet_NaN(), 0, {}, {}, false},
      before_(state_),
      period_s_(frame.sample_period_s) {
  const bool may_hold = modulus_ > 0.0 && state_.tracker.wrap_s() < narrow_wrap_s;
  ready_.reserve(may_hold ? most_held + 4 : 4);
  for (const FrameVariant& from : frame.variants) variants_.push_back(variant_of(frame, from));
  if (split_) {
    variants_.push_back(joined(variants_[0], variants_[1]));
    joined_.resize(variants_.back().length);
  }
  for (const Element& element : variants_.back().element) any_cumulative_ = any_cumulative_ || element.cumulative;
}

void FrameDecoder::added(std::size_t count, const Arrival& arrival) {
  scanner_.added(count);
  arrival_ = arrival;
}

void FrameDecoder::rejoin() {
  scanner_.restart();
  if (waiting_) state_ = before_;
  waiting_ = false;
  strays_in_row_ = 0;
  part_counter_ = {};
  restarted_ = false;
  ready_.clear();
  ready_given_ = ready_free_ = 0;
  state_.hold.active = false;
  state_.has_last = false;
  state_.tracker.rejoin();
  state_.has_base = false;
}

FrameDecoder::Next FrameDecoder::next(ImuSample& sample) {
  for (;;) {
    if (ready_given_ < ready_free_) {
      sample = ready_[ready_given_++];
      ++samples_;
      if (sample.flags != 0) ++invalid_;
      return Next::sample;
    }
    if (!state_.hold.active) {
      ready_.clear();
      ready_given_ = ready_free_ = 0;
    }
    if (restarted_) return Next::restarted;
    ScannedFrame scanned;
    if (!scanner_.next(scanned)) return Next::more;
    if (!split_) {
      take(scanned);
    } else if (ScannedFrame whole; join(scanned, whole)) {
      take(whole);
    }
  }
}

bool FrameDecoder::join(const ScannedFrame& scanned, ScannedFrame& whole) {
  const std::size_t part = scanned.variant;
  const std::size_t other = 1 - part;
  const double raw = variants_[part].counter.number(scanned.data);
  if (part_counter_[part]) ++unusable_;  // stayed alone
  std::copy_n(scanned.data, variants_[part].length, joined_.data() + (part == 0 ? 0 : variants_[0].length));
  part_counter_[part] = raw;
  if (!part_counter_[other]) return false;
  if (*part_counter_[other] != raw) {
    ++unusable_;
    part_counter_[other].reset();
    return false;
  }
  part_counter_ = {};
  whole = {joined_.data(), 2, scanned.skipped_before};
  return true;
}

bool FrameDecoder::read_values(const Variant& variant, const std::byte* frame, ImuSample& sample) const {
  for (std::size_t i = 0; i < 6; ++i) {
    const Element& element = variant.element[i];
    double& value = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
    if (element.cumulative) {
      const std::uint64_t now = element.field.bits_of(frame);
      if (element.modulus != 0 && now >= element.modulus) return false;
      double steps = cumulative_step(now, state_.base[i], element.modulus);
      if (element.has_down) {
        const std::uint64_t down = element.down.bits_of(frame);
        if (element.modulus != 0 && down >= element.modulus) return false;
        steps -= cumulative_step(down, state_.base[6 + i], element.modulus);
      }
      value = element.factor * steps;
      if (!state_.has_base) value = 0.0;
      value += 0.0;
      continue;  // across a gap it may be anything
    } else {
      double raw = element.field.number(frame);
      if (element.has_down) raw -= element.down.number(frame);
      if (raw < element.low || raw > element.high) sample.flags |= sample_flag_invalid;
      value = element.factor * (raw - element.zero);
    }
    value += 0.0;                             // -0 of a sign turned round
    if (!std::isfinite(value)) return false;  // of floats
    if (element.pulses && (std::abs(value) > largest_pulses || value != std::nearbyint(value))) return false;
  }
  for (const Status& status : variant.status) {
    if ((status.field.bits_of(frame) & status.mask) != status.good) sample.flags |= sample_flag_invalid;
  }
  return true;
}

void FrameDecoder::take(const ScannedFrame& scanned) {
  const Variant& variant = variants_[scanned.variant];
  ImuSample sample;
  idle(arrival_.earliest_s);
  for (int attempt = 0; attempt < 2; ++attempt) {
    sample = ImuSample{};
    if (!read_values(variant, scanned.data, sample)) {
      ++unusable_;
      return;
    }
    double raw = 0.0;
    PlacedCounter placed;
    if (variant.has_counter) {
      raw = variant.counter.number(scanned.data);
      placed = state_.tracker.place(std::isnan(raw) ? -1.0 : raw, arrival_);
      if (is_unsure(placed)) {
        placed = {CounterOutcome::gap, state_.tracker.last_counter() + placed.shortest, placed.shortest,
                  placed.shortest, placed.late_s};
        if (placed.shortest == 1) placed.outcome = CounterOutcome::next;
      }
    } else {
      placed = state_.tracker.place_uncounted(
          static_cast<double>(scanned.skipped_before) / static_cast<double>(variant.length), arrival_);
    }
    const bool follows = placed.outcome == CounterOutcome::next && (variant.has_counter || scanned.skipped_before == 0);
    if (waiting_ && !follows) {
      // The frame before stands alone: not believed, and this one is judged without it.
      state_ = before_;
      waiting_ = false;
      ++strays_;
      continue;
    }
    switch (placed.outcome) {
      case CounterOutcome::duplicate: {
        ++duplicates_;
        bool same = true;
        for (std::size_t i = 0; i < 6; ++i) {
          const double now = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
          const double then = i < 3 ? state_.last.gyro[i] : state_.last.accel[i - 3];
          same = same && now == (variant.element[i].cumulative ? 0.0 : then);
        }
        if (same || !state_.has_last || waiting_) return;
        sample.counter = placed.counter;
        sample.temperature_c = state_.temperature_c;
        emit(sample);
        return;
      }
      case CounterOutcome::stray: take_stray(raw); return;
      default: break;
    }
    if (waiting_) {
      waiting_ = false;
      if (waiting_has_sample_) emit(waiting_sample_);
    } else if (weak_ && !follows) {
      before_ = state_;
      waiting_ = true;
    }
    strays_in_row_ = 0;
    if (variant.has_counter && placed.outcome != CounterOutcome::first) {
      if (is_unsure(placed)) {
        begin_hold(placed, raw);
        placed.counter = state_.tracker.last_counter() + placed.ahead;
      } else if (state_.hold.active && placed.outcome == CounterOutcome::gap &&
                 placed.late_s < -0.5 * period_s_ * static_cast<double>(placed.ahead)) {
        state_.hold.jump = placed.counter;  // in the backlog itself: what held it back ran over there
      }
    }
    believe(placed, raw, variant, scanned.data, sample);
    return;
  }
}

// Frames of which the counter cannot be true. They are compared with each other: a unit that began anew goes on counting.
void FrameDecoder::take_stray(double raw) {
  ++strays_;
  double steps = (raw - stray_raw_) / step_;
  if (steps < 0.0) steps += modulus_ / step_;
  strays_in_row_ = strays_in_row_ > 0 && std::abs(steps - 1.0) <= 0.25 ? strays_in_row_ + 1 : 1;
  stray_raw_ = raw;
  if (strays_in_row_ >= strays_for_restart) restart("the unit's counter started again");
}

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
  state_.has_base = false;  // a cumulative field may span what was lost
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

void FrameDecoder::restart(const std::string& reason) {
  ready_.resize(ready_free_);
  state_.hold.active = false;
  restarted_ = true;
  restart_reason_ = reason;
}

void FrameDecoder::believe(const PlacedCounter& placed, double raw, const Variant& variant, const std::byte* frame,
                           ImuSample& sample) {
  state_.tracker.accept(placed, raw, arrival_);
  bool no_base = any_cumulative_ && (!state_.has_base || placed.outcome != CounterOutcome::next);
  for (std::size_t i = 0; any_cumulative_ && i < 6; ++i) {
    const double value = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
    no_base = no_base || (variant.element[i].pulses && std::abs(value) > largest_pulses);
  }
  if (placed.ahead > 1) state_.lost += static_cast<std::uint64_t>(placed.ahead - 1);
  if (no_base && placed.outcome != CounterOutcome::first) ++state_.lost;
  if (any_cumulative_) {
    for (std::size_t i = 0; i < 6; ++i) {
      state_.base[i] = variant.element[i].field.bits_of(frame);
      if (variant.element[i].has_down) state_.base[6 + i] = variant.element[i].down.bits_of(frame);
    }
    state_.has_base = true;
  }
  if (!variant.temperature.empty() && (!variant.multiplexed || variant.multiplexer.bits_of(frame) == variant.when)) {
    double sum = 0.0;
    for (const FieldCodec& field : variant.temperature) sum += field.number(frame);
    const double mean = sum / static_cast<double>(variant.temperature.size());
    const auto value = static_cast<float>((mean - variant.temperature_zero) * variant.temperature_scale);
    state_.temperature_c = std::isfinite(value) ? value : std::numeric_limits<float>::quiet_NaN();
  }
  sample.counter = placed.counter;
  sample.temperature_c = state_.temperature_c;
  state_.last = sample;
  state_.has_last = !no_base;
  if (waiting_) {
    waiting_has_sample_ = !no_base;
    waiting_sample_ = sample;
  } else if (!no_base) {
    emit(sample);
  }
  if (state_.hold.active) judge_hold();
}

void FrameDecoder::emit(const ImuSample& sample) {
  ready_.push_back(sample);
  if (!state_.hold.active) ready_free_ = ready_.size();
}

ImuLinkCounters FrameDecoder::counters() const {
  ImuLinkCounters result;
  result.samples = samples_;
  result.lost_samples = waiting_ ? before_.lost : state_.lost;
  result.duplicates = duplicates_;
  result.bad_frames = scanner_.counters().bad_frames + unusable_;
  result.resyncs = scanner_.counters().resyncs;
  return result;
}

}  // namespace turncal
