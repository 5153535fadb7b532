#include "imu_io/frames/frame_decoder.h"

#include <cmath>

namespace turncal {
namespace {

constexpr int strays_for_restart = 3;
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

FrameDecoder::FrameDecoder(const FrameDescription& frame)
    : scanner_(frame),
      weak_(frame.check.weak()),
      step_(frame.variants.front().counter ? frame.variants.front().counter->step : 1.0),
      modulus_(frame.variants.front().counter ? frame.variants.front().counter->modulus : 0.0),
      state_{tracker_of(frame), {}, false, std::numeric_limits<float>::quiet_NaN(), 0},
      before_(state_) {
  for (const FrameVariant& from : frame.variants) {
    Variant variant;
    variant.length = from.length;
    for (std::size_t i = 0; i < 6; ++i) {
      const FrameTriad& triad = i < 3 ? from.gyro : from.accel;
      const std::size_t axis = i % 3;
      const auto place = static_cast<std::size_t>(triad.from[axis]);
      Element& element = variant.element[i];
      element.field = FieldCodec(triad.element[place]);
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
      any_cumulative_ = any_cumulative_ || element.cumulative;
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
    variants_.push_back(std::move(variant));
  }
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
  restarted_ = false;
  ready_count_ = ready_given_ = 0;
  state_.tracker.rejoin();
  state_.has_base = false;
}

FrameDecoder::Next FrameDecoder::next(ImuSample& sample) {
  for (;;) {
    if (ready_given_ < ready_count_) {
      sample = ready_[ready_given_++];
      ++samples_;
      if (sample.flags != 0) ++invalid_;
      return Next::sample;
    }
    ready_count_ = ready_given_ = 0;
    if (restarted_) return Next::restarted;
    ScannedFrame scanned;
    if (!scanner_.next(scanned)) return Next::more;
    take(scanned);
  }
}

bool FrameDecoder::read_values(const Variant& variant, const std::byte* frame, ImuSample& sample) const {
  for (std::size_t i = 0; i < 6; ++i) {
    const Element& element = variant.element[i];
    double& value = i < 3 ? sample.gyro[i] : sample.accel[i - 3];
    if (element.cumulative) {
      const std::uint64_t now = element.field.bits_of(frame);
      if (element.modulus != 0 && now >= element.modulus) return false;
      value = element.factor * cumulative_step(now, state_.base[i], element.modulus);
      if (!state_.has_base) value = 0.0;
      value += 0.0;
      continue;  // across a gap it may be anything
    } else {
      const double raw = element.field.number(frame);
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
      case CounterOutcome::duplicate: ++duplicates_; return;
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
  if (strays_in_row_ >= strays_for_restart) restarted_ = true;
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
    for (std::size_t i = 0; i < 6; ++i) state_.base[i] = variant.element[i].field.bits_of(frame);
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
  if (waiting_) {
    waiting_has_sample_ = !no_base;
    waiting_sample_ = sample;
  } else if (!no_base) {
    emit(sample);
  }
}

void FrameDecoder::emit(const ImuSample& sample) { ready_[ready_count_++] = sample; }

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
