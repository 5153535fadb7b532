#include "imu_io/recordings/recording_source.h"

#include <sys/stat.h>
#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <type_traits>

#include <fmt/format.h>

#include "calib/statistics/clipping.h"
#include "imu_io/base/bytes.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"

namespace turncal {
namespace {

// Samples are hashed as they are in memory: 64 bytes, no padding, little-endian (checked in bytes.h).
static_assert(sizeof(ImuSample) == 64 && std::is_trivially_copyable_v<ImuSample>);

std::string hash_as_hex(XXH128_hash_t hash) {
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, hash);
  std::string text;
  for (const unsigned char byte : canonical.digest) text += fmt::format("{:02x}", byte);
  return text;
}

using HashState = std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)>;

HashState hash_of(const RecordingInfo& info, const Segments& segments) {
  std::vector<std::byte> bytes;
  append_bytes(bytes, std::string_view("turncal recording 1\n"));
  append_info_fields(bytes, info);
  append_bytes(bytes, std::uint64_t(segments.size()));
  for (const Segment& segment : segments)
    ByteWriter{bytes}(std::int64_t(segment.step), std::uint8_t(segment.kind), segment.start_sample, segment.end_sample,
                      segment.heading_deg, segment.pitch_deg, segment.roll_deg);
  HashState state(XXH3_createState(), XXH3_freeState);
  XXH3_128bits_reset(state.get());
  XXH3_128bits_update(state.get(), bytes.data(), bytes.size());
  return state;
}

}  // namespace

std::string hash_of_text(std::string_view text) { return hash_as_hex(XXH3_128bits(text.data(), text.size())); }

Result<std::unique_ptr<RecordingSource>> RecordingSource::open(const std::string& path) {
  struct stat facts {};
  if (::stat(path.c_str(), &facts) != 0)
    return input_error(path + ": cannot open: " + std::strerror(errno) + file_meant(path));
  TRY(expect_file(path, FileKind::recording));
  if (!S_ISDIR(facts.st_mode)) return open_binary_recording(path);
  const std::string binary = path + "/" + binary_recording_name;
  if (path_exists(binary)) return open_binary_recording(binary);
  if (path_exists(path + "/recording.conf")) return open_text_recording(path);
  if (path_exists(path + "/" + partial_recording_name))
    return input_error(path + ": holds a run that was interrupted: turncal resume continues it");
  return input_error(path + ": contains neither " + binary_recording_name +
                     " nor recording.conf: expected a recording");
}

void RecordingSource::set_aside(const Segment& rest) {
  for (Segment& segment : segments_)
    if (segment.start_sample >= rest.start_sample && segment.end_sample <= rest.end_sample)
      segment.kind = SegmentKind::rotate;
  set_aside_.push_back(rest);
  hash_.clear();
}

Status RecordingSource::read_to_use(const Sink& sink) {
  std::int64_t bad = 0, all = 0;
  TRY(read([&](std::span<const ImuSample> samples) {
    for (const ImuSample& sample : samples) bad += sample.flags & sample_flag_invalid;
    all += std::ssize(samples);
    return sink(samples);
  }));
  return bad == 0 || bad < all ? Status()
                               : Status(input_error(path_ + ": all samples are flagged as bad: expected some to use"));
}

Status RecordingSource::read(const Sink& sink) {
  const HashState hash = hash_of(info_, segments_);
  std::vector<ImuSample> flagged;
  Status status = stream([&](std::span<const ImuSample> samples) {
    if (!set_aside_.empty()) {
      flagged.assign(samples.begin(), samples.end());
      for (ImuSample& sample : flagged)
        if (std::ranges::any_of(set_aside_, [&](const Segment& rest) {
              return sample.counter >= rest.start_sample && sample.counter < rest.end_sample;
            }))
          sample.flags |= sample_flag_set_aside;
      samples = flagged;
    }
    XXH3_128bits_update(hash.get(), samples.data(), samples.size_bytes());
    return sink(samples);
  });
  if (status) hash_ = hash_as_hex(XXH3_128bits_digest(hash.get()));
  return status;
}

Result<std::string> RecordingSource::content_hash() {
  if (hash_.empty()) TRY(read([](std::span<const ImuSample>) { return Status(); }));
  return hash_;
}

std::string describe(const RecordingDamage& damage) {
  std::string text;
  const auto say = [&](const std::string& what) { text += (text.empty() ? "" : ", ") + what; };
  if (damage.records_dropped > 0 || damage.bytes_dropped > 0)
    say(fmt::format("{} dropped ({}{})", counted(damage.records_dropped, "damaged record"),
                    counted(damage.bytes_dropped, "byte"),
                    damage.samples_dropped > 0 ? ", " + counted(damage.samples_dropped, "sample") : ""));
  if (!damage.complete) say("no end mark: the capture was interrupted");
  if (damage.torn_tail_bytes > 0) say("torn tail of " + counted(damage.torn_tail_bytes, "byte") + " ignored");
  return text;
}

}  // namespace turncal
