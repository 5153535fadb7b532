#include "imu_io/frames/frame_log.h"

#include <fmt/format.h>

#include <algorithm>

#include "imu_io/base/posix_file.h"
#include "imu_io/frames/frame_decoder.h"

namespace turncal {

Result<FrameLog> read_frame_log(const std::string& path, const FrameDescription& frame) {
  const PosixFile file = TRY(PosixFile::open_to_read(path));
  const std::uint64_t size = TRY(file.size());
  constexpr Arrival some_time{0.0, 600.0};
  FrameDecoder decoder(frame);
  FrameLog log;
  for (std::uint64_t at = 0; at < size;) {
    const std::size_t count = TRY(file.read_at(at, decoder.space()));
    if (count == 0) return input_error(path + ": became shorter while it was read");
    at += count;
    decoder.added(count, some_time);
    ImuSample sample;
    FrameDecoder::Next next{};
    while ((next = decoder.next(sample)) == FrameDecoder::Next::sample)
      if (log.samples.empty() || sample.counter > log.samples.back().counter) log.samples.push_back(sample);
    if (next == FrameDecoder::Next::restarted)
      return input_error(fmt::format(
          "{}: near byte {}, after {} samples: {} and its biases may be others: expected the log of one session", path,
          at, log.samples.size(), decoder.restart_reason()));
  }
  const ScanCounters& scan = decoder.scan();
  const ImuLinkCounters link = decoder.counters();
  log.summary = fmt::format(
      "{} bytes, {} frames of {}, {} bad, {} bytes of none, {} samples lost, {} duplicates, {} strays, {} flagged",
      size, scan.frames, frame.name, link.bad_frames, scan.skipped_bytes, link.lost_samples, link.duplicates,
      decoder.strays(), decoder.invalid());
  if (log.samples.empty())
    return input_error(
        fmt::format("{}: no sample in it by the frame description {}: {}", path, frame.name, log.summary));
  return log;
}

}  // namespace turncal
