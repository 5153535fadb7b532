#include "imu_io/frames/frame_decoder.h"

#include "tests/imu_io/frame_streams.h"

namespace turncal {
namespace {

using namespace test;

std::string log_of(const FrameDescription& frame, const std::vector<ImuSample>& samples) {
  FrameEncoder encoder(frame);
  std::vector<std::byte> bytes;
  for (const ImuSample& sample : samples) EXPECT_OK(encoder.append(sample, bytes));
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

TEST(FrameLog, SamplesGapsAndNoise) {
  TemporaryFolder folder;
  const FrameDescription frame = frame_named("laser_gyro");
  std::vector<ImuSample> samples = pulse_samples(3000);
  samples.erase(samples.begin() + 700, samples.begin() + 720);
  std::string bytes = "rubbish" + log_of(frame, samples);
  bytes.insert(7 + 36 * 1000, "more");
  bytes[7 + 36 * 2000 + 10] ^= 1;
  write_file(folder / "log.bin", bytes);
  const Result<FrameLog> log = good(read_frame_log(folder / "log.bin", frame));
  ASSERT_EQ(log->samples.size(), 2979u);
  EXPECT_EQ(log->samples[699].counter, 699);
  EXPECT_EQ(log->samples[700].counter, 720);
  EXPECT_EQ(log->samples[700].gyro, samples[700].gyro);
  EXPECT_SAYS(log->summary, "2979 frames of laser_gyro, ");
  EXPECT_SAYS(log->summary, "21 samples lost");
}

TEST(FrameLog, Defects) {
  TemporaryFolder folder;
  const FrameDescription frame = frame_named("laser_gyro");
  const std::string bytes = log_of(frame, pulse_samples(500, 1, 1000));
  write_file(folder / "twice.bin", bytes + bytes);
  EXPECT_TRUE(
      fails(read_frame_log(folder / "twice.bin", frame), "after 500 samples: the unit's counter started again"));
  EXPECT_TRUE(fails(read_frame_log(folder / "twice.bin", frame_named("stim300")),
                    "no sample in it by the frame description stim300"));
  write_file(folder / "empty.bin", "");
  EXPECT_TRUE(fails(read_frame_log(folder / "empty.bin", frame), "no sample in it"));
}

}  // namespace
}  // namespace turncal
