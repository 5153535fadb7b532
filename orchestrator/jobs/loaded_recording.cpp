#include "orchestrator/jobs/loaded_recording.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "calib/rests/rest_data.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/data_screen.h"
#include "calib/statistics/segmentation.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

// Tells ChannelLife what the table turned, segment by segment.
class TableLife {
 public:
  TableLife(const RecordingInfo& info, const Segments& segments) : life_(info), segments_(segments) {}
  void add(std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) {
      while (index_ < segments_.size() && sample.counter >= segments_[index_].end_sample) end_segment();
      life_.add(sample);
    }
  }
  const std::string& finish() {
    while (index_ < segments_.size()) end_segment();
    return life_.defect();
  }

 private:
  void end_segment() {
    if (index_ > 0) {
      const Segment &from = segments_[index_ - 1], &to = segments_[index_];
      life_.turned(std::abs(to.heading_deg - from.heading_deg) + std::abs(to.pitch_deg - from.pitch_deg) +
                   std::abs(to.roll_deg - from.roll_deg));
    }
    ++index_;
  }
  ChannelLife life_;
  const Segments& segments_;
  std::size_t index_ = 0;
};

// `later` begins before `earlier` has ended.
bool overlap(const LoadedRecording& earlier, const LoadedRecording& later) {
  const auto &from = earlier.data.info.started_utc_s, &at = later.data.info.started_utc_s;
  constexpr double whole_seconds = 2.0;  // both times are
  return from && at && *from <= *at && static_cast<double>(*at - *from) < earlier.recorded_s - whole_seconds;
}

}  // namespace

Result<LoadedRecording> load_recording(RecordingSource& source, const std::function<void(std::int64_t)>& progress,
                                       const std::optional<CompressionOptions>& blocks, int before_step) {
  if (source.segments().empty())
    return input_error(source.path() +
                       ": the recording has no segments, so nothing says when the unit was at rest: expected segments, "
                       "as `turncal segment` finds them");
  LoadedRecording loaded;
  loaded.path = source.path();
  loaded.damage = source.damage();
  loaded.by_hand = without_table_angles(source.segments());
  Compressor compressor(source.info(),
                        blocks.value_or(loaded.by_hand ? rest_compression_options() : CompressionOptions{}));
  std::optional<ClippingFinder> clipping;
  if (loaded.by_hand) clipping.emplace();
  Segments segments = source.segments();
  loaded.recorded_s = static_cast<double>(segments.back().end_sample) * source.info().sample_period_s;
  if (before_step > 0)
    segments.erase(std::ranges::find_if(segments, [&](const Segment& segment) { return segment.step >= before_step; }),
                   segments.end());
  if (segments.empty())
    return input_error(source.path() + ": nothing was recorded before step " + std::to_string(before_step));
  SegmentedFeed feed(compressor, segments);
  TableLife life(source.info(), segments);
  std::int64_t count = 0;
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    while (before_step > 0 && !samples.empty() && samples.back().counter >= segments.back().end_sample)
      samples = samples.first(samples.size() - 1);
    if (samples.empty()) return Status{};
    feed.add(samples);
    if (!loaded.by_hand) life.add(samples);
    if (clipping)
      for (const ImuSample& sample : samples) clipping->add(sample);
    count += static_cast<std::int64_t>(samples.size());
    if (progress) progress(count);
    return Status{};
  });
  if (!status) return status.error();
  feed.finish();
  loaded.data = compressor.take();
  if (clipping) clipping->note(loaded.data.events);
  loaded.dead_channel = life.finish();
  loaded.hash = TRY(source.content_hash());  // falls out of read()
  return loaded;
}

Result<LoadedRecording> load_recording(const std::string& path, const std::function<void(std::int64_t)>& progress,
                                       const std::optional<CompressionOptions>& blocks, int before_step) {
  const std::unique_ptr<RecordingSource> source = TRY(RecordingSource::open(path));
  return load_recording(*source, progress, blocks, before_step);
}

Status check_data(const LoadedRecording& loaded) {
  if (!loaded.dead_channel.empty()) return Error{ErrorKind::unit_failed, loaded.path + ": " + loaded.dead_channel};
  if (const std::string wrong = loaded.by_hand ? "" : wrong_table_units(loaded.data); !wrong.empty())
    return Error{ErrorKind::unit_failed, loaded.path + ": " + wrong};
  const std::vector<Block>& blocks = loaded.data.blocks;
  if (std::ranges::any_of(blocks, [](const Block& block) { return block.whole_second; })) return {};
  return input_error(loaded.path + ": not one whole second at rest: expected dwells to calibrate from");
}

Status check_same_unit(const std::vector<const LoadedRecording*>& recordings) {
  const LoadedRecording& first = *recordings.front();
  const auto kind = [](IncrementKind k) { return std::string(k == IncrementKind::pulses ? "pulses" : "rad or mps"); };
  for (const LoadedRecording* one : recordings) {
    const RecordingInfo &info = one->data.info, &expected = first.data.info;
    const auto refuse = [&](const std::string& key, const std::string& value, const std::string& instead) -> Status {
      return input_error(one->path + ": " + key + " = '" + value + "': expected '" + instead + "', as in " +
                         first.path);
    };
    if (info.unit_serial != expected.unit_serial) return refuse("unit_serial", info.unit_serial, expected.unit_serial);
    if (info.gyro_increment != expected.gyro_increment)
      return refuse("gyro_increment", kind(info.gyro_increment), kind(expected.gyro_increment));
    if (info.accel_increment != expected.accel_increment)
      return refuse("accel_increment", kind(info.accel_increment), kind(expected.accel_increment));
    if (expected.accel_increment == IncrementKind::pulses && info.accel_pulse_mps != expected.accel_pulse_mps)
      return refuse("accel_pulse_mps", format_number(info.accel_pulse_mps), format_number(expected.accel_pulse_mps));
    if (info.simulated != expected.simulated)
      return refuse("simulated", info.simulated ? "true" : "false", expected.simulated ? "true" : "false");
    if (one->by_hand != first.by_hand)
      return input_error(one->path + ": expected a recording " + (first.by_hand ? "without" : "with") +
                         " table angles, as " + first.path);
    // The rig's clock begins every dry run at the same time.
    const auto meanwhile = std::ranges::find_if(recordings, [&](const LoadedRecording* other) {
      return other != one && !info.simulated && overlap(*other, *one);
    });
    if (meanwhile != recordings.end())
      return input_error(one->path + ": started_utc = " + format_utc(static_cast<double>(*info.started_utc_s)) +
                         ", while " + (*meanwhile)->path + " was being recorded: expected one unit, at one time");
    const auto same = [&](const LoadedRecording* other) { return other != one && other->hash == one->hash; };
    if (std::ranges::any_of(recordings, same))
      return input_error(one->path + ": is given twice: expected recordings that differ");
  }
  return {};
}

}  // namespace turncal
