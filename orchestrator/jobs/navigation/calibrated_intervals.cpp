#include "orchestrator/jobs/navigation/calibrated_intervals.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/rests/rest_data.h"
#include "calib/statistics/compression.h"
#include "calib/statistics/segmentation.h"

namespace turncal {

namespace {

constexpr std::int64_t no_end = std::numeric_limits<std::int64_t>::max();

// Whether the unit rests over a sample, for samples in counter order.
class RestOf {
 public:
  explicit RestOf(const Segments& segments) : segments_(segments) {}
  bool at(std::int64_t counter) {
    if (segments_.empty()) return true;
    while (index_ < segments_.size() && counter >= segments_[index_].end_sample) ++index_;
    return index_ < segments_.size() && counter >= segments_[index_].start_sample &&
           segments_[index_].kind != SegmentKind::rotate;
  }
  // How many of [begin, end) it does not rest over, begin not before what at() was asked for.
  std::int64_t moving_in(std::int64_t begin, std::int64_t end) const {
    if (segments_.empty()) return 0;
    std::int64_t resting = 0;
    for (std::size_t k = index_; k < segments_.size() && segments_[k].start_sample < end; ++k)
      if (segments_[k].kind != SegmentKind::rotate)
        resting += std::max<std::int64_t>(
            0, std::min(end, segments_[k].end_sample) - std::max(begin, segments_[k].start_sample));
    return end - begin - resting;
  }

 private:
  const Segments& segments_;
  std::size_t index_ = 0;
};

// Which samples a calibration would not believe. A hand and a vehicle jerk: there only what no unit can have felt counts.
class FaultySamples {
 public:
  // What stands out of its neighbours is known when so many samples have come after it.
  static constexpr std::size_t settled_after = 3;

  FaultySamples(const RecordingInfo& info, const Segments& segments, bool on_table)
      : segments_(segments.empty() ? Segments{{.kind = SegmentKind::align, .end_sample = no_end}} : segments),
        compressor_(info, on_table ? CompressionOptions{} : rest_compression_options()),
        feed_(compressor_, segments_) {}
  void add(std::span<const ImuSample> samples) { feed_.add(samples); }
  // For samples in counter order, each settled, with its neighbours: the channel that cannot be; nothing: it may be true. What rises and
  // stays up is the beginning of a turn.
  std::optional<std::size_t> fault_of(const ImuSample& before, const ImuSample& sample, const ImuSample& after) {
    const std::int64_t counter = sample.counter;
    const std::vector<DataEvent>& events = compressor_.recording().events;
    while (next_ < events.size() && events[next_].sample + static_cast<std::int64_t>(settled_after) < counter) ++next_;
    for (std::size_t k = next_; k < events.size(); ++k) {
      const bool gyro = events[k].kind == DataEvent::Kind::gyro_glitch;
      if (events[k].sample != counter || !(gyro || events[k].kind == DataEvent::Kind::accel_glitch)) continue;
      const auto channel = static_cast<std::size_t>(events[k].axis + (gyro ? 0 : 3));
      const double step = channel_of(after, channel) - channel_of(before, channel);
      if (events[k].left_out || std::abs(step) < std::abs(events[k].size)) return channel;
    }
    return std::nullopt;
  }

 private:
  Segments segments_;
  Compressor compressor_;
  SegmentedFeed feed_;
  std::size_t next_ = 0;
};

// What is lost is filled in, interval by interval. More than this is a counter that jumped, or two recordings in one.
constexpr double most_lost_s = 86400.0;

// What no unit on a table, in a hand or in a vehicle can feel in an interval.
bool can_be(const MotionInterval& interval) {
  constexpr double most_mps2 = 1e4;
  return interval.push_mps.norm() <= most_mps2 * interval.duration_s && interval.turn.coeffs().allFinite();
}

}  // namespace

Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source) {
  const RecordingInfo& info = source.info();
  TRY(check_applicable(file, path, info));
  EffectTerms effects = TRY(EffectTerms::of(file, path, source));
  const int samples = std::max(1, static_cast<int>(std::lround(motion_interval_s / info.sample_period_s)));
  const SensorModel model = sensor_model(from_vector(file.parameters), info);
  return CalibratedIntervals{path, std::move(file), model, std::move(effects),
                             IncrementIntegrator(info.sample_period_s, samples)};
}

