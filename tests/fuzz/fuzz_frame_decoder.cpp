// Bytes of a line into the decoder, by each shipped description (byte 0). Byte 1 says how: bit 0 puts sync, length, id, tail and
// check right in every stretch of a frame's length, so that damage after the check is reached too. Whatever comes: samples are
// finite, pulses whole and within 32 bits, counters never fall (two frames of one counter that differ are both given), and the same
// bytes in other pieces give the same samples.
#include <algorithm>
#include <cmath>
#include <vector>

#include "imu_io/frames/frame_decoder.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"
#include "input.h"

namespace turncal {
namespace {

const std::vector<FrameDescription>& frames() {
  static const std::vector<FrameDescription> all = [] {
    std::vector<FrameDescription> result;
    for (const std::string_view name : builtin_frame_names()) result.push_back(find_frame(std::string(name)).value());
    for (const char* change : {"gyro.kind = cumulative\n", "mux.offset = 33\ntemperature.when = 2\n"}) {
      const std::string text = std::string(builtin_frame_text("laser_gyro")) + change;
      result.push_back(parse_frame_description(text, "fuzz").value());
    }
    return result;
  }();
  return all;
}

void put_right(const FrameDescription& frame, std::vector<std::byte>& bytes) {
  const FrameVariant& variant = frame.variants.front();
  const Crc crc(frame.check.crc);
  for (std::size_t at = 0; at + variant.length <= bytes.size(); at += variant.length) {
    const auto one = std::span(bytes).subspan(at, variant.length);
    std::ranges::copy(frame.sync, one.begin());
    std::ranges::copy(frame.tail, one.end() - std::ptrdiff_t(frame.tail.size()));
    if (frame.id) frame.id->put_bits(one.data(), variant.id);
    if (frame.length) {
      const auto raw = (std::int64_t(variant.length) - frame.length_add) / frame.length_scale;
      frame.length->put_bits(one.data(), std::uint64_t(raw));
    }
    if (frame.check.kind == CheckKind::none) continue;
    frame.check.field.put_bits_at(one.data() + check_offset(frame.check, one.size()),
                                  frame_check_value(frame.check, crc, one));
  }
}

std::vector<ImuSample> decode(const FrameDescription& frame, std::span<const std::byte> bytes, std::size_t piece,
                              const Arrival& arrival) {
  FrameDecoder decoder(frame);
  std::vector<ImuSample> samples;
  while (!bytes.empty()) {
    const auto room = decoder.space();
    fuzz::require(!room.empty());
    const std::size_t n = std::min({room.size(), bytes.size(), piece});
    std::copy_n(bytes.begin(), n, room.begin());
    decoder.added(n, arrival);
    bytes = bytes.subspan(n);
    ImuSample sample;
    auto next = decoder.next(sample);
    for (; next == FrameDecoder::Next::sample; next = decoder.next(sample)) samples.push_back(sample);
    if (next == FrameDecoder::Next::restarted) break;
  }
  fuzz::require(decoder.counters().samples == samples.size());
  return samples;
}

}  // namespace
}  // namespace turncal

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const FrameDescription& frame = frames()[input.byte() % frames().size()];
  const std::uint8_t how = input.byte();
  std::vector<std::byte> bytes(input.rest.begin(), input.rest.end());
  if ((how & 1U) != 0) put_right(frame, bytes);
  const Arrival arrival{0.0, (how & 2U) != 0 ? 0.0 : 1e4};
  const auto samples = decode(frame, bytes, 1 + how, arrival);
  const auto again = decode(frame, bytes, 4096, arrival);
  fuzz::require(samples.size() == again.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const ImuSample& sample = samples[i];
    fuzz::require(sample.counter == again[i].counter && sample.gyro == again[i].gyro && sample.accel == again[i].accel);
    fuzz::require(i == 0 || sample.counter >= samples[i - 1].counter);
    for (std::size_t k = 0; k < 3; ++k) {
      fuzz::require(std::isfinite(sample.gyro[k]) && std::isfinite(sample.accel[k]));
      if (!frame.gyro().pulses) continue;
      fuzz::require(std::abs(sample.gyro[k]) <= 2147483647.0 && sample.gyro[k] == std::nearbyint(sample.gyro[k]));
      fuzz::require(std::abs(sample.accel[k]) <= 2147483647.0 && sample.accel[k] == std::nearbyint(sample.accel[k]));
    }
  }
  return 0;
}
