#include "imu_io/frames/frame_decoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr std::size_t buffer_size = 8192;  // several of the longest frames

}  // namespace

FrameScanner::FrameScanner(const FrameDescription& frame)
    : frame_(frame),
      crc_(frame.check.crc),
      unstuffer_(frame.stuffing),
      lead_(frame.stuffing.kind == StuffingKind::none ? 0 : 1),
      buffer_(buffer_size) {}

std::span<std::byte> FrameScanner::space() {
  if (buffer_.size() - end_ < longest_frame && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return std::span(buffer_).subspan(std::min(end_ + lead_, buffer_.size()));
}

void FrameScanner::added(std::size_t count) {
  assert(count <= buffer_.size() - end_ - lead_);
  end_ += lead_ == 0 ? count : unstuffer_.unstuff(buffer_.data() + end_, count);
}

void FrameScanner::restart() {
  begin_ = end_ = 0;
  unstuffer_.restart();
  in_step_ = false;
  seeking_again_ = false;
  skipped_ = 0;
}

// Compares as many bytes as there are; an incomplete sync is not a wrong one.
bool FrameScanner::sync_at(std::span<const std::byte> remaining) const {
  const std::size_t n = std::min(frame_.sync.size(), remaining.size());
  for (std::size_t i = 0; i < n; ++i)
    if (((remaining[i] ^ frame_.sync[i]) & frame_.sync_mask[i]) != std::byte{0}) return false;
  return true;
}

bool FrameScanner::check_good(std::span<const std::byte> frame) const {
  const FrameCheck& check = frame_.check;
  if (check.kind == CheckKind::none) return true;
  return check.field.bits_at(frame.data() + check_offset(check, frame.size())) == frame_check_value(check, crc_, frame);
}

FrameScanner::Verdict FrameScanner::judge(std::span<const std::byte> remaining, std::size_t& length,
                                          std::size_t& variant) const {
  if (!sync_at(remaining)) return Verdict::bad;
  const FrameCheck& check = frame_.check;
  // Finds the length. Without an id there is only one variant.
  const FrameVariant* known = frame_.id ? nullptr : frame_.variants.data();
  if (frame_.id) {
    if (remaining.size() < frame_.id->end()) return Verdict::more;
    const std::uint64_t id = frame_.id->bits_of(remaining.data());
    for (const FrameVariant& candidate : frame_.variants)
      if (candidate.id == id) known = &candidate;
    if (known == nullptr && !frame_.length) return Verdict::bad;
  }
  if (frame_.length) {
    if (remaining.size() < frame_.length->end()) return Verdict::more;
    const std::uint64_t raw = frame_.length->bits_of(remaining.data());
    if (raw > longest_frame) return Verdict::bad;
    const std::int64_t says = std::int64_t(raw) * frame_.length_scale + frame_.length_add;
    if (says < 1 || says > std::int64_t(longest_frame)) return Verdict::bad;
    length = std::size_t(says);
    if (known != nullptr && known->length != length) return Verdict::bad;
    if (known == nullptr) {
      // With an unknown layout only a check at the end has a known place, and only a strong one suffices by itself.
      const bool can_tell = check.from_end && !check.weak();
      if (!can_tell || length < frame_.sync.size() + frame_.tail.size() || check.field.offset() > length ||
          check_offset(check, length) <= check.start + check.gap)
        return Verdict::bad;
    }
  } else {
    length = known->length;
  }
  if (remaining.size() < length) return Verdict::more;
  const auto frame = remaining.first(length);
  if (!frame_.tail.empty() &&
      !std::equal(frame_.tail.begin(), frame_.tail.end(), frame.end() - std::ptrdiff_t(frame_.tail.size())))
    return Verdict::bad;
  if (!check_good(frame)) return Verdict::bad;
  if (known == nullptr) return Verdict::other;
  if (check.weak()) {
    const auto after = remaining.subspan(length);
    if (!sync_at(after)) return Verdict::bad;
    if (after.size() < frame_.sync.size()) return Verdict::more;
  }
  variant = std::size_t(known - frame_.variants.data());
  return Verdict::good;
}

bool FrameScanner::next(ScannedFrame& frame) {
  while (begin_ < end_) {
    const auto remaining = std::span<const std::byte>(buffer_).subspan(begin_, end_ - begin_);
    std::size_t length = 0;
    std::size_t variant = 0;
    const Verdict verdict = judge(remaining, length, variant);
    if (verdict == Verdict::more) return false;
    if (verdict == Verdict::bad) {
      if (in_step_) {
        ++counters_.bad_frames;
        seeking_again_ = true;
      }
      in_step_ = false;
      ++begin_;
      ++skipped_;
      ++counters_.skipped_bytes;
      continue;
    }
    if (seeking_again_) ++counters_.resyncs;
    seeking_again_ = false;
    in_step_ = true;
    begin_ += length;
    if (verdict == Verdict::other) {
      ++counters_.other_frames;
      continue;
    }
    ++counters_.frames;
    frame = {remaining.data(), variant, skipped_};
    skipped_ = 0;
    return true;
  }
  begin_ = end_ = 0;
  return false;
}

// ---- the decoder ----

namespace {

constexpr int strays_for_restart = 3;
// Limits for the samples after a silence.
constexpr double off_time_s = 0.05;     // a longer delay is not explained by adapters and a busy host
constexpr double pace_window_s = 0.25;  // equal delays in two such windows mean that samples come at the unit's pace
constexpr double catching_up = 0.02;    // a line that catches up makes up at least this fraction of the time
constexpr double quiet_s = 0.1;         // a line that is empty for so long has no backlog

// ---- the numbers of a frame ----

constexpr double largest_pulses = 2147483647.0;  // limit of a recording

// Returns (now - before) modulo the modulus, as the value nearest to 0.
double cumulative_step(std::uint64_t now, std::uint64_t before, std::uint64_t modulus) {
  if (modulus == 0) return double(std::int64_t(now - before));
  const std::uint64_t up = now >= before ? now - before : modulus - (before - now);
  return up <= modulus / 2 ? double(up) : -double(modulus - up);
}

// Reads the increments and the invalid flag. Returns false when the numbers are impossible.
bool read_values(const FrameVariant& variant, const std::byte* frame, const CumulativeBase& base, ImuSample& sample) {
  for (std::size_t i = 0; i < 6; ++i) {
    const FrameValue& from = variant.values[i];
    double& value = channel_of(sample, i);
    if (from.cumulative) {
      const std::uint64_t now = from.field.bits_of(frame), down = from.down ? from.down->bits_of(frame) : 0;
      if (from.modulus != 0 && std::max(now, down) >= from.modulus) return false;
      const double steps = cumulative_step(now, base.field[i], from.modulus) -
                           (from.down ? cumulative_step(down, base.field[6 + i], from.modulus) : 0.0);
      value = (base.known ? from.factor * steps : 0.0) + 0.0;
      continue;  // may be anything across a gap; fits() checks it
    }
    double raw = from.field.number(frame);
    if (from.down) raw -= from.down->number(frame);
    if (raw < from.low || raw > from.high) sample.flags |= sample_flag_invalid;
    value = from.factor * (raw - from.zero);
    value += 0.0;                             // turns -0 into 0
    if (!std::isfinite(value)) return false;  // floating fields
    if (from.pulses && (std::abs(value) > largest_pulses || value != std::nearbyint(value))) return false;
  }
  for (const FrameStatus& status : variant.status)
    if ((status.field.bits_of(frame) & status.mask) != status.good) sample.flags |= sample_flag_invalid;
  return true;
}

// Checks the range of a recording, which an increment over a long gap may exceed.
bool fits(const FrameVariant& variant, const ImuSample& sample) {
  for (std::size_t i = 0; i < 6; ++i)
    if (variant.values[i].pulses && std::abs(channel_of(sample, i)) > largest_pulses) return false;
  return true;
}

void keep(const FrameVariant& variant, const std::byte* frame, CumulativeBase& base) {
  for (std::size_t i = 0; i < 6; ++i) {
    base.field[i] = variant.values[i].field.bits_of(frame);
    if (variant.values[i].down) base.field[6 + i] = variant.values[i].down->bits_of(frame);
  }
  base.known = true;
}

// Empty: not in this frame. NaN: not finite.
std::optional<float> temperature_c(const FrameVariant& variant, const std::byte* frame) {
  const std::optional<FrameScalar>& from = variant.temperature;
  if (!from || (from->when && variant.multiplexer->bits_of(frame) != *from->when)) return {};
  double sum = 0.0;
  for (const FrameField& field : from->places) sum += field.number(frame);
  const auto value = float((sum / double(from->places.size()) - from->zero) * from->scale);
  return std::isfinite(value) ? value : std::numeric_limits<float>::quiet_NaN();
}

// Joins the variants of the two frames of a sample: the second frame follows the first.
FrameVariant joined(FrameVariant both, FrameVariant accel) {
  const std::size_t by = both.length;
  both.length += accel.length;
  for (std::size_t i = 3; i < 6; ++i) {
    both.values[i] = accel.values[i];
    both.values[i].field.shift(by);
    if (both.values[i].down) both.values[i].down->shift(by);
  }
  for (FrameStatus& status : accel.status) {
    status.field.shift(by);
    both.status.push_back(status);
  }
  if (both.temperature || !accel.temperature) return both;
  both.temperature = accel.temperature;
  for (FrameField& field : both.temperature->places) field.shift(by);
  both.multiplexer = accel.multiplexer;
  if (both.multiplexer) both.multiplexer->shift(by);
  return both;
}

CounterTracker tracker_of(const FrameDescription& frame) {
  const auto& counter = frame.variants.front().counter;
  if (!counter) return CounterTracker(frame.sample_period_s, 1.0, 0.0);
  return CounterTracker(frame.sample_period_s, counter->step, counter->modulus);
}

}  // namespace

FrameDecoder::FrameDecoder(const FrameDescription& frame)
    : scanner_(frame),
      variants_(frame.variants),
      split_(frame.split),
      weak_(frame.check.weak()),
      step_(frame.variants.front().counter ? frame.variants.front().counter->step : 1.0),
      modulus_(frame.variants.front().counter ? frame.variants.front().counter->modulus : 0.0),
      state_{tracker_of(frame), {}, std::numeric_limits<float>::quiet_NaN(), 0, {}, {}, false},
      before_(state_),
      period_s_(frame.sample_period_s) {
  const bool may_hold = modulus_ > 0.0 && state_.tracker.wrap_s() < narrow_wrap_s;
  ready_.reserve(may_hold ? most_held + 4 : 4);
  if (split_) {
    variants_.push_back(joined(frame.variants[0], frame.variants[1]));
    joined_.resize(variants_.back().length);
  }
  any_cumulative_ = std::ranges::any_of(variants_.back().values, &FrameValue::cumulative);
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
    if (!split_)
      decode(scanned);
    else if (ScannedFrame whole; join(scanned, whole))
      decode(whole);
  }
}

