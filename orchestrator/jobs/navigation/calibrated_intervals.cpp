#include "orchestrator/jobs/navigation/calibrated_intervals.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "calib/joint/joint_estimate.h"
#include "calib/model/effects.h"
#include "calib/rests/rest_data.h"
#include "calib/statistics/compression.h"
#include "calib/statistics/data_screen.h"
#include "calib/statistics/segmentation.h"
#include "imu_io/base/text.h"
#include "orchestrator/jobs/calibration_job.h"

namespace turncal {

namespace {

Result<std::vector<EffectColumn>> columns_of(const ParameterFile& file, const std::string& file_name,
                                             const RecordingInfo& info, bool has_attitude, Eigen::VectorXd& values) {
  std::vector<EffectColumn> columns;
  std::vector<double> found;
  for (const EffectValue& effect : file.effects) {
    const auto refuse = [&](const std::string& why) {
      return input_error("{}: 'effect.{}.{}' {}", file_name, effect.name, effect.component, why);
    };
    const EffectEntry* entry = find_effect(effect.name);
    if (entry == nullptr) return refuse("is not an effect of the catalogue");
    if (effect.component == entry->variant) continue;
    const auto at = std::ranges::find(entry->components, effect.component);
    if (at == entry->components.end()) return refuse("is not a component of " + effect.name);
    if (entry->needs_temperature && !info.has_temperature)
      return refuse("depends on temperature, which the recording does not have");
    if ((effect.name == "earth_rate" || effect.name == "gyro_magnetic") && !has_attitude)
      return refuse("depends on the attitude, which a recording without table angles does not tell");
    EffectColumn column{entry, int(at - entry->components.begin()), 0.0};
    if (!entry->taus_s.empty()) {
      const auto tau = std::ranges::find_if(
          file.effects, [&](const EffectValue& e) { return e.name == effect.name && e.component == entry->variant; });
      if (tau == file.effects.end())
        return input_error("{}: missing key 'effect.{}.{}'", file_name, effect.name, entry->variant);
      column.tau_s = tau->value;
    }
    columns.push_back(column);
    found.push_back(effect.value);
  }
  values = Eigen::Map<Eigen::VectorXd>(found.data(), Eigen::Index(found.size()));
  return columns;
}

Error bad_value(const std::string& file_name, const std::string& key, const std::string& value, const char* expected) {
  return input_error(file_name + ": key '" + key + "' = '" + value + "': expected " + expected);
}

// Reads a key into `value` (times `unit`) if it is there.
Status take(const ParameterFile& file, const std::string& file_name, const std::string& key, double unit,
            double& value) {
  const std::string* const text = find_further(file, key);
  if (text == nullptr) return {};
  const std::optional<double> number = parse_number(*text);
  if (!number || *number < 0.0) return bad_value(file_name, key, *text, "a number of 0 or more");
  value = *number * unit;
  return {};
}

constexpr std::int64_t no_end = std::numeric_limits<std::int64_t>::max();

// Finds the samples that a calibration would reject. Hands and vehicles jerk, so for them only physically impossible samples count.
class FaultySamples {
 public:
  // An outlier is recognised after this many later samples.
  static constexpr std::size_t settled_after = 3;

