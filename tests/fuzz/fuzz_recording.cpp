// Bytes as a binary recording. Bit 0 of byte 0: the rest is cut into records (type, length, payload) that get right headers and
// checksums, after an info record that is right unless bit 1 says otherwise. What can be opened is read, hashed, and must keep the
// promises of recording_source.h.
#include <vector>

#include "imu_io/base/record_log.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/recording_source.h"
#include "input.h"
#include "scratch_file.h"

namespace turncal {
namespace {

void put(std::vector<std::byte>& out, std::uint32_t type, std::uint32_t number, std::span<const std::byte> payload) {
  const std::size_t at = begin_record(out, recording_magic, type, number);
  out.insert(out.end(), payload.begin(), payload.end());
  end_record(out, at);
}

std::vector<std::byte> records(fuzz::Input& input, bool own_info) {
  std::vector<std::byte> out;
  std::uint32_t number = 0;
  if (!own_info) {
    RecordingInfo info;
    info.latitude_deg = 30.0;
    info.gravity_mps2 = 9.8;
    info.accel_pulse_mps = 0.0005;
    for (int i = 0; i < 2; ++i) {
      std::vector<std::byte> payload;
      append_info(payload, info);
      put(out, 1, number++, payload);
    }
  }
  while (!input.rest.empty()) {
    const std::uint8_t type = input.byte();
    const std::size_t length = input.byte() + 256U * (input.byte() & 3U);
    number += type >> 6;  // now and then a hole
    put(out, type & 7U, number++, input.take(length));
  }
  return out;
}

}  // namespace
}  // namespace turncal

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  static const fuzz::ScratchFolder folder;
  static const fuzz::ScratchFile file(folder, "recording.tcr");
  fuzz::Input input(data, size);
  const std::uint8_t how = input.byte();
  const bool structured = (how & 1U) != 0;
  file.write(structured ? std::span<const std::byte>(records(input, (how & 2U) != 0)) : input.rest);
  auto source = RecordingSource::open(file.path());
  if (!fuzz::taken(source)) return 0;
  if (fuzz::taken(fuzz::read_through(**source))) fuzz::require((*source)->content_hash().ok());
  const Segments& segments = (*source)->segments();
  for (std::size_t i = 1; i < segments.size(); ++i)
    fuzz::require(segments[i].start_sample == segments[i - 1].end_sample);
  return 0;
}
