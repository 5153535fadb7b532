// The helper that other tests stand on: its compressed recording is that of the ordinary recording it writes beside it,
// and its segments are the planned ones.
#include "tests/rig_recorder.h"

#include "tests/calib/closed_form_fixture.h"

namespace turncal {
namespace {

TEST(RigRecorder, WritesTheRecordingThatItCompresses) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "rig_recorder_test";
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  const std::string file = (folder / binary_recording_name).string();
  RigConfig config = default_rig_config();
  config.first_counter = 1000;
  config.unit_serial = "RIG";
  Rig rig(config);
  RecordingWriter writer = must(RecordingWriter::create(file, rig_recording_info(rig)));
  RigRecorderOptions options;
  options.writer = &writer;
  const Sequence sequence = short_steps();
  const CompressedRecording direct = record_on_rig(sequence, config, options).recording;
  must(writer.finish());

  const auto source = must(RecordingSource::open(folder.string()));
  EXPECT_EQ(source->info().unit_serial, "RIG");
  EXPECT_TRUE(source->info().simulated);
  const CompressedRecording read = compress_folder(folder.string());

  PlanLimits limits;
  limits.settle_s = 0.5;
  const Segments planned = planned_segments(make_plan(sequence, limits));
  ASSERT_EQ(read.segments.size(), planned.size());
  for (std::size_t k = 0; k < planned.size(); ++k) {
    EXPECT_EQ(read.segments[k].start_sample, planned[k].start_sample + 1000);
    EXPECT_EQ(read.segments[k].end_sample, planned[k].end_sample + 1000);
    EXPECT_EQ(read.segments[k].kind, planned[k].kind);
    EXPECT_EQ(read.segments[k].roll_deg, planned[k].roll_deg);
  }
  ASSERT_EQ(read.blocks.size(), direct.blocks.size());
  EXPECT_EQ(read.samples, direct.samples);
  for (std::size_t k = 0; k < read.blocks.size(); ++k) {
    ASSERT_EQ(read.blocks[k].start_sample, direct.blocks[k].start_sample);
    ASSERT_EQ(read.blocks[k].gyro, direct.blocks[k].gyro);
    ASSERT_EQ(read.blocks[k].sculling, direct.blocks[k].sculling);
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace turncal