  FaultySamples(const RecordingInfo& info, const Segments& segments, bool on_table)
      : segments_(segments.empty() ? Segments{{.kind = SegmentKind::align, .end_sample = no_end}} : segments),
        compressor_(info, on_table ? CompressionOptions{} : rest_compression_options()),
        feed_(compressor_, segments_) {}
  void add(std::span<const ImuSample> samples) { feed_.add(samples); }
  // Returns the impossible channel of a sample, if any; call it in counter order, for samples that have settled. A value that rises and
  // stays up is the beginning of a turn, not an outlier.
  std::optional<std::size_t> fault_of(const ImuSample& before, const ImuSample& sample, const ImuSample& after) {
    const std::int64_t counter = sample.counter;
    const std::vector<DataEvent>& events = compressor_.recording().events;
    while (next_ < events.size() && events[next_].sample + std::int64_t(settled_after) < counter) ++next_;
    for (std::size_t k = next_; k < events.size(); ++k) {
      const bool gyro = events[k].kind == DataEvent::Kind::gyro_glitch;
      if (events[k].sample != counter || !(gyro || events[k].kind == DataEvent::Kind::accel_glitch)) continue;
      const auto channel = std::size_t(events[k].axis + (gyro ? 0 : 3));
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

// Gaps are filled, interval by interval. A longer loss is a counter that jumped, or two recordings in one.
constexpr double most_lost_s = 86400.0;

// Returns whether a unit on a table, in a hand or in a vehicle can experience an interval's motion.
bool can_be(const MotionInterval& interval) {
  constexpr double most_mps2 = 1e4;
  return interval.push_mps.norm() <= most_mps2 * interval.duration_s && interval.turn.coeffs().allFinite();
}

}  // namespace

Result<EffectTerms> EffectTerms::of(const ParameterFile& file, const std::string& file_name, RecordingSource& source,
                                    const CompressedRecording* given) {
  EffectTerms terms;
  if (file.effects.empty()) return terms;
  const bool by_hand = without_table_angles(source.segments());
  Eigen::VectorXd values;
  const std::vector<EffectColumn> columns = TRY(columns_of(file, file_name, source.info(), !by_hand, values));
  auto model = make_effect_model(columns, {source.info().latitude_deg}, file.reference_temperature_c.value_or(0.0));
  model.values = values;
  if (source.segments().empty()) {
    TRY(terms.of_motion_alone(source, file, model));
    return terms;
  }
  std::optional<LoadedRecording> loaded;
  if (given == nullptr) loaded = TRY(load_recording(source, {}, {}, all_steps));
  const CompressedRecording& recording = given != nullptr ? *given : loaded->data;
  if (recording.blocks.empty())
    return input_error(source.path() + ": has no segments, expected some to evaluate effects over");

  FilterSetup setup;
  setup.with_columns = false;
  setup.keep_taken_off = true;
  setup.noise.accel_pulse_mps =
      recording.info.accel_increment == IncrementKind::pulses ? recording.info.accel_pulse_mps : 0.0;
  faults_from_events(recording, setup.breaks);
  const FilterResult result = run_filter(recording, from_vector(file.parameters), model, setup);
  for (std::size_t k = 0; k < recording.blocks.size(); ++k) {
    const double t = recording.blocks[k].duration_s;
    terms.starts_.push_back(recording.blocks[k].start_sample);
    terms.terms_.push_back({result.taken_off[k].turn_rad / t, result.taken_off[k].push_mps / t});
  }
  return terms;
}

Status EffectTerms::of_motion_alone(RecordingSource& source, const ParameterFile& file, EffectModel model) {
  Compressor compressor(source.info());
  Segment whole;
  whole.kind = SegmentKind::rotate;
  compressor.begin_segment(whole);
  TRY(source.read([&](std::span<const ImuSample> samples) {
    compressor.add(samples);
    return Status{};
  }));
  const CompressedRecording recording = compressor.take();
  const SensorModel sensors = sensor_model(from_vector(file.parameters), recording.info);
  const std::vector<Block>& blocks = recording.blocks;
  const auto rate = [&](const Block& b) -> Eigen::Vector3d {
    return sensors.gyro_scale * b.gyro / b.duration_s - sensors.gyro_bias_radps;
  };
  EffectRegressors regressors(model.columns);
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const Block& block = blocks[k];
    const Block& before = blocks[k > 0 ? k - 1 : k];
    const Block& after = blocks[std::min(k + 1, blocks.size() - 1)];
    BlockState s;
    s.f_b = sensors.accel_scale * block.accel / block.duration_s - sensors.accel_bias_mps2;
    s.w_b = rate(block);
    s.w_dot_b.setZero();
    if (&before != &after)
      s.w_dot_b = (rate(after) - rate(before)) / (recording.middle_s(after) - recording.middle_s(before));
    s.C_nb.setIdentity();  // effects that need it were rejected
    s.duration_s = block.duration_s;
    s.time_s = recording.middle_s(block);
    s.since_rotation_s = 1e9;
    take_temperature(block, model.reference_temperature_c, s);
    model.regressors(s, regressors);
    starts_.push_back(block.start_sample);
    terms_.push_back({regressors.gyro * model.values, regressors.accel * model.values});
  }
  return {};
}

const EffectTerms::Term& EffectTerms::at(std::int64_t counter) {
  static const Term none;
  if (terms_.empty()) return none;
  while (index_ + 1 < starts_.size() && counter >= starts_[index_ + 1]) ++index_;
  return terms_[index_];
}

bool has_noise(const ParameterFile& file) {
  return find_further(file, "noise.angle_random_walk.x_deg_per_rt_h") != nullptr;
}

Result<NoiseModel> stored_noise(const ParameterFile& file, const std::string& file_name) {
  NoiseModel noise;
  noise.accel_pulse_mps = file.accel_increment == IncrementKind::pulses ? file.accel_pulse_mps : 0.0;
  for (int k = 0; k < 3; ++k) {
    const std::string axis(1, "xyz"[k]);
    TRY(take(file, file_name, "noise.angle_random_walk." + axis + "_deg_per_rt_h", radprs_per_degprh,
             noise.angle_random_walk[k]));
    TRY(take(file, file_name, "noise.velocity_random_walk." + axis + "_ug_per_rt_hz", mpsprs_per_ugprHz,
             noise.velocity_random_walk[k]));
  }
  for (const auto& [key, unit, value] :
       {std::tuple{"noise.gyro_bias_instability_degph", radps_per_degph, &noise.gyro_bias_instability_radps},
        std::tuple{"noise.accel_bias_instability_ug", mpsprs_per_ugprHz, &noise.accel_bias_instability_mps2},
        std::tuple{"noise.gyro_pulse_arcsec", rad_per_arcsec, &noise.gyro_pulse_rad},
        std::tuple{"noise.bias_correlation_s", 1.0, &noise.bias_correlation_s}})
    TRY(take(file, file_name, key, unit, *value));
  if (noise.bias_correlation_s <= 0.0) return bad_value(file_name, "noise.bias_correlation_s", "0", "a number above 0");
  return noise;
}

Result<StoredCovariance> stored_covariance(const ParameterFile& file, const std::string& file_name) {
  StoredCovariance stored;
  if (!file.effects.empty()) return StoredCovariance{.source = "effects"};
  ParameterVector sigma = ParameterVector::Zero();
  for (int k = 0; k < parameter_count; ++k) sigma[k] = file.sigma[std::size_t(k)].value_or(0.0);
  if (sigma.any()) {
    stored.source = "sigmas";
    stored.covariance = sigma.cwiseAbs2().asDiagonal();
  }
  std::vector<int> rows;  // parameters with a line, in order
  for (int k = 0; k < parameter_count; ++k) {
    const std::string key = "quality.covariance." + parameter_key(k);
    const std::string* const text = find_further(file, key);
    if (text == nullptr) continue;
    rows.push_back(k);
    const std::vector<std::string_view> words = split_words(*text);
    if (words.size() != rows.size())
      return bad_value(file_name, key, *text, (std::to_string(rows.size()) + " numbers").c_str());
    for (std::size_t j = 0; j < words.size(); ++j) {
      const std::optional<double> number = parse_number(words[j]);
      if (!number) return bad_value(file_name, key, std::string(words[j]), "a number");
      stored.covariance(k, rows[j]) = stored.covariance(rows[j], k) = *number;
    }
  }
  if (rows.empty()) return stored;
  stored.source = "covariance";
  ParameterVector scale = ParameterVector::Ones();
  for (const int k : rows) {
    if (!(stored.covariance(k, k) > 0.0))
      return bad_value(file_name, "quality.covariance." + parameter_key(k), format_number(stored.covariance(k, k)),
                       "a variance above 0");
    if (sigma[k] > 0.0) scale[k] = sigma[k] / std::sqrt(stored.covariance(k, k));
  }
  stored.covariance = scale.asDiagonal() * stored.covariance * scale.asDiagonal();
  return stored;
}

SampleCalibration::Increments SampleCalibration::of(const ImuSample& sample, double period_s) {
  // A temperature step of 0.01 C changes less than anything here is known to.
  if (temperature && std::isfinite(sample.temperature_c) && temperature_can_be(sample.temperature_c) &&
      !(std::abs(sample.temperature_c - temperature->now_c) < 0.01F)) {
    temperature->now_c = sample.temperature_c;
    model = sensor_model(from_vector(temperature->polynomials.at(temperature->reference, double(sample.temperature_c))),
                         temperature->info);
  }
  const EffectTerms::Term& effect = effects.at(sample.counter);
  return {model.gyro_scale * Eigen::Vector3d::Map(sample.gyro.data()) -
              period_s * (model.gyro_bias_radps + effect.rate_radps),
          model.accel_scale * Eigen::Vector3d::Map(sample.accel.data()) -
              period_s * (model.accel_bias_mps2 + effect.force_mps2)};
}

std::string describe(const TemperatureCourse& course) {
  std::string words = fmt::format("parameters at the temperature of each sample, {:.2f} to {:.2f} C", course.lowest_c,
                                  course.highest_c);
  if (course.leaves_range())
    words += fmt::format("; OUTSIDE THE RANGE of {:.2f} to {:.2f} C as at its nearer end", course.polynomials.low_c,
                         course.polynomials.high_c);
  return words;
}

std::string distrust_of(const ParameterFile& file, const std::string& path) {
  return is_trusted(file) ? "" : path + ": not trusted: " + why_not_trusted(file);
}

Result<SampleCalibration> SampleCalibration::make(const ParameterFile& file, const std::string& path,
                                                  RecordingSource& source, const CompressedRecording* recording) {
  TRY(check_applicable(file, path, source.info()));
  EffectTerms effects = TRY(EffectTerms::of(file, path, source, recording));
  SampleCalibration made{sensor_model(from_vector(file.parameters), source.info()), std::move(effects)};
  if (!file.temperature) return made;
  constexpr double none = std::numeric_limits<double>::infinity(), longest_silence_s = 60.0;
  double lowest_c = none, highest_c = -none;
  std::optional<double> first_c;
  std::int64_t silent = 0, longest = 0;
  TRY(source.read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples)
      if (std::isfinite(sample.temperature_c) && temperature_can_be(sample.temperature_c)) {
        lowest_c = std::min<double>(lowest_c, sample.temperature_c);
        highest_c = std::max<double>(highest_c, sample.temperature_c);
        if (!first_c) first_c = double(sample.temperature_c);
        silent = 0;
      } else {
        longest = std::max(longest, ++silent);
      }
    return Status{};
  }));
  if (lowest_c > highest_c)
    return input_error(path + ": its parameters depend on temperature (temperature.reference_c), which " +
                       source.path() + " does not have");
  if (const double s = double(longest) * source.info().sample_period_s; s > longest_silence_s)
    return input_error(
        "{}: its parameters depend on temperature, and {} has none for {:.0f} s: expected a reading in "
        "every {:.0f} s",
        path, source.path(), s, longest_silence_s);
  // The first reading holds until then; between readings, the last.
  made.model = sensor_model(from_vector(file.temperature->at(file.parameters, *first_c)), source.info());
  made.temperature = TemperatureCourse{*file.temperature, file.parameters, source.info(), lowest_c, highest_c};
  return made;
}

