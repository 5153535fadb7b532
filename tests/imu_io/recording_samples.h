// Recordings for the tests: every field in use, with gaps, flags and missing temperatures; and reading one whole.
#pragma once

#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_writer.h"
#include "tests/test.h"

namespace turncal::test {

inline RecordingInfo make_info(IncrementKind gyro = IncrementKind::pulses, IncrementKind accel = IncrementKind::pulses,
                               bool has_temperature = true) {
  RecordingInfo info;
  info.sample_period_s = 0.005;
  info.latitude_deg = 29.53;
  info.gravity_mps2 = 9.7914;
  info.unit_serial = "LG-7";
  info.gyro_increment = gyro;
  info.accel_increment = accel;
  info.accel_pulse_mps = accel == IncrementKind::pulses ? 0.0005 : 0.0;
  info.has_temperature = has_temperature;
  return info;
}

// Every 97th sample is missing before, every 31st flagged, every 13th without temperature.
inline std::vector<ImuSample> make_samples(const RecordingInfo& info, std::size_t count, std::int64_t first = -5,
                                           unsigned seed = 1) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<ImuSample> samples(count);
  std::int64_t counter = first;
  for (std::size_t i = 0; i < count; ++i) {
    ImuSample& sample = samples[i];
    if (i % 97 == 96) counter += 3;
    sample.counter = counter++;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto pulses = [&] { return double(std::int32_t(random())); };
      sample.gyro[axis] = info.gyro_increment == IncrementKind::pulses ? pulses() : 1e-5 * normal(random);
      sample.accel[axis] = info.accel_increment == IncrementKind::pulses ? pulses() : 0.05 * normal(random);
    }
    if (info.gyro_increment == IncrementKind::physical && i % 7 == 0) sample.gyro[1] = -0.0;
    if (info.has_temperature && i % 13 != 12) sample.temperature_c = float(24.0 + 3.0 * normal(random));
    if (info.has_temperature && i % 13 == 5) sample.temperature_c = -0.0F;
    const auto any = std::bit_cast<float>(std::uint32_t(random()));
    if (info.has_temperature && i % 13 == 7 && std::isfinite(any)) sample.temperature_c = any;
    if (i % 31 == 30) sample.flags = sample_flag_invalid + std::uint32_t(i);
  }
  return samples;
}

// Of a unit that was calibrated: every kind of key in use.
inline ParameterFile make_parameter_file() {
  ParameterFile file;
  describe_recording(make_info(), file);
  file.recording_hash = "c9a8024e345e5f3f127138fb58be5abe";
  file.model = "extended";
  file.method = "joint";
  file.software_version = "0.1.0";
  file.time_utc = "2026-01-31T12:00:00Z";
  for (std::size_t i = 0; i < parameter_keys.size(); ++i)
    if (parameter_is_free[i]) file.sigma[i] = 1e-7 * double(i + 1);
  file.effects = {{"accel_size_effect", "x_rx", 12.5, 0.25}, {"gyro_warm_up", "tau_s", 600.0, {}}};
  return file;
}

inline bool same(const ImuSample& a, const ImuSample& b) {
  const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (bits(a.gyro[axis]) != bits(b.gyro[axis]) || bits(a.accel[axis]) != bits(b.accel[axis])) return false;
  const bool same_temperature = std::isnan(a.temperature_c) ? std::isnan(b.temperature_c)
                                                            : std::bit_cast<std::uint32_t>(a.temperature_c) ==
                                                                  std::bit_cast<std::uint32_t>(b.temperature_c);
  return a.counter == b.counter && a.flags == b.flags && same_temperature;
}

inline bool same(const Segment& a, const Segment& b) {
  const auto all = [](const Segment& s) {
    return std::tie(s.step, s.kind, s.start_sample, s.end_sample, s.heading_deg, s.pitch_deg, s.roll_deg);
  };
  return all(a) == all(b);
}

template <class Thing>
bool all_same(const std::vector<Thing>& a, const std::vector<Thing>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Thing& x, const Thing& y) { return same(x, y); });
}

template <class Thing>
void expect_same(const std::vector<Thing>& a, const std::type_identity_t<std::vector<Thing>>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_TRUE(same(a[i], b[i])) << "number " << i;
}

// Throws where it cannot be: the test fails with the message.
inline std::unique_ptr<RecordingSource> opened(const std::string& path) {
  auto source = RecordingSource::open(path);
  if (!source) throw std::runtime_error(source.error().message);
  return std::move(*source);
}

inline std::vector<ImuSample> read_all(RecordingSource& source) {
  std::vector<ImuSample> all;
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    EXPECT_FALSE(samples.empty());
    all.insert(all.end(), samples.begin(), samples.end());
    return Status();
  });
  EXPECT_OK(status);
  return all;
}

inline Segment make_segment(int step, SegmentKind kind, std::int64_t start, std::int64_t end, double heading = 0.0,
                            double pitch = 0.0, double roll = 0.0) {
  return {step, kind, start, end, heading, pitch, roll};
}

inline void write_segment(RecordingWriter& writer, const Segment& segment, std::span<const ImuSample> samples = {}) {
  ASSERT_OK(writer.begin_segment(segment));
  ASSERT_OK(writer.add(samples));
  ASSERT_OK(writer.end_segment(segment.kind, segment.end_sample,
                               {{segment.heading_deg, segment.pitch_deg, segment.roll_deg}}));
}

}  // namespace turncal::test
