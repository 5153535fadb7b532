#include "imu_io/recordings/binary_layout.h"

#include <cassert>
#include <cmath>
#include <limits>
#include <string>

#include "imu_io/base/bytes.h"
#include "imu_io/recordings/recording_check.h"

namespace turncal {
namespace {

constexpr std::size_t gap_bytes = 12;
constexpr std::size_t flag_bytes = 8;

std::size_t increment_bytes(IncrementKind kind) { return kind == IncrementKind::pulses ? 4 : 8; }

void append_triple(std::vector<std::byte>& out, const std::array<double, 3>& value, IncrementKind kind) {
  for (const double x : value) {
    if (kind == IncrementKind::pulses) {
      append_bytes(out, static_cast<std::int32_t>(x));
    } else {
      append_bytes(out, x);
    }
  }
}

void decode_triples(const std::byte* from, IncrementKind kind, std::array<double, 3> ImuSample::*field,
                    std::vector<ImuSample>& out) {
  if (kind == IncrementKind::pulses) {
    for (ImuSample& sample : out) {
      for (double& x : sample.*field) {
        x = load_bytes<std::int32_t>(from);
        from += 4;
      }
    }
  } else {
    for (ImuSample& sample : out) {
      for (double& x : sample.*field) {
        x = load_bytes<double>(from);
        from += 8;
      }
    }
  }
}

bool is_kind(std::uint8_t value) { return value <= 1; }

}  // namespace

void append_info(std::vector<std::byte>& out, const RecordingInfo& info) {
  append_bytes(out, recording_version);
  append_bytes(out, info.sample_period_s);
  append_bytes(out, info.latitude_deg);
  append_bytes(out, info.gravity_mps2);
  append_bytes(out, info.accel_pulse_mps);
  append_bytes(out, static_cast<std::uint8_t>(info.gyro_increment == IncrementKind::pulses ? 0 : 1));
  append_bytes(out, static_cast<std::uint8_t>(info.accel_increment == IncrementKind::pulses ? 0 : 1));
  append_bytes(out, static_cast<std::uint8_t>(info.has_temperature ? 1 : 0));
  append_bytes(out, static_cast<std::uint8_t>(info.simulated ? 1 : 0));
  append_bytes(out, static_cast<std::uint32_t>(info.unit_serial.size()));
  append_bytes(out, std::string_view(info.unit_serial));
  if (info.started_utc_s) append_bytes(out, *info.started_utc_s);
}

Result<RecordingInfo> parse_info(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  const auto version = reader.get<std::uint32_t>();
  if (!reader.good()) return input_error("its first record is too short");
  if (version != recording_version) {
    return input_error("recording format " + std::to_string(version) + ": expected " +
                       std::to_string(recording_version));
  }
  RecordingInfo info;
  info.sample_period_s = reader.get<double>();
  info.latitude_deg = reader.get<double>();
  info.gravity_mps2 = reader.get<double>();
  info.accel_pulse_mps = reader.get<double>();
  const auto gyro = reader.get<std::uint8_t>();
  const auto accel = reader.get<std::uint8_t>();
  const auto temperature = reader.get<std::uint8_t>();
  const auto simulated = reader.get<std::uint8_t>();
  const auto serial = reader.get_bytes(reader.get<std::uint32_t>());
  if (reader.good() && !reader.at_end()) info.started_utc_s = reader.get<std::int64_t>();
  if (!reader.at_end() || !is_kind(gyro) || !is_kind(accel) || temperature > 1 || simulated > 1) {
    return input_error("its first record makes no sense");
  }
  info.gyro_increment = gyro == 0 ? IncrementKind::pulses : IncrementKind::physical;
  info.accel_increment = accel == 0 ? IncrementKind::pulses : IncrementKind::physical;
  info.has_temperature = temperature == 1;
  info.simulated = simulated == 1;
  info.unit_serial.assign(reinterpret_cast<const char*>(serial.data()), serial.size());
  TRY(check_info(info, "its first record"));
  return info;
}

void append_segment(std::vector<std::byte>& out, const Segment& segment) {
  append_bytes(out, static_cast<std::int32_t>(segment.step));
  append_bytes(out, static_cast<std::uint32_t>(segment.kind));
  append_bytes(out, segment.start_sample);
  append_bytes(out, segment.end_sample);
  append_bytes(out, segment.heading_deg);
  append_bytes(out, segment.pitch_deg);
  append_bytes(out, segment.roll_deg);
}

std::optional<Segment> parse_segment(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  Segment segment;
  segment.step = reader.get<std::int32_t>();
  const auto kind = reader.get<std::uint32_t>();
  segment.start_sample = reader.get<std::int64_t>();
  segment.end_sample = reader.get<std::int64_t>();
  segment.heading_deg = reader.get<double>();
  segment.pitch_deg = reader.get<double>();
  segment.roll_deg = reader.get<double>();
  const bool finite =
      std::isfinite(segment.heading_deg) && std::isfinite(segment.pitch_deg) && std::isfinite(segment.roll_deg);
  if (!reader.at_end() || kind > static_cast<std::uint32_t>(SegmentKind::rotate) || !finite) return {};
  segment.kind = static_cast<SegmentKind>(kind);
  return segment;
}

const char* check_sample(const ImuSample& sample, const RecordingInfo& info) {
  const auto whole = [](double x) {
    return x >= std::numeric_limits<std::int32_t>::min() && x <= std::numeric_limits<std::int32_t>::max() &&
           x == static_cast<std::int32_t>(x);
  };
  if (sample.counter < -max_counter || sample.counter > max_counter) return "counter out of range";
  for (const double x : sample.gyro) {
    if (info.gyro_increment == IncrementKind::pulses ? !whole(x) : !std::isfinite(x)) {
      return info.gyro_increment == IncrementKind::pulses ? "gyro: expected whole pulses that fit into 32 bits"
                                                          : "gyro: expected finite numbers";
    }
  }
  for (const double x : sample.accel) {
    if (info.accel_increment == IncrementKind::pulses ? !whole(x) : !std::isfinite(x)) {
      return info.accel_increment == IncrementKind::pulses ? "accel: expected whole pulses that fit into 32 bits"
                                                           : "accel: expected finite numbers";
    }
  }
  if (std::isinf(sample.temperature_c)) return "temperature_c: expected a finite number";
  return nullptr;
}

void append_samples(std::vector<std::byte>& out, std::span<const ImuSample> samples, const RecordingInfo& info) {
  assert(!samples.empty());
  std::uint32_t gaps = 0;
  std::uint32_t flagged = samples[0].flags != 0 ? 1 : 0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    if (samples[i].counter != samples[i - 1].counter + 1) ++gaps;
    if (samples[i].flags != 0) ++flagged;
  }
  append_bytes(out, samples[0].counter);
  append_bytes(out, static_cast<std::uint32_t>(samples.size()));
  append_bytes(out, gaps);
  append_bytes(out, flagged);
  for (std::size_t i = 1; gaps > 0 && i < samples.size(); ++i) {
    if (samples[i].counter == samples[i - 1].counter + 1) continue;
    append_bytes(out, static_cast<std::uint32_t>(i));
    append_bytes(out, samples[i].counter);
  }
  for (std::size_t i = 0; flagged > 0 && i < samples.size(); ++i) {
    if (samples[i].flags == 0) continue;
    append_bytes(out, static_cast<std::uint32_t>(i));
    append_bytes(out, samples[i].flags);
  }
  for (const ImuSample& sample : samples) append_triple(out, sample.gyro, info.gyro_increment);
  for (const ImuSample& sample : samples) append_triple(out, sample.accel, info.accel_increment);
  if (!info.has_temperature) return;
  for (const ImuSample& sample : samples) append_bytes(out, sample.temperature_c);
}

