#include "imu_io/frames/frame_decoder.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr int strays_for_restart = 3;

CounterTracker tracker_of(const FrameDescription& frame) {
  const auto& counter = frame.variants.front().counter;
  if (!counter) return CounterTracker(frame.sample_period_s, 1.0, 0.0);
  return CounterTracker(frame.sample_period_s, counter->step, counter->modulus);
}

}  // namespace

FrameDecoder::FrameDecoder(const FrameDescription& frame)
    : scanner_(frame),
      split_(frame.split),
      weak_(frame.check.weak()),
      step_(frame.variants.front().counter ? frame.variants.front().counter->step : 1.0),
      modulus_(frame.variants.front().counter ? frame.variants.front().counter->modulus : 0.0),
      state_{tracker_of(frame), {}, std::numeric_limits<float>::quiet_NaN(), 0, {}, {}, false},
      before_(state_),
      period_s_(frame.sample_period_s) {
  const bool may_hold = modulus_ > 0.0 && state_.tracker.wrap_s() < narrow_wrap_s;
  ready_.reserve(may_hold ? most_held + 4 : 4);
  for (const FrameVariant& from : frame.variants) variants_.emplace_back(frame, from);
  if (split_) {
    variants_.push_back(FrameValues::joined(variants_[0], variants_[1]));
    joined_.resize(variants_.back().length());
  }
  any_cumulative_ = variants_.back().any_cumulative();
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
  state_.base.known = false;
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
      decode(scanned);
    } else if (ScannedFrame whole; join(scanned, whole)) {
      decode(whole);
    }
  }
}

bool FrameDecoder::join(const ScannedFrame& scanned, ScannedFrame& whole) {
  const std::size_t part = scanned.variant;
  const std::size_t other = 1 - part;
  const double raw = variants_[part].counter(scanned.data);
  if (part_counter_[part]) ++unusable_;  // stayed alone
  std::copy_n(scanned.data, variants_[part].length(), joined_.data() + (part == 0 ? 0 : variants_[0].length()));
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

void FrameDecoder::decode(const ScannedFrame& scanned) {
  const FrameValues& values = variants_[scanned.variant];
  ImuSample sample;
  idle(arrival_.earliest_s);
  for (int attempt = 0; attempt < 2; ++attempt) {
    sample = ImuSample{};
    if (!values.read(scanned.data, state_.base, sample)) {
      ++unusable_;
      return;
    }
    double raw = 0.0;
    PlacedCounter placed;
    if (values.has_counter()) {
      raw = values.counter(scanned.data);
      placed = state_.tracker.place(std::isnan(raw) ? -1.0 : raw, arrival_);
      if (is_unsure(placed)) {
        placed = {CounterOutcome::gap, state_.tracker.last_counter() + placed.shortest, placed.shortest,
                  placed.shortest, placed.late_s};
        if (placed.shortest == 1) placed.outcome = CounterOutcome::next;
      }
    } else {
      placed = state_.tracker.place_uncounted(
          static_cast<double>(scanned.skipped_before) / static_cast<double>(values.length()), arrival_);
    }
    const bool follows =
        placed.outcome == CounterOutcome::next && (values.has_counter() || scanned.skipped_before == 0);
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
          same = same && now == (values.cumulative(i) ? 0.0 : then);
        }
        if (same || !state_.has_last || waiting_) return;
        sample.counter = placed.counter;
        sample.temperature_c = state_.temperature_c;
        emit(sample);
        return;
      }
      case CounterOutcome::stray: handle_stray(raw); return;
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
    if (values.has_counter() && placed.outcome != CounterOutcome::first) {
      if (is_unsure(placed)) {
        begin_hold(placed, raw);
        placed.counter = state_.tracker.last_counter() + placed.ahead;
      } else if (state_.hold.active && placed.outcome == CounterOutcome::gap &&
                 placed.late_s < -0.5 * period_s_ * static_cast<double>(placed.ahead)) {
        state_.hold.jump = placed.counter;  // in the backlog itself: what held it back ran over there
      }
    }
    believe(placed, raw, values, scanned.data, sample);
    return;
  }
}

// Frames of which the counter cannot be true. They are compared with each other: a unit that began anew goes on counting.
void FrameDecoder::handle_stray(double raw) {
  ++strays_;
  double steps = (raw - stray_raw_) / step_;
  if (steps < 0.0) steps += modulus_ / step_;
  strays_in_row_ = strays_in_row_ > 0 && std::abs(steps - 1.0) <= 0.25 ? strays_in_row_ + 1 : 1;
  stray_raw_ = raw;
  if (strays_in_row_ >= strays_for_restart) restart("the unit's counter started again, or ran ahead of the time,");
}

void FrameDecoder::restart(const std::string& reason) {
  ready_.resize(ready_free_);
  state_.hold.active = false;
  restarted_ = true;
  restart_reason_ = reason;
}

void FrameDecoder::believe(const PlacedCounter& placed, double raw, const FrameValues& values, const std::byte* frame,
                           ImuSample& sample) {
  state_.tracker.accept(placed, raw, arrival_);
  const bool no_base =
      any_cumulative_ && (!state_.base.known || placed.outcome != CounterOutcome::next || !values.fits(sample));
  if (placed.ahead > 1) state_.lost += static_cast<std::uint64_t>(placed.ahead - 1);
  if (no_base && placed.outcome != CounterOutcome::first) ++state_.lost;
  if (any_cumulative_) values.keep(frame, state_.base);
  state_.temperature_c = values.temperature_c(frame).value_or(state_.temperature_c);
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