bool FrameDecoder::join(const ScannedFrame& scanned, ScannedFrame& whole) {
  const std::size_t part = scanned.variant;
  const std::size_t other = 1 - part;
  const double raw = variants_[part].counter->field.number(scanned.data);
  if (part_counter_[part]) ++unusable_;  // never paired
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

void FrameDecoder::decode(const ScannedFrame& scanned) {
  const FrameVariant& variant = variants_[scanned.variant];
  ImuSample sample;
  idle(arrival_.earliest_s);
  for (int attempt = 0; attempt < 2; ++attempt) {
    sample = ImuSample{};
    if (!read_values(variant, scanned.data, state_.base, sample)) {
      ++unusable_;
      return;
    }
    double raw = 0.0;
    PlacedCounter placed;
    if (variant.counter) {
      raw = variant.counter->field.number(scanned.data);
      placed = state_.tracker.place(std::isnan(raw) ? -1.0 : raw, arrival_);
      if (is_unsure(placed)) {
        placed = {CounterOutcome::gap, state_.tracker.last_counter() + placed.shortest, placed.shortest,
                  placed.shortest, placed.late_s};
        if (placed.shortest == 1) placed.outcome = CounterOutcome::next;
      }
    } else {
      placed = state_.tracker.place_uncounted(double(scanned.skipped_before) / double(variant.length), arrival_);
    }
    const bool follows = placed.outcome == CounterOutcome::next && (variant.counter || scanned.skipped_before == 0);
    if (waiting_ && !follows) {
      // Nothing confirms the frame before: it is rejected, and this one is judged without it.
      state_ = before_;
      waiting_ = false;
      ++strays_;
      continue;
    }
    switch (placed.outcome) {
      case CounterOutcome::duplicate: {
        ++duplicates_;
        bool same = true;
        for (std::size_t i = 0; i < 6; ++i)
          same = same && channel_of(sample, i) == (variant.values[i].cumulative ? 0.0 : channel_of(state_.last, i));
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
    if (variant.counter && placed.outcome != CounterOutcome::first) {
      if (is_unsure(placed)) {
        begin_hold(placed, raw);
        placed.counter = state_.tracker.last_counter() + placed.ahead;
      } else if (state_.hold.active && placed.outcome == CounterOutcome::gap &&
                 placed.late_s < -0.5 * period_s_ * double(placed.ahead)) {
        state_.hold.jump = placed.counter;  // a loss within the backlog: the buffer that held it overflowed there
      }
    }
    believe(placed, raw, variant, scanned.data, sample);
    return;
  }
}

// Compares frames with an implausible counter with each other: a reset unit counts on from its new value.
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

void FrameDecoder::believe(const PlacedCounter& placed, double raw, const FrameVariant& variant, const std::byte* frame,
                           ImuSample& sample) {
  state_.tracker.accept(placed, raw, arrival_);
  const bool no_base =
      any_cumulative_ && (!state_.base.known || placed.outcome != CounterOutcome::next || !fits(variant, sample));
  if (placed.ahead > 1) state_.lost += std::uint64_t(placed.ahead - 1);
  if (no_base && placed.outcome != CounterOutcome::first) ++state_.lost;
  if (any_cumulative_) keep(variant, frame, state_.base);
  state_.temperature_c = temperature_c(variant, frame).value_or(state_.temperature_c);
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

// ---- after a silence that the counter alone cannot explain: samples are held until their arrival decides ----

// True if, by the counter alone, the sample is much older than its arrival.
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
      hold.jump = placed.counter;  // the delay is the sum of both
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
  state_.base.known = false;  // a cumulative field may span the loss
  hold.window_end_s = arrival_.latest_s + pace_window_s;
  hold.window_late_s = hold.before_late_s = std::numeric_limits<double>::infinity();
}

void FrameDecoder::judge_hold() {
  Hold& hold = state_.hold;
  hold.last_s = arrival_.latest_s;
  const double late_s = held_late_s();
  hold.window_late_s = std::min(hold.window_late_s, late_s);
  if (late_s <= std::min(off_time_s, state_.tracker.slack_s(0.0))) {
    if (hold.from_zero)
      decide(late_s);
    else
      release(0);
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

// Returns the delay of the last held sample, assuming no loss.
double FrameDecoder::held_late_s() const {
  const Hold& hold = state_.hold;
  return hold.last_s - hold.from_s - period_s_ * double(state_.tracker.last_counter() - hold.from_counter);
}

std::int64_t FrameDecoder::wraps_in(double late_s) const {
  return std::max<std::int64_t>(std::llround(late_s / state_.tracker.wrap_s()), 0);
}

bool FrameDecoder::is_whole_wraps(double late_s) const {
  const double wrap_s = state_.tracker.wrap_s();
  const double off_s = std::abs(late_s - double(wraps_in(late_s)) * wrap_s);
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
  for (std::size_t i = ready_free_; i < ready_.size(); ++i)
    if (ready_[i].counter >= state_.hold.jump) ready_[i].counter += lost;
  if (waiting_ && waiting_sample_.counter >= state_.hold.jump) waiting_sample_.counter += lost;
  if (lost > 0) {
    state_.tracker.shift(lost);
    state_.lost += std::uint64_t(lost);
  }
  state_.hold.active = false;
  ready_free_ = ready_.size();
}

Result<FrameLog> read_frame_log(const std::string& path, const FrameDescription& frame) {
  const PosixFile file = TRY(PosixFile::open_to_read(path));
  const std::uint64_t size = TRY(file.size());
  constexpr Arrival some_time{0.0, 600.0};
  FrameDecoder decoder(frame);
  FrameLog log;
  for (std::uint64_t at = 0; at < size;) {
    const std::size_t count = TRY(file.read_at(at, decoder.space()));
    if (count == 0) return input_error(path + ": became shorter while it was read");
    at += count;
    decoder.added(count, some_time);
    ImuSample sample;
    FrameDecoder::Next next{};
    while ((next = decoder.next(sample)) == FrameDecoder::Next::sample)
      if (log.samples.empty() || sample.counter > log.samples.back().counter) log.samples.push_back(sample);
    if (next == FrameDecoder::Next::restarted)
      return input_error("{}: near byte {}, after {}: {} and its biases may be others: expected the log of one session",
                         path, at, counted(std::ssize(log.samples), "sample"), decoder.restart_reason());
  }
  const ScanCounters& scan = decoder.scan();
  const ImuLinkCounters link = decoder.counters();
  const double wrap_s = tracker_of(frame).wrap_s();
  const bool wraps = link.lost_samples > 0 && wrap_s > 0.0 && wrap_s < some_time.latest_s;
  log.summary =
      fmt::format("{}, {} of {}, {} bad, {} of none, {} lost{}, {}, {}, {} flagged", counted(size, "byte"),
                  counted(scan.frames, "frame"), frame.name, link.bad_frames, counted(scan.skipped_bytes, "byte"),
                  counted(link.lost_samples, "sample"), wraps ? " (or more: the counter wraps)" : "",
                  counted(link.duplicates, "duplicate"), counted(decoder.strays(), "stray"), decoder.invalid());
  if (log.samples.empty())
    return input_error("{}: no sample in it by the frame description {}: {}", path, frame.name, log.summary);
  return log;
}

}  // namespace turncal
