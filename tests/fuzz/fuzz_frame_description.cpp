// Text into the frame description's reader. One that is accepted must encode and decode its own frames.
#include <algorithm>
#include <string>
#include <vector>

#include "imu_io/frames/frame_decoder.h"
#include "imu_io/frames/frame_encoder.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  const auto frame = parse_frame_description(fuzz::Input(data, size).text(), "fuzz");
  if (!frame) {
    fuzz::require(frame.error().kind == ErrorKind::input && frame.error().message.find('\n') == std::string::npos);
    return 0;
  }
  FrameEncoder encoder(*frame);
  FrameDecoder decoder(*frame);
  std::vector<std::byte> bytes(encoder.length());
  for (std::int64_t i = 0; i < 4; ++i) {
    ImuSample sample;
    sample.counter = i;
    sample.gyro = {1.0, -1.0, 0.0};
    if (!encoder.encode(sample, bytes)) break;
    const auto room = decoder.space();
    fuzz::require(room.size() >= bytes.size());
    std::ranges::copy(bytes, room.begin());
    decoder.added(bytes.size(), {0.0, 1.0});
    while (decoder.next(sample) == FrameDecoder::Next::sample) {
    }
  }
  return 0;
}
