#include "imu_io/units/frame_streamer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr std::size_t batch = 32;

}  // namespace

FrameStreamer::FrameStreamer(ImuSource& source, const FrameDescription& frame, UnitEnd& line, double speedup,
                             double patience_s)
    : source_(source),
      frame_(frame),
      encoder_(frame),
      line_(line),
      speedup_(speedup),
      patience_s_(patience_s),
      samples_(batch),
      bytes_() {
  bytes_.reserve(2 * batch * encoder_.length());
}

Status FrameStreamer::start(double now_s) {
  TRY(source_.open());
  RecordingInfo from;
  RecordingInfo to;
  source_.describe(from);
  frame_.describe(to);
  const auto mismatch = [&](const std::string& what) {
    return input_error(frame_.name + ": the frame's " + what + " is not the source's");
  };
  if (std::abs(from.sample_period_s - to.sample_period_s) > 1e-9 * to.sample_period_s)
    return mismatch("sample period of " + format_number(to.sample_period_s) + " s");
  if (from.gyro_increment != to.gyro_increment) return mismatch("gyro increment (pulses or rad)");
  if (from.accel_increment != to.accel_increment) return mismatch("accelerometer increment (pulses or m/s)");
  if (to.accel_increment == IncrementKind::pulses && from.accel_pulse_mps != to.accel_pulse_mps)
    return mismatch("pulse weight of " + format_number(to.accel_pulse_mps) + " m/s");
  start_s_ = now_s;
  steps_ = 0;
  return {};
}

Status FrameStreamer::encode(std::span<const ImuSample> samples) {
  bytes_.clear();
  for (const ImuSample& sample : samples) TRY(encoder_.append(sample, bytes_));
  return {};
}

void FrameStreamer::send(std::size_t samples) {
  // A listener that does not read loses what its buffer cannot hold. Only the first batch waits for it, since time goes on.
  const bool sent = line_.write_all(bytes_, listener_reads_ ? patience_s_ : 0.0).ok();
  listener_reads_ = sent;
  if (sent)
    frames_sent_ += samples;
  else
    ++batches_dropped_;
}

Status FrameStreamer::answer_requests() {
  if (frame_.request.empty()) return {};
  std::array<std::byte, 256> chunk;
  const std::size_t n = TRY(line_.read(chunk, 0.0));
  asked_.insert(asked_.end(), chunk.begin(), chunk.begin() + std::ptrdiff_t(n));
  for (;;) {
    const auto at = std::search(asked_.begin(), asked_.end(), frame_.request.begin(), frame_.request.end());
    if (at == asked_.end()) break;
    asked_.erase(asked_.begin(), at + std::ptrdiff_t(frame_.request.size()));
    if (!bytes_.empty()) send(1);
  }
  if (asked_.size() > frame_.request.size())
    asked_.erase(asked_.begin(), asked_.end() - std::ptrdiff_t(frame_.request.size()));
  return {};
}

Result<std::size_t> FrameStreamer::pump(double now_s) {
  const double due = std::floor((now_s - start_s_) * speedup_ / frame_.sample_period_s + 1e-6);
  std::size_t passed = 0;
  while (double(steps_) < due) {
    const auto count = std::size_t(std::min(due - double(steps_), double(batch)));
    const auto got = source_.read(std::span(samples_).first(count), double(count) * frame_.sample_period_s);
    if (!got) return got.error();
    steps_ += count;
    passed += count;
    const std::span<const ImuSample> made = std::span<const ImuSample>(samples_).first(*got);
    if (frame_.request.empty()) {
      TRY(encode(made));
      send(made.size());
      continue;
    }
    // Encodes every sample, because cumulative fields go on; the last one is kept for requests.
    for (const ImuSample& sample : made)
      if (Status status = encode({&sample, 1}); !status) return status.error();
  }
  TRY(answer_requests());
  return passed;
}

}  // namespace turncal
