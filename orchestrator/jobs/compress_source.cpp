#include "orchestrator/jobs/compress_source.h"

#include "calib/rests/rest_data.h"
#include "calib/statistics/segmentation.h"

namespace turncal {

Result<CompressedRecording> compress_source(RecordingSource& source,
                                            const std::function<void(std::int64_t)>& progress) {
  if (source.segments().empty()) {
    return input_error(source.path() +
                       ": the recording has no segments, so nothing says when the unit was at rest: expected segments, "
                       "as `turncal segment` finds them");
  }
  Compressor compressor(source.info(),
                        without_table_angles(source.segments()) ? rest_compression_options() : CompressionOptions{});
  SegmentedFeed feed(compressor, source.segments());
  std::int64_t count = 0;
  const Status status = source.read([&](std::span<const ImuSample> samples) {
    feed.add(samples);
    count += static_cast<std::int64_t>(samples.size());
    if (progress) progress(count);
    return Status{};
  });
  if (!status) return status.error();
  feed.finish();
  return compressor.take();
}

}  // namespace turncal
