#include "imu_io/recordings/ros_bag.h"

#include "tests/imu_io/bag_writer.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;

constexpr std::int64_t start_ns = 1'700'000'000'123'456'789;

std::vector<BagMessage> motion(int count = 250) {
  std::vector<BagMessage> messages;
  for (int k = 0; k < count; ++k)
    messages.push_back({start_ns + 5'000'000 * k, {0.1 * k, -1.0, 1e-9}, {0.5, 9.81, -0.25 * k}});
  return messages;
}
BagTopic imu_topic(Wire wire = Wire::cdr, const std::string& name = "/imu/data") {
  BagTopic topic{name, "sensor_msgs/msg/Imu", {}};
  for (const BagMessage& m : motion()) topic.messages.emplace_back(m.ns + 7, imu_message(m, wire));
  return topic;
}
BagTopic thermometer(const std::string& name) {
  BagTopic topic{name, "sensor_msgs/msg/Temperature", {}};
  for (int k = 0; k < 2; ++k)
    topic.messages.emplace_back(0, message_of(start_ns + 500'000'000 * k - 1000, {20.0 + k, 0.0}, Wire::cdr));
  return topic;
}
std::string put(const TemporaryFolder& folder, const std::string& name, const std::string& content) {
  std::ofstream(folder / name, std::ios::binary) << content;
  return folder / name;
}
Result<BagImu> read(const TemporaryFolder& folder, const std::string& content, const std::string& topic = {},
                    bool skip_bad = false) {
  return read_bag(put(folder, "x.mcap", content), topic, skip_bad);
}
void expect_motion(const Result<BagImu>& bag, const std::string& where) {
  SCOPED_TRACE(where);
  ASSERT_OK(bag);
  ASSERT_GE(bag->columns.size(), 7u);
  ASSERT_EQ(bag->columns[0].values.size(), 250u);
  for (int k : {0, 1, 249}) {
    const auto row = std::size_t(k);
    EXPECT_NEAR(bag->columns[0].values[row], 0.005 * k, 1e-12);
    EXPECT_EQ(bag->columns[1].values[row], 0.1 * k);
    EXPECT_EQ(bag->columns[3].values[row], 1e-9);
    EXPECT_EQ(bag->columns[6].values[row], -0.25 * k);
  }
  EXPECT_EQ(bag->started_utc_s, 1'700'000'000);
}

TEST(RosBag, EveryContainerCompressionAndEncodingGivesTheSameColumns) {
  TemporaryFolder folder;
  for (const char* compression : {"", "zstd", "lz4", "none"})
    expect_motion(read(folder, mcap({imu_topic()}, compression)), compression);
  for (const Wire wire : {Wire::cdr_big, Wire::xcdr2})
    expect_motion(read(folder, mcap({imu_topic(wire)}, "zstd")), "byte order");
  for (const char* compression : {"", "zstd"}) {
    const std::string path = folder / (std::string("a") + compression + ".db3");
    db3(path, {thermometer("/t"), imu_topic()}, compression);
    expect_motion(read_bag(path, "", false), path);
  }
  for (const char* compression : {"none", "lz4", "bz2"})
    expect_motion(read_bag(put(folder, "a.bag", bag1(imu_topic(Wire::ros1), compression)), "/imu/data", false),
                  compression);
  // A rosbag2 folder in two files.
  BagTopic first = imu_topic(), second = imu_topic();
  first.messages.resize(100);
  second.messages.erase(second.messages.begin(), second.messages.begin() + 100);
  std::filesystem::create_directory(folder / "bag");
  put(folder, "bag/metadata.yaml", "rosbag2_bagfile_information:\n");
  EXPECT_TRUE(fails(read_bag(folder / "bag", "", false), "metadata.yaml: expected relative_file_paths"));
  put(folder, "bag/metadata.yaml",
      "rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_9.db3\n    - \"bag_10.db3\"\n  duration:\n");
  db3(folder / "bag/bag_9.db3", {first});
  db3(folder / "bag/bag_1.db3", {first});  // of another bag
  EXPECT_TRUE(fails(read_bag(folder / "bag", "", false), "bag/bag_10.db3: cannot open"));
  db3(folder / "bag/bag_10.db3", {second});
  expect_motion(read_bag(folder / "bag", "", false), "folder");
}

TEST(RosBag, ReadingsStandInTheFirstRowAfterThem) {
  TemporaryFolder folder;
  const Result<BagImu> bag = good(
      read(folder, mcap({thermometer("/motor/temperature"), thermometer("/imu/temperature"), imu_topic()}, "zstd")));
  EXPECT_EQ(bag->temperature_topic, "/imu/temperature");
  const std::vector<double>& celsius = bag->columns.back().values;
  EXPECT_EQ(celsius[0], 20.0);
  EXPECT_EQ(celsius[100], 21.0);
  EXPECT_TRUE(std::isnan(celsius[1]) && std::isnan(celsius[99]) && std::isnan(celsius[101]));
}

TEST(RosBag, TopicsAreListed) {
  TemporaryFolder folder;
  const std::string two =
      mcap({imu_topic(), imu_topic(Wire::cdr, "/imu/raw"), {"/camera", "sensor_msgs/msg/Image", {{1, "x"}}}}, "lz4");
  EXPECT_TRUE(fails(read(folder, two), "several units: expected --topic"));
  expect_motion(read(folder, two, "/imu/raw"), "named");
  EXPECT_TRUE(fails(read(folder, two, "/imu"),
                    "no topic '/imu' of type sensor_msgs/msg/Imu: it has '/camera' ('sensor_msgs/msg/Image', 1 "
                    "message), '/imu/data' ("));
  EXPECT_TRUE(fails(read(folder, two, "/camera"), "no topic '/camera' of type"));
  EXPECT_TRUE(fails(read(folder, mcap({{"/camera", "sensor_msgs/msg/Image", {}}}, "")),
                    "no message of type sensor_msgs/msg/Imu"));
  EXPECT_TRUE(fails(read(folder, mcap({BagTopic{}}, "")), "0 messages"));
}

TEST(RosBag, WithoutStampsTheTimesOfRecordingCount) {
  TemporaryFolder folder;
  BagTopic topic = imu_topic();
  for (auto& [ns, message] : topic.messages) message.replace(4, 8, 8, '\0');
  const Result<BagImu> bag = read(folder, mcap({topic}, ""));
  expect_motion(bag, "recorded");
  EXPECT_TRUE(bag->recording_times);
}

// Each is one line, or left out and counted.
TEST(RosBag, Defects) {
  TemporaryFolder folder;
  const std::string whole = mcap({imu_topic()}, "zstd");
  const auto refused = [&](const std::string& content, const std::string& what, std::size_t left) {
    SCOPED_TRACE(what);
    const Result<BagImu> strict = read(folder, content);
    EXPECT_TRUE(fails(strict, ErrorKind::input, what));
    EXPECT_TRUE(strict.ok() || strict.error().message.find('\n') == std::string::npos);
    const Result<BagImu> lenient = read(folder, content, "", true);
    EXPECT_EQ(lenient.ok() ? lenient->columns[0].values.size() : 0, left);
    EXPECT_TRUE(!lenient.ok() || lenient->bad >= 1);
  };
  refused(whole.substr(0, whole.size() - 300), "the MCAP file is cut off; 200 messages came before", 200);
  std::string damaged = whole;
  damaged[damaged.size() / 2] ^= 0x55;
  EXPECT_FALSE(read(folder, damaged).ok());
  EXPECT_TRUE(read(folder, damaged, "", true).ok());
  // Lengths that no memory could hold.
  const std::string head = whole.substr(0, 8);
  refused(head + '\x06' + raw(std::uint64_t{1} << 62), "cut off", 0);
  refused(head + mcap_record(6, raw(std::uint64_t{0}) + raw(std::uint64_t{0}) + raw(~std::uint64_t{0}) + raw(0U) +
                                    text("zstd") + raw(std::uint64_t{4}) + "abcd"),
          "does not decompress to", 0);
  refused(head + mcap_record(4, raw(std::uint32_t{0}) + raw(0xffffffffU)), "a schema or channel that is cut off", 0);
  refused(head + mcap_record(6, raw(std::uint64_t{0}) + raw(std::uint64_t{0}) + raw(std::uint64_t{4}) + raw(1U) +
                                    text("") + raw(std::uint64_t{4}) + "abcd"),
          "checksum", 0);
  const auto with = [&](std::size_t at, const std::string& message) {
    BagTopic topic = imu_topic();
    topic.messages[at].second = message;
    return mcap({topic}, "");
  };
  BagMessage bad = motion()[3];
  bad.accel[1] = std::numeric_limits<double>::quiet_NaN();
  refused(with(3, imu_message(bad)),
          "message 4 of '/imu/data': linear_acceleration.y = 'nan': expected a finite number", 249);
  refused(with(3, imu_message(motion()[3]).substr(0, 200)),
          "message 4 of '/imu/data': expected a sensor_msgs/Imu, found something shorter", 249);
  refused(with(3, imu_message(motion()[3], Wire::cdr, -1.0)), "angular_velocity is not measured", 249);
  std::string order = imu_message(motion()[3]);
  order[1] = 0;  // says big-endian and is little
  refused(with(3, order), "message 4", 249);
  refused(with(3, ""), "message 4", 249);
  EXPECT_TRUE(fails(read_bag(put(folder, "b.bag", bag1(imu_topic(Wire::ros1), "none").substr(0, 9000)), "", false),
                    "the bag is cut off"));
  EXPECT_TRUE(fails(read_bag(put(folder, "b.bag", bag1(imu_topic(Wire::ros1), "xz")), "", true),
                    "compression 'xz': expected zstd, lz4, bz2 or none"));
  db3(folder / "c.db3", {imu_topic()});
  std::filesystem::resize_file(folder / "c.db3", 20000);
  EXPECT_TRUE(fails(read_bag(folder / "c.db3", "", false), "cannot read it as a rosbag2 database"));
  const Result<BagImu> cut = good(read_bag(folder / "c.db3", "", true));
  EXPECT_GE(cut->columns[0].values.size(), 20u);
  EXPECT_LT(cut->columns[0].values.size(), 250u);
  EXPECT_GE(cut->bad, 1);
  EXPECT_TRUE(fails(read_bag(put(folder, "d.db3", "no database"), "", false),
                    "expected an MCAP file, a .db3 of rosbag2 or a .bag"));
}

// What a driver sends before its clock is set is left out or said; a simulation's clock begins at 0.
TEST(RosBag, AStampOfZeroIsNone) {
  TemporaryFolder folder;
  const auto bag = [&](std::int64_t start, std::initializer_list<int> unset) {
    BagTopic topic;
    for (int k = 0; k < 250; ++k) {
      const bool is_set = std::ranges::find(unset, k) == unset.end();
      topic.messages.emplace_back(start_ns + 5'000'000 * k, imu_message({is_set ? start + 5'000'000 * k : 0, {}, {}}));
    }
    return mcap({topic}, "zstd");
  };
  EXPECT_TRUE(
      fails(read(folder, bag(start_ns, {0, 1, 2})), "message 1 of '/imu/data': header.stamp is 0, as of 3 of 250"));
  const Result<BagImu> rest = good(read(folder, bag(start_ns, {0, 1, 2, 100}), "", true));
  EXPECT_EQ(rest->columns[0].values.size(), 246u);
  EXPECT_EQ(rest->bad, 4);
  EXPECT_EQ(rest->message[97], 101);
  EXPECT_NEAR(rest->columns[0].values[97], 0.49, 1e-12);
  EXPECT_EQ(good(read(folder, bag(0, {})))->columns[0].values.size(), 250u);
}

// Chunks may overlap, and rows of a database lie as they came: the order is that of recording.
TEST(RosBag, OrderIsThatOfRecording) {
  TemporaryFolder folder;
  BagTopic topic = imu_topic();
  std::swap_ranges(topic.messages.begin(), topic.messages.begin() + 100, topic.messages.begin() + 100);
  expect_motion(read(folder, mcap({topic, thermometer("/imu/temp")}, "zstd")), "chunks");
  db3(folder / "a.db3", {topic});
  expect_motion(read_bag(folder / "a.db3", "", false), "rows");
}

}  // namespace
}  // namespace turncal