std::optional<SampleChunk> parse_samples(std::span<const std::byte> payload, const RecordingInfo& info) {
  ByteReader reader(payload);
  SampleChunk chunk;
  chunk.first_counter = reader.get<std::int64_t>();
  chunk.count = reader.get<std::uint32_t>();
  const auto gaps = reader.get<std::uint32_t>();
  const auto flagged = reader.get<std::uint32_t>();
  chunk.gaps = reader.get_bytes(std::uint64_t{gaps} * gap_bytes);
  chunk.flags = reader.get_bytes(std::uint64_t{flagged} * flag_bytes);
  chunk.gyro = reader.get_bytes(std::uint64_t{chunk.count} * 3 * increment_bytes(info.gyro_increment)).data();
  chunk.accel = reader.get_bytes(std::uint64_t{chunk.count} * 3 * increment_bytes(info.accel_increment)).data();
  if (info.has_temperature) chunk.temperature = reader.get_bytes(std::uint64_t{chunk.count} * 4).data();
  if (!reader.at_end() || chunk.count == 0) return {};

  // Walk the gaps: indices and counters must increase, and nothing may overflow on the way.
  if (chunk.first_counter < -max_counter || chunk.first_counter > max_counter) return {};
  std::uint32_t index = 0;
  std::int64_t counter = chunk.first_counter;
  for (std::size_t i = 0; i < gaps; ++i) {
    const auto next = load_bytes<std::uint32_t>(chunk.gaps.data() + i * gap_bytes);
    const auto next_counter = load_bytes<std::int64_t>(chunk.gaps.data() + i * gap_bytes + 4);
    if (next <= index || next >= chunk.count || next_counter > max_counter) return {};
    if (next_counter <= counter + (next - index)) return {};
    index = next;
    counter = next_counter;
  }
  chunk.last_counter = counter + (chunk.count - 1 - index);
  for (std::size_t i = 0; i < flagged; ++i) {
    if (load_bytes<std::uint32_t>(chunk.flags.data() + i * flag_bytes) >= chunk.count) return {};
  }
  return chunk;
}

