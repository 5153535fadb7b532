// The whole of a recording through a Compressor in one call: `samples` in order, segments as listed (final kinds).
#pragma once

#include <span>

#include "calib/statistics/compression.h"

namespace turncal {

inline constexpr double dt = 0.005;

inline RecordingInfo pulses_info() {
  RecordingInfo info;
  info.sample_period_s = dt;
  info.gravity_mps2 = 9.7914;
  info.accel_pulse_mps = 0.0005;
  return info;
}

inline CompressedRecording compress(const RecordingInfo& info, const Segments& segments,
                                    std::span<const ImuSample> samples, const CompressionOptions& options = {}) {
  Compressor compressor(info, options);
  SegmentedFeed feed(compressor, segments);
  feed.add(samples);
  feed.finish();
  return compressor.take();
}

// As one segment.
inline CompressedRecording compress_as(SegmentKind kind, std::span<const ImuSample> samples,
                                       const CompressionOptions& options = {}) {
  return compress(pulses_info(), {{.kind = kind, .end_sample = samples.back().counter + 1}}, samples, options);
}

}  // namespace turncal