Result<CalibratedIntervals> calibrated_intervals(const std::string& path, RecordingSource& source) {
  ParameterFile file = TRY(read_parameter_file(path));
  return calibrated_intervals(std::move(file), path, source);
}

Result<IntegratedSamples> integrate_recording(RecordingSource& source, const Stretch& stretch,
                                              std::vector<CalibratedIntervals>& files,
                                              const ReferenceTrack* reference) {
  const double period_s = source.info().sample_period_s;
  RestOf rest(source.segments());
  std::optional<std::int64_t> first;
  std::int64_t begin = 0, end = 0;
  IntegratedSamples found;
  std::optional<std::int64_t> last;  // taken
  // What rests all the time is jerked by no hand, whatever angles its table has.
  const bool turns = std::any_of(source.segments().begin(), source.segments().end(),
                                 [](const Segment& segment) { return segment.kind == SegmentKind::rotate; });
  const bool on_table =
      reference == nullptr && !source.segments().empty() && (!turns || !without_table_angles(source.segments()));
  FaultySamples faulty(source.info(), source.segments(), on_table);
  bool gyro_lives = false, accel_lives = false;
  std::vector<ImuSample> waiting;  // until they are settled
  double lost_s = 0.0;
  ImuSample before{};
  const auto take = [&](std::size_t count) -> Status {
    for (std::size_t k = 0; k < count; ++k) {
      const ImuSample& sample = waiting[k];
      const ImuSample previous = std::exchange(before, sample), &after = waiting[std::min(k + 1, waiting.size() - 1)];
      if (sample.counter < begin || sample.counter >= end || (sample.flags & sample_flag_invalid) != 0) continue;
      const Eigen::Vector3d gyro(sample.gyro[0], sample.gyro[1], sample.gyro[2]);
      const Eigen::Vector3d accel(sample.accel[0], sample.accel[1], sample.accel[2]);
      if (!gyro.allFinite() || !accel.allFinite())
        return input_error(source.path() + ": sample " + std::to_string(sample.counter) + ": expected finite numbers");
      if (const std::optional<std::size_t> channel = faulty.fault_of(previous, sample, after)) {
        const std::string words = glitch_of(*channel, channel_of(sample, *channel), sample.counter, period_s);
        if (found.faults.empty() || found.faults.back() != words) found.faults.push_back(words);
        continue;
      }
      gyro_lives = gyro_lives || !gyro.isZero(0.0);
      accel_lives = accel_lives || !accel.isZero(0.0);
      if (!last) found.first_sample = sample.counter;
      const std::int64_t expected = last.value_or(sample.counter - 1) + 1;
      SampleGap gap{expected};
      if (sample.counter > expected)
        gap = {expected, sample.counter - expected, rest.moving_in(expected, sample.counter)};
      lost_s += static_cast<double>(gap.samples) * period_s;
      if (lost_s > most_lost_s)
        return input_error(source.path() + ": " + gap_words(gap) + ": expected a recording that lost less than a day");
      if (gap.samples > 0) found.gaps.push_back(gap);
      last = std::max(last.value_or(sample.counter), sample.counter);
      const double time_s = static_cast<double>(sample.counter - *first) * period_s;
      const bool at_rest = rest.at(sample.counter) && (reference == nullptr || reference->stands_at(time_s)),
                 gap_at_rest = gap.is_short() && gap.in_motion == 0;
      for (CalibratedIntervals& file : files) {
        const EffectTerms::Term& effects = file.effects.at(sample.counter);
        file.integrator.add(
            sample.counter, file.model.gyro_scale * gyro - period_s * (file.model.gyro_bias_radps + effects.rate_radps),
            file.model.accel_scale * accel - period_s * (file.model.accel_bias_mps2 + effects.force_mps2), at_rest,
            gap_at_rest);
      }
    }
    return {};
  };
  Status status = source.read([&](std::span<const ImuSample> block) {
    if (!first) {
      first = block.front().counter;
      begin = *first + std::llround(stretch.from_s / period_s);
      const double most = 1e15;  // of a counter
      end = stretch.to_s ? *first + std::llround(std::min(*stretch.to_s / period_s, most)) : no_end;
      const std::int64_t known = source.segments().empty() ? 0 : source.segments().back().end_sample - begin;
      for (CalibratedIntervals& file : files) file.integrator.reserve(std::clamp<std::int64_t>(known, 0, 100'000'000));
    }
    faulty.add(block);
    waiting.insert(waiting.end(), block.begin(), block.end());
    const std::size_t settled = waiting.size() - std::min(waiting.size(), FaultySamples::settled_after);
    Status taken = take(settled);
    waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(settled));
    return taken;
  });
  if (status) status = take(waiting.size());
  if (!status) return status.error();
  if (last && !(gyro_lives && accel_lives))
    return input_error(source.path() + ": the " + (gyro_lives ? "accelerometers" : "gyros") +
                       " gave nothing but zeros: expected a unit that feels the Earth turn and weighs something");
  for (const CalibratedIntervals& file : files) {
    const std::vector<MotionInterval>& intervals = file.integrator.intervals();
    const auto wrong = std::find_if_not(intervals.begin(), intervals.end(), can_be);
    if (wrong == intervals.end()) continue;
    const std::int64_t at = found.first_sample + (wrong - intervals.begin()) * file.integrator.samples_per_interval();
    return input_error(source.path() + ": from sample " + std::to_string(at) + " on: more than any unit can feel");
  }
  return found;
}

