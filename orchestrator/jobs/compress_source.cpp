#include "orchestrator/jobs/compress_source.h"

#include <optional>

#include "calib/rests/rest_data.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/segmentation.h"

namespace turncal {

Result<CompressedRecording> compress_source(RecordingSource& source,
                                            const std::function<void(std::int64_t)>& progress) {
  return compress_source(
      source, without_table_angles(source.segments()) ? rest_compression_options() : CompressionOptions{}, progress);
}

Result<CompressedRecording> compress_source(RecordingSource& source, const CompressionOptions& options,
                                            const std::function<void(std::int64_t)>& progress) {
  if (source.segments().empty()) {
    return input_error(source.path() +
                       ": the recording has no segments, so nothing says when the unit was at rest: expected segments, "
                       "as `turncal segment` finds them");
  }
  Compressor compressor(source.info(), options);
  std::optional<ClippingFinder> clipping;
  if (without_table_angles(source.segments())) clipping.emplace();
  SegmentedFeed feed(compressor, source.segments());
  std::int64_t count = 0;
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    feed.add(samples);
    if (clipping)
      for (const ImuSample& sample : samples) clipping->add(sample);
    count += static_cast<std::int64_t>(samples.size());
    if (progress) progress(count);
    return Status{};
  });
  if (!status) return status.error();
  feed.finish();
  CompressedRecording recording = compressor.take();
  if (clipping) clipping->note(recording.events);
  return recording;
}

}  // namespace turncal