Result<CalibratedIntervals> calibrated_intervals(ParameterFile file, const std::string& path, RecordingSource& source) {
  const RecordingInfo& info = source.info();
  SampleCalibration calibration = TRY(SampleCalibration::make(file, path, source));
  const int samples = std::max(1, int(std::lround(motion_interval_s / info.sample_period_s)));
  return CalibratedIntervals{path, std::move(file), std::move(calibration),
                             IncrementIntegrator(info.sample_period_s, samples)};
}

Result<IntegratedSamples> integrate_recording(RecordingSource& source, const Stretch& stretch,
                                              std::vector<CalibratedIntervals>& files,
                                              const ReferenceTrack* reference) {
  const double period_s = source.info().sample_period_s;
  RestOf rest(source.segments());
  std::optional<std::int64_t> first;
  std::int64_t begin = 0, end = 0;
  IntegratedSamples found;
  std::optional<std::int64_t> last;  // last sample taken
  // A recording that is at rest all the time is not jerked by hand, whatever its table angles.
  const bool turns =
      std::ranges::find(source.segments(), SegmentKind::rotate, &Segment::kind) != source.segments().end();
  const bool on_table =
      reference == nullptr && !source.segments().empty() && (!turns || !without_table_angles(source.segments()));
  FaultySamples faulty(source.info(), source.segments(), on_table);
  bool gyro_lives = false, accel_lives = false;
  std::vector<ImuSample> waiting;  // not yet settled
  double lost_s = 0.0;
  ImuSample before{};
  const auto take = [&](std::size_t count) -> Status {
    for (std::size_t k = 0; k < count; ++k) {
      const ImuSample& sample = waiting[k];
      const ImuSample previous = std::exchange(before, sample), &after = waiting[std::min(k + 1, waiting.size() - 1)];
      if (sample.counter < begin || sample.counter >= end || (sample.flags & sample_flag_invalid) != 0) continue;
      const auto gyro = Eigen::Vector3d::Map(sample.gyro.data()), accel = Eigen::Vector3d::Map(sample.accel.data());
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
      lost_s += double(gap.samples) * period_s;
      if (lost_s > most_lost_s)
        return input_error(source.path() + ": " + gap_words(gap) + ": expected a recording that lost less than a day");
      if (gap.samples > 0) found.gaps.push_back(gap);
      last = std::max(last.value_or(sample.counter), sample.counter);
      const double time_s = double(sample.counter - *first) * period_s;
      const bool at_rest = rest.at(sample.counter) && (reference == nullptr || reference->stands_at(time_s)),
                 gap_at_rest = gap.is_short() && gap.in_motion == 0;
      for (CalibratedIntervals& file : files) {
        const auto [dtheta_rad, dv_mps] = file.calibration.of(sample, period_s);
        file.integrator.add(sample.counter, dtheta_rad, dv_mps, at_rest, gap_at_rest);
      }
    }
    return {};
  };
  Status status = source.read_to_use([&](std::span<const ImuSample> block) {
    if (!first) {
      first = block.front().counter;
      begin = *first + std::llround(stretch.from_s / period_s);
      const double most = 1e15;  // upper limit of a counter
      end = stretch.to_s ? *first + std::llround(std::min(*stretch.to_s / period_s, most)) : no_end;
      const std::int64_t known = source.segments().empty() ? 0 : source.segments().back().end_sample - begin;
      for (CalibratedIntervals& file : files) file.integrator.reserve(std::clamp<std::int64_t>(known, 0, 100'000'000));
    }
    faulty.add(block);
    waiting.insert(waiting.end(), block.begin(), block.end());
    const std::size_t settled = waiting.size() - std::min(waiting.size(), FaultySamples::settled_after);
    Status taken = take(settled);
    waiting.erase(waiting.begin(), waiting.begin() + std::ptrdiff_t(settled));
    return taken;
  });
  if (status) status = take(waiting.size());
  if (!status) return status.error();
  if (last && !(gyro_lives && accel_lives))
    return input_error(source.path() + ": the " + (gyro_lives ? "accelerometers" : "gyros") +
                       " gave only zeros: expected a unit that senses the Earth's rate and gravity");
  for (const CalibratedIntervals& file : files) {
    const std::vector<MotionInterval>& intervals = file.integrator.intervals();
    const auto wrong = std::ranges::find_if_not(intervals, can_be);
    if (wrong == intervals.end()) continue;
    const std::int64_t at = found.first_sample + (wrong - intervals.begin()) * file.integrator.samples_per_interval();
    return input_error(source.path() + ": from sample " + std::to_string(at) + " on: beyond the range of any unit");
  }
  return found;
}

CalibratedSource::CalibratedSource(RecordingSource& source, SampleCalibration calibration)
    : RecordingSource(source.path()), source_(source), calibration_(std::move(calibration)) {
  info_ = source.info();
  info_.gyro_increment = info_.accel_increment = IncrementKind::physical;
  info_.accel_pulse_mps = 0.0;
  segments_ = source.segments();
  damage_ = source.damage();
}

Status CalibratedSource::stream(const Sink& sink) {
  SampleCalibration calibration = calibration_;  // a copy, because it only goes forward
  std::vector<ImuSample> calibrated;
  return source_.read([&](std::span<const ImuSample> block) {
    calibrated.assign(block.begin(), block.end());
    for (ImuSample& sample : calibrated) {
      const auto [dtheta_rad, dv_mps] = calibration.of(sample, info_.sample_period_s);
      Eigen::Vector3d::Map(sample.gyro.data()) = dtheta_rad;
      Eigen::Vector3d::Map(sample.accel.data()) = dv_mps;
    }
    return sink(calibrated);
  });
}

}  // namespace turncal