void decode_samples(const SampleChunk& chunk, const RecordingInfo& info, std::vector<ImuSample>& out) {
  out.resize(chunk.count);
  std::int64_t counter = chunk.first_counter;
  constexpr float not_measured = std::numeric_limits<float>::quiet_NaN();
  const std::byte* temperature = chunk.temperature;
  for (ImuSample& sample : out) {
    sample.counter = counter++;
    sample.flags = 0;
    sample.temperature_c = not_measured;
    if (temperature != nullptr) {
      // One kind of NaN, so that the content hash does not depend on who wrote it.
      const auto value = load_bytes<float>(temperature);
      if (value == value) sample.temperature_c = value;
      temperature += 4;
    }
  }
  for (std::size_t place = 0; place < chunk.gaps.size(); place += gap_bytes) {
    const auto index = load_bytes<std::uint32_t>(chunk.gaps.data() + place);
    counter = load_bytes<std::int64_t>(chunk.gaps.data() + place + 4);
    const bool is_last = place + gap_bytes == chunk.gaps.size();
    const std::uint32_t until =
        is_last ? chunk.count : load_bytes<std::uint32_t>(chunk.gaps.data() + place + gap_bytes);
    for (std::uint32_t i = index; i < until; ++i) out[i].counter = counter++;
  }
  for (std::size_t place = 0; place < chunk.flags.size(); place += flag_bytes) {
    out[load_bytes<std::uint32_t>(chunk.flags.data() + place)].flags =
        load_bytes<std::uint32_t>(chunk.flags.data() + place + 4);
  }
  decode_triples(chunk.gyro, info.gyro_increment, &ImuSample::gyro, out);
  decode_triples(chunk.accel, info.accel_increment, &ImuSample::accel, out);
}

void append_end(std::vector<std::byte>& out, std::uint64_t samples) { append_bytes(out, samples); }

std::optional<std::uint64_t> parse_end(std::span<const std::byte> payload) {
  ByteReader reader(payload);
  const auto samples = reader.get<std::uint64_t>();
  if (!reader.at_end()) return {};
  return samples;
}

}  // namespace turncal
