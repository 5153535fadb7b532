// make_seeds FOLDER: seeds that are not files of the repository: frames of a line, a small recording, a parameter file.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "imu_io/base/record_log.h"
#include "imu_io/frames/frame_description.h"
#include "imu_io/frames/frame_encoder.h"
#include "imu_io/recordings/binary_layout.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/statistics_file.h"
#include "input.h"
#include "tests/imu_io/bag_writer.h"

namespace {

using namespace turncal;

std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

void write(const std::string& path, const std::string& content) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

std::string frames_of(const FrameDescription& frame) {
  FrameEncoder encoder(frame);
  std::vector<std::byte> bytes(encoder.length());
  std::string stream;
  for (std::int64_t i = 0; i < 4; ++i) {
    ImuSample sample;
    sample.counter = 250 + i;
    sample.temperature_c = 20.0F;
    fuzz::require(encoder.encode(sample, bytes).ok());
    stream += text_of(bytes);
  }
  return stream;
}

std::string recording(bool own_info, bool sealed) {
  std::vector<std::byte> file;
  std::string loose;
  std::uint32_t number = 0;
  const auto put = [&](RecordType type, const std::vector<std::byte>& payload) {
    const auto kind = std::uint32_t(type);
    const std::size_t at = begin_record(file, recording_magic, kind, number++);
    file.insert(file.end(), payload.begin(), payload.end());
    end_record(file, at);
    loose += char(kind);
    loose += char(payload.size() & 0xFFU);
    loose += char(payload.size() >> 8);
    loose += text_of(payload);
  };
  RecordingInfo info;
  info.latitude_deg = 30.0;
  info.gravity_mps2 = 9.8;
  info.accel_pulse_mps = 0.0005;
  std::vector<std::byte> payload;
  append_info(payload, info);
  if (own_info) {
    put(RecordType::info, payload);
    put(RecordType::info, payload);
  }
  std::vector<ImuSample> samples(5);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i].counter = std::int64_t(i < 3 ? i : i + 2);
  samples[1].flags = 1;
  Segment segment;
  segment.step = 1;
  payload.clear();
  append_segment(payload, segment);
  put(RecordType::segment_begin, payload);
  payload.clear();
  append_samples(payload, samples, info);
  put(RecordType::samples, payload);
  segment.end_sample = 7;
  payload.clear();
  append_segment(payload, segment);
  put(RecordType::segment_end, payload);
  payload.clear();
  append_bytes(payload, std::uint64_t{samples.size()});
  put(RecordType::end, payload);
  return sealed ? text_of(file) : loose;
}

}  // namespace

int main(int count, char** arguments) {
  fuzz::require(count == 2);
  const std::string folder = arguments[1];
  unsigned char index = 0;
  for (const std::string_view name : builtin_frame_names()) {
    const auto frame = find_frame(std::string(name));
    fuzz::require(frame.ok());
    for (const char how : {0, 1, 3})
      write(folder + "/fuzz_frame_decoder/" + std::string(name) + std::to_string(how),
            std::string{char(index), how} + frames_of(*frame));
    ++index;
  }
  for (const bool skip_bad : {false, true}) {
    test::BagTopic topic,
        readings{"/t", "sensor_msgs/msg/Temperature", {{5, test::message_of(5, {20.0, 0.0}, test::Wire::cdr)}}};
    for (std::int64_t k = 1; k < 5; ++k)
      topic.messages.emplace_back(k, test::imu_message({k, {0.1, 0.2, 0.3}, {1.0, 2.0, 9.8}}));
    const std::string how(1, skip_bad ? '\1' : '\0'), bags = folder + "/fuzz_bag/" + (skip_bad ? "skip_" : "");
    for (const char* compression : {"none", "", "zstd", "lz4"})
      write(bags + "mcap_" + compression, how + test::mcap({readings, topic}, compression, 3));
    for (auto& message : topic.messages)
      message.second = test::imu_message({message.first, {0.1, 0.2, 0.3}, {1.0, 2.0, 9.8}}, test::Wire::ros1);
    for (const char* compression : {"none", "lz4"})
      write(bags + "bag_" + compression, how + test::bag1(topic, compression));
  }
  write(folder + "/fuzz_recording/sealed", std::string{'\0'} + recording(true, true));
  write(folder + "/fuzz_recording/records", std::string{'\1'} + recording(false, false));
  write(folder + "/fuzz_recording/records_with_info", std::string{'\3'} + recording(true, false));
  ParameterFile file;
  file.unit_serial = "F";
  file.recording_hash = std::string(32, '0');
  file.model = "extended";
  file.method = "joint";
  file.software_version = "0";
  file.time_utc = "2026-01-31T12:00:00Z";
  file.latitude_deg = 30.0;
  file.gravity_mps2 = 9.8;
  file.sample_period_s = 0.005;
  file.accel_pulse_mps = 0.0005;
  file.sigma[3] = 1e-6;
  file.effects.push_back({"accel_delay", "tau", 0.1, 0.01});
  file.add_further("quality.rms", 1.5);
  const auto text = format_parameter_file(file);
  if (!text) std::fprintf(stderr, "%s\n", text.error().message.c_str());
  fuzz::require(text.ok());
  write(folder + "/fuzz_parameter_file/whole", std::string{'\1'} + *text);
  StatisticsFile statistics{file, {}};
  statistics.statistics.columns = {"accel_creep.x tau_s 300", "accel_delay.tau"};
  statistics.statistics.s = Eigen::Vector2d(1.0, -2.0);
  statistics.statistics.Q = Eigen::Matrix2f{{4.0F, 1.0F}, {1.0F, 9.0F}};
  statistics.statistics.moves = Eigen::MatrixXf::Ones(parameter_count, 2);
  const auto bytes = format_statistics(statistics);
  fuzz::require(bytes.ok());
  write(folder + "/fuzz_statistics/whole", "\1" + text_of(*bytes));
  return 0;
}
