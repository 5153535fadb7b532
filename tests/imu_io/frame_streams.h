// Frames for tests: bytes from hex, samples that a frame can hold, streams of frames, and the samples that come out of one.
#pragma once

#include "tests/test.h"

#include <regex>

#include "imu_io/base/text.h"
#include "imu_io/frames/frame_decoder.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"

namespace turncal::test {

using Bytes = std::vector<std::byte>;

inline Bytes from_hex(std::string_view hex) {
  Bytes bytes;
  const auto digit = [](char c) { return unsigned(c <= '9' ? c - '0' : c - 'A' + 10); };
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::byte>(digit(hex[i]) << 4 | digit(hex[i + 1])));
  return bytes;
}

inline FrameDescription frame_named(const std::string& name) { return expect_value(find_frame(name)); }

// A built-in description with lines added or replaced: "key = value".
inline FrameDescription frame_with(const std::string& name, const std::vector<std::string>& lines) {
  std::string text;
  std::string_view rest = builtin_frame_text(name);
  const auto key_of = [](std::string_view line) { return line.substr(0, line.find(' ')); };
  while (!rest.empty()) {
    const std::string_view line = next_line(rest);
    const bool replaced = std::ranges::any_of(lines, [&](const std::string& l) { return key_of(l) == key_of(line); });
    if (!replaced) text += std::string(line) + "\n";
  }
  for (const std::string& line : lines) text += line + "\n";
  auto frame = parse_frame_description(text, name);
  EXPECT_OK(frame) << "\n" << text;
  return frame.value();
}

// Puts the right check after what was changed on purpose.
inline void seal(const FrameDescription& frame, std::span<std::byte> bytes) {
  const std::uint32_t value = frame_check_value(frame.check, Crc(frame.check.crc), bytes);
  frame.check.field.put_bits_at(bytes.data() + check_offset(frame.check, bytes.size()), value);
}

// Pulses over the whole width, of every sign; temperatures on the grid of 0.01.
inline std::vector<ImuSample> pulse_samples(std::size_t count, unsigned seed = 1, std::int64_t first = 0) {
  std::mt19937_64 random(seed);
  std::vector<ImuSample> samples(count);
  for (std::size_t i = 0; i < count; ++i) {
    ImuSample& sample = samples[i];
    sample.counter = first + std::int64_t(i);
    for (std::size_t k = 0; k < 3; ++k) {
      const int down = int(random() % 32);
      sample.gyro[k] = double(std::int32_t(random()) >> down);
      sample.accel[k] = double(std::int32_t(random()) >> down);
      sample.gyro[k] = std::max(sample.gyro[k], -2147483647.0);
      sample.accel[k] = std::max(sample.accel[k], -2147483647.0);
    }
    sample.temperature_c = float(0.01 * double(int(random() % 8000) - 2000));
  }
  return samples;
}

// Nothing but a number and a temperature.
inline std::vector<ImuSample> numbered(std::int64_t first, std::int64_t count, float temperature_c = 25.0F) {
  std::vector<ImuSample> samples(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].counter = first + std::int64_t(i);
    samples[i].temperature_c = temperature_c;
  }
  return samples;
}

inline Bytes encode_all(const FrameDescription& frame, const std::vector<ImuSample>& samples) {
  FrameEncoder encoder(frame);
  Bytes stream(samples.size() * encoder.length());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Status status = encoder.encode(samples[i], std::span(stream).subspan(i * encoder.length(), encoder.length()));
    EXPECT_OK(status);
  }
  return stream;
}

// With what goes over the line beside the frames' own bytes.
inline Bytes on_the_line(const FrameDescription& frame, const std::vector<ImuSample>& samples) {
  FrameEncoder encoder(frame);
  Bytes stream;
  for (const ImuSample& sample : samples) EXPECT_OK(encoder.append(sample, stream));
  return stream;
}

// Feeds a decoder as a line would: frame n of a unit ends at (n + 1) periods; `lateness_s` comes on top.
class Line {
 public:
  explicit Line(const FrameDescription& frame) : decoder(frame), period_s_(frame.sample_period_s) {}

  void feed(std::span<const std::byte> bytes) { feed(bytes, {time_s, time_s}); }
  void feed(std::span<const std::byte> bytes, const Arrival& arrival) {
    while (!bytes.empty() && !restarted) {  // nobody reads a unit that began anew
      const auto room = decoder.space();
      const std::size_t n = std::min(room.size(), bytes.size());
      ASSERT_GT(n, 0U);
      std::copy_n(bytes.begin(), n, room.begin());
      decoder.added(n, arrival);
      bytes = bytes.subspan(n);
      drain();
    }
  }
  // A whole stream in pieces, of which nobody knows when they came.
  void feed_pieces(std::span<const std::byte> stream, std::size_t piece) {
    for (; !stream.empty(); stream = stream.subspan(std::min(piece, stream.size())))
      feed(stream.first(std::min(piece, stream.size())), {0.0, 1e6});
  }
  // A stream in pieces of a frame, each a period later.
  void feed_paced(std::span<const std::byte> stream, std::size_t length) {
    for (; !stream.empty(); stream = stream.subspan(std::min(length, stream.size()))) {
      time_s += period_s_;
      feed(stream.first(std::min(length, stream.size())));
    }
  }
  // One frame after another, each a period later.
  void feed_frames(const FrameDescription& frame, const std::vector<ImuSample>& sent) {
    FrameEncoder encoder(frame);
    for (const ImuSample& sample : sent) {
      Bytes bytes;
      ASSERT_OK(encoder.append(sample, bytes));
      time_s += period_s_;
      feed(bytes);
    }
  }
  // Nothing comes for so long.
  void idle(double seconds) {
    time_s += seconds;
    decoder.idle(time_s);
    drain();
  }
  void drain() {
    for (;;) {
      ImuSample sample;
      const auto next = decoder.next(sample);
      restarted = restarted || next == FrameDecoder::Next::restarted;
      if (next != FrameDecoder::Next::sample) return;
      samples.push_back(sample);
    }
  }

  FrameDecoder decoder;
  std::vector<ImuSample> samples;
  bool restarted = false;
  double time_s = 100.0;

 private:
  double period_s_;
};

inline bool same_values(const ImuSample& a, const ImuSample& b) {
  const bool same_temperature = (std::isnan(a.temperature_c) && std::isnan(b.temperature_c)) ||
                                std::abs(a.temperature_c - b.temperature_c) < 1e-4F;
  return a.counter == b.counter && a.gyro == b.gyro && a.accel == b.accel && a.flags == b.flags && same_temperature;
}

// Every sample that came out was sent, in order. Returns how many of those sent are missing.
inline std::size_t expect_only_sent(const std::vector<ImuSample>& out, const std::vector<ImuSample>& sent) {
  std::size_t at = 0;
  for (const ImuSample& sample : out) {
    while (at < sent.size() && sent[at].counter < sample.counter) ++at;
    if (at >= sent.size() || !same_values(sample, sent[at])) {
      ADD_FAILURE() << "a sample that was never sent, counter " << sample.counter;
      return sent.size();
    }
    ++at;
  }
  return sent.size() - out.size();
}

// A frame's text without the marks that say where its lines come from, so that lines can be found in it.
inline std::string unmarked(std::string_view text) {
  return std::regex_replace(std::string(text), std::regex(" +# \\[[a-z]+\\]"), "");
}

}  // namespace turncal::test
