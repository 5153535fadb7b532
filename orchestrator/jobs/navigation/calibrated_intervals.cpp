#include "orchestrator/jobs/navigation/calibrated_intervals.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

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

}  // namespace

Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source) {
  const RecordingInfo& info = source.info();
  if (Status status = check_applicable(file, path, info); !status) return status.error();
  Result<EffectTerms> effects = EffectTerms::of(file, path, source);
  if (!effects) return effects.error();
  const int samples = std::max(1, static_cast<int>(std::lround(motion_interval_s / info.sample_period_s)));
  const SensorModel model = sensor_model(from_vector(file.parameters), info);
  return CalibratedIntervals{path, std::move(file), model, std::move(*effects),
                             IncrementIntegrator(info.sample_period_s, samples)};
}

Result<CalibratedIntervals> calibrated_intervals(const std::string& path, RecordingSource& source) {
  Result<ParameterFile> file = read_parameter_file(path);
  if (!file) return file.error();
  return calibrated_intervals(std::move(*file), path, source);
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
  Status status = source.read([&](std::span<const ImuSample> block) {
    if (!first) {
      first = block.front().counter;
      begin = *first + std::llround(stretch.from_s / period_s);
      const double most = 1e15;  // of a counter
      end = stretch.to_s ? *first + std::llround(std::min(*stretch.to_s / period_s, most)) : std::int64_t{1} << 62;
      const std::int64_t known = source.segments().empty() ? 0 : source.segments().back().end_sample - begin;
      for (CalibratedIntervals& file : files) file.integrator.reserve(std::clamp<std::int64_t>(known, 0, 100'000'000));
    }
    for (const ImuSample& sample : block) {
      if (sample.counter < begin || sample.counter >= end || (sample.flags & sample_flag_invalid) != 0) continue;
      const Eigen::Vector3d gyro(sample.gyro[0], sample.gyro[1], sample.gyro[2]);
      const Eigen::Vector3d accel(sample.accel[0], sample.accel[1], sample.accel[2]);
      if (!last) found.first_sample = sample.counter;
      const std::int64_t expected = last.value_or(sample.counter - 1) + 1;
      SampleGap gap{expected};
      if (sample.counter > expected)
        gap = {expected, sample.counter - expected, rest.moving_in(expected, sample.counter)};
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
    return Status{};
  });
  if (!status) return status.error();
  return found;
}

}  // namespace turncal
