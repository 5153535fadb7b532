#include "orchestrator/run/unit_lane.h"

#include <algorithm>

namespace turncal {

void UnitLane::drop(Error why) {
  failure_ = std::move(why);
  close();
}

void UnitLane::close() {
  open_ = false;
  waiting_.clear();
  unit_.imu.close();
}

void UnitLane::resume_at(const RecordingPoint& left, bool no_time_passed) {
  next_sample_ = left.next_sample;
  resumed_written_ = left.written;
  lost_samples_ = left.lost_samples;
  duplicate_samples_ = left.duplicate_samples;
  gap_due_ = !no_time_passed;
  if (gap_due_) return;
  first_counter_ = left.first_counter;
  last_received_ = left.last_counter;
}

RecordingPoint UnitLane::point() const {
  const std::int64_t first = first_counter_.value_or(0);
  return {.next_sample = next_sample_,
          .first_counter = first,
          .last_counter = first_counter_ ? first + next_sample_ - 1 : 0,
          .lost_samples = lost_samples_,
          .duplicate_samples = duplicate_samples_};
}

UnitLane::Write UnitLane::stored(std::function<Status(RunSink&)> write) const {
  return [stored = stored_, sinks = unit_.sinks, write = std::move(write)] {
    for (std::size_t i = 0; i < sinks.size() && !stored->failed; ++i) {
      stored->status = write(*sinks[i]);
      if (!stored->status) stored->failed = true;
    }
    return stored->status;
  };
}

Result<std::string> UnitLane::connect(const StationConfig& station, bool table_simulated, const Clock& clock) {
  TRY(unit_.imu.open());
  open_ = true;
  const ImuIdentity imu = TRY(unit_.imu.identify());
  if (!imu.unit_serial.empty() && imu.unit_serial != unit_.serial)
    return input_error("the unit on the table reports serial number '" + imu.unit_serial + "', but this run is for '" +
                       unit_.serial + "'");
  unit_.imu.describe(info_);
  info_.latitude_deg = station.latitude_deg;
  info_.gravity_mps2 = station.gravity_mps2;
  info_.unit_serial = unit_.serial;
  info_.started_utc_s = std::llround(clock.utc_s());
  info_.simulated = info_.simulated || table_simulated;
  dwell_.emplace(station.dwell, info_);
  spikes_.emplace(info_);
  felt_.emplace(info_);
  last_sample_s_ = clock.now_s();
  return imu.description;
}

UnitLane::Write UnitLane::begin_recording(bool resumed) const {
  return stored([info = info_, next_sample = next_sample_, written = resumed_written_, resumed](RunSink& sink) {
    return resumed ? sink.resume(info, next_sample, written) : sink.start(info);
  });
}

Result<std::size_t> UnitLane::receive(std::size_t count, double timeout_s) {
  const std::size_t before = waiting_.size();
  waiting_.resize(before + count);
  const Result<std::size_t> got = unit_.imu.read(std::span(waiting_).subspan(before), timeout_s);
  if (!got) {
    waiting_.resize(before);
    open_ = false;
    return got;
  }
  // Repeated samples are dropped, because counters in a recording must increase.
  std::size_t kept = before;
  for (std::size_t i = before; i < before + *got; ++i) {
    if (last_received_ && waiting_[i].counter <= *last_received_) {
      ++duplicate_samples_;
      const bool same = waiting_[i].gyro == last_sample_.gyro && waiting_[i].accel == last_sample_.accel;
      if (waiting_[i].counter == *last_received_ && have_last_sample_ && !same) conflict_ = *last_received_;
      continue;
    }
    last_received_ = waiting_[i].counter;
    last_sample_ = waiting_[i];
    have_last_sample_ = true;
    if (felt_) felt_->add(waiting_[i]);
    waiting_[kept++] = waiting_[i];
  }
  waiting_.resize(kept);
  return got;
}

std::string UnitLane::came_instead() const {
  const ImuLinkCounters came = unit_.imu.counters();
  std::string text;
  if (came.bad_frames + came.resyncs > came.samples)
    text += "; " + std::to_string(std::max(came.bad_frames, came.resyncs)) +
            " bad frames came: baud rate, or another frame than the one described";
  const std::uint64_t again = came.duplicates + duplicate_samples_;
  if (again > 0) text += "; " + counted(again, "sample") + " repeated a counter that had come before";
  return text;
}

void UnitLane::receive_meanwhile(double now_s) {
  constexpr std::size_t at_a_time = 128, at_most = 16;
  for (std::size_t i = 0; i < at_most && alive() && is_open(); ++i) {
    const Result<std::size_t> got = receive(at_a_time, 0.0);
    if (!got) trouble_ = got.error();
    if (!got || *got == 0) return;
    heard(now_s);
  }
}

Result<UnitLane::Recorded> UnitLane::record(bool dwelling, BackgroundQueue& storage) {
  Recorded recorded;
  std::size_t count = waiting_.size();
  if (dwelling) count = std::min(count, std::size_t(std::max<std::int64_t>(dwell_->remaining(), 0)));
  if (!segment_) waiting_.clear();
  if (!segment_) conflict_.reset();
  if (waiting_.empty() || count == 0) return recorded;
  const std::span<ImuSample> samples = std::span(waiting_).first(count);
  const std::optional<Segment> begun = segment_written_ ? std::nullopt : segment_;
  segment_written_ = true;
  if (gap_due_) {
    // A gap of one sample stands for everything missed: the unit's counter may have restarted, and the table is back where it was.
    ++next_sample_;
    first_counter_ = samples.front().counter - next_sample_;
    gap_due_ = false;
  }
  if (!first_counter_) first_counter_ = samples.front().counter;
  std::string glitch;
  for (ImuSample& sample : samples) {
    sample.counter -= *first_counter_;
    recorded.flagged = recorded.flagged || (sample.flags & sample_flag_invalid) != 0;
    const std::optional<std::size_t> channel = spikes_->spike_in(sample);
    if (channel && glitch.empty())
      glitch = glitch_of(*channel, channel_of(sample, *channel), sample.counter, info_.sample_period_s);
  }
  const auto lost = std::uint64_t(samples.back().counter + 1 - next_sample_) - samples.size();
  lost_samples_ += lost;
  recorded.gap = lost != 0;
  next_sample_ = samples.back().counter + 1;
  const auto write = [begun, copy = std::vector(samples.begin(), samples.end())](RunSink& sink) {
    const Status status = begun ? sink.begin_segment(*begun) : Status{};
    return status ? sink.add(copy) : status;
  };
  if (!storage.post(stored(write)))
    return device_error("more samples wait to be written than can be held: the disk is too slow");
  if (stored_->failed) return stored_->status.error();
  if (dwelling) recorded.defect = dwell_->add(samples);
  if (!glitch.empty()) {
    recorded.flagged = true;
    recorded.what = glitch + ", which cannot be,";
    if (dwelling) recorded.defect = DwellMonitor::Defect{ErrorKind::device, glitch + ", which cannot be"};
  }
  if (conflict_) {
    const std::string text =
        "two samples with the counter " + std::to_string(*conflict_ - *first_counter_) + " that differ";
    if (dwelling && !recorded.defect) recorded.defect = DwellMonitor::Defect{ErrorKind::unit_failed, text};
    recorded.flagged = true;
    conflict_.reset();
  }
  waiting_.erase(waiting_.begin(), waiting_.begin() + std::ptrdiff_t(count));
  return recorded;
}

void UnitLane::begin_segment(const Segment& segment) {
  segment_ = segment;
  segment_->start_sample = segment_->end_sample = next_sample_;
  segment_written_ = false;
  came_before_ = next_sample_ + std::int64_t(waiting_.size());
}

UnitLane::Write UnitLane::end_segment(SegmentKind kind, const AxisTriple& angles_deg) {
  const bool written = segment_ && segment_written_;
  segment_.reset();
  if (!written) return {};
  return stored([kind, end_sample = next_sample_, angles_deg](RunSink& sink) {
    return sink.end_segment(kind, end_sample, angles_deg);
  });
}

}  // namespace turncal