CalibratedSource::CalibratedSource(RecordingSource& source, const SensorModel& model, EffectTerms effects)
    : RecordingSource(source.path()), source_(source), model_(model), effects_(std::move(effects)) {
  info_ = source.info();
  info_.gyro_increment = info_.accel_increment = IncrementKind::physical;
  info_.accel_pulse_mps = 0.0;
  segments_ = source.segments();
  damage_ = source.damage();
}

Result<std::unique_ptr<CalibratedSource>> CalibratedSource::of(const ParameterFile& file, const std::string& path,
                                                               RecordingSource& source) {
  TRY(check_applicable(file, path, source.info()));
  EffectTerms effects = TRY(EffectTerms::of(file, path, source));
  const SensorModel model = sensor_model(from_vector(file.parameters), source.info());
  return std::unique_ptr<CalibratedSource>(new CalibratedSource(source, model, std::move(effects)));
}

Status CalibratedSource::stream(const Sink& sink) {
  const double period_s = info_.sample_period_s;
  EffectTerms effects = effects_;  // it goes forward only
  std::vector<ImuSample> calibrated;
  return source_.read([&](std::span<const ImuSample> block) {
    calibrated.assign(block.begin(), block.end());
    for (ImuSample& sample : calibrated) {
      const EffectTerms::Term& effect = effects.at(sample.counter);
      const Eigen::Vector3d dtheta = model_.gyro_scale * Eigen::Vector3d::Map(sample.gyro.data()) -
                                     (model_.gyro_bias_radps + effect.rate_radps) * period_s;
      const Eigen::Vector3d dv = model_.accel_scale * Eigen::Vector3d::Map(sample.accel.data()) -
                                 (model_.accel_bias_mps2 + effect.force_mps2) * period_s;
      Eigen::Vector3d::Map(sample.gyro.data()) = dtheta;
      Eigen::Vector3d::Map(sample.accel.data()) = dv;
    }
    return sink(calibrated);
  });
}

}  // namespace turncal
