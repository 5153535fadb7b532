// The text form: both ways, the same content hash as binary, and one clear line for every defect.
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "recording_samples.h"
#include "tests/said.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

constexpr const char* conf =
    "format = 1\n"
    "sample_period_s = 0.005\n"
    "latitude_deg = 29.53\n"
    "gravity_mps2 = 9.7914\n"
    "unit_serial = LG-7\n"
    "gyro_increment = pulses\n"
    "accel_increment = pulses\n"
    "accel_pulse_mps = 0.0005\n";
constexpr const char* csv =
    "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,temperature_c\n"
    "0,0,1,-2,3,96,0,24.000\n"
    "1,0,1,-2,3,96,0,24.001\n"
    "4,2147483647,-2147483648,0,0,96,0,\n"
    "5,0,0,0,0,96,0,-24.5004\n";
constexpr const char* segments_csv =
    "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n"
    "1,align,0,2,-90,0,0\n"
    "1,rotate,2,4,-90,12.5,0\n"
    "2,static,4,6,-90,12.5,360\n";

struct TextTest : testing::Test {
  TemporaryFolder folder;
  std::string csv_path = folder / "imu.csv";
  std::string conf_path = folder / "recording.conf";
  std::string segments_path = folder / "segments.csv";
  TextTest() {
    write_file(conf_path, conf);
    write_file(csv_path, csv);
    write_file(segments_path, segments_csv);
  }
  // The error of opening or else of reading.
  std::string defect() const {
    auto source = RecordingSource::open(folder.path());
    if (!source) return source.error().message;
    const Status status = (*source)->read([](std::span<const ImuSample>) { return Status(); });
    return status ? "" : status.error().message;
  }
};

TEST_F(TextTest, ReadsWhatIsThere) {
  const auto source = opened(folder.path());
  EXPECT_TRUE(source->info().has_temperature);
  EXPECT_FALSE(source->info().simulated);
  EXPECT_EQ(source->info().unit_serial, "LG-7");
  const auto samples = read_all(*source);
  ASSERT_EQ(samples.size(), 4U);
  EXPECT_EQ(samples[0].gyro, (std::array<double, 3>{0, 1, -2}));
  EXPECT_EQ(samples[1].temperature_c, 24.001F);
  EXPECT_EQ(samples[2].counter, 4);  // the gap is kept
  EXPECT_EQ(samples[2].gyro, (std::array<double, 3>{2147483647, -2147483648.0, 0}));
  EXPECT_TRUE(std::isnan(samples[2].temperature_c));
  EXPECT_EQ(samples[3].temperature_c, -24.5004F);
  expect_same(source->segments(), {make_segment(1, SegmentKind::align, 0, 2, -90, 0, 0),
                                   make_segment(1, SegmentKind::rotate, 2, 4, -90, 12.5, 0),
                                   make_segment(2, SegmentKind::still, 4, 6, -90, 12.5, 360)});
  EXPECT_TRUE(source->damage().complete);
}

TEST_F(TextTest, LineEndsBlanksAndOtherWaysToWriteTheSameNumbersMakeNoDifference) {
  const auto plain = opened(folder.path());
  const auto samples = read_all(*plain);
  const auto crlf = [](const std::string& text) {
    std::string result;
    for (const char c : text) result += c == '\n' ? std::string("\r\n") : std::string(1, c);
    return result;
  };
  write_file(conf_path, crlf(conf));
  write_file(csv_path, crlf(replaced(replaced(csv, "0,0,1,-2,3,96", "0, -0 ,1.0,-2e0,3,96"), "24.000", "24")));
  write_file(segments_path, crlf(segments_csv));
  const auto other = opened(folder.path());
  expect_same(read_all(*other), samples);
  EXPECT_EQ(*other->content_hash(), *plain->content_hash());
}

// What is changed in one of the three files, and the whole line that comes of it. imu.csv in rad and m/s: [physical imu.csv].
TEST_F(TextTest, OneLineForEachDefect) {
  const std::map<std::string, std::string> texts = {
      {"recording.conf", conf}, {"imu.csv", csv}, {"segments.csv", segments_csv}, {"flags.csv", "sample,flags\n"}};
  expect_said("imu_io/text_recordings.said", [&](std::string name, const std::string& what, const std::string& with) {
    for (const auto& [file, text] : texts) write_file(folder / file, text);
    if (name.starts_with("physical ")) {
      write_file(conf_path, replaced(replaced(conf, "gyro_increment = pulses", "gyro_increment = rad"),
                                     "accel_increment = pulses", "accel_increment = mps"));
      name = name.substr(9);
    }
    if (what == "missing")
      std::filesystem::remove(folder / name);
    else
      write_file(folder / name, what == "all of it" ? with : replaced(texts.at(name), what, with));
    const std::string said = defect();
    return said.empty() ? "accepted" : replaced(said, folder.path() + "/", "");
  });
}

TEST_F(TextTest, LastLineCutOffAtAnyByte) {
  const std::string whole = csv;
  const std::size_t last = whole.rfind("5,0,0");
  for (std::size_t length = last + 1; length < whole.size(); ++length) {
    write_file(csv_path, whole.substr(0, length));
    ASSERT_EQ(defect(), csv_path + ":5: the last line is cut off: expected a line end") << length;
  }
}

TEST_F(TextTest, LineWithoutEndIsNotReadIntoMemory) {
  write_file(csv_path, csv + std::string(3 << 20, '1') + "\n");
  EXPECT_EQ(defect(), csv_path + ":6: line longer than 4096 bytes");
  write_file(csv_path, replaced(csv, "\n1,0,1", "\n" + std::string(3 << 20, '1')));
  EXPECT_EQ(defect(), csv_path + ":3: line longer than 4096 bytes");
}

// ---- import and export ----

TEST_F(TextTest, FailedImportLeavesNothingAndKeepsWhatWasThere) {
  write_file(csv_path, replaced(csv, "1,0,1,-2,3,96,0,24.001", "1,0,1,-2,3,96,bad,24.001"));
  write_file(folder / "out.tcr", "before");
  const auto names = folder.names();
  const auto source = opened(folder.path());
  EXPECT_ERROR(import_binary(*source, folder / "out.tcr"),
               csv_path + ":3: column accel_z = 'bad': expected a whole number of pulses within 32 bits");
  EXPECT_EQ(file_text(folder / "out.tcr"), "before");
  EXPECT_EQ(folder.names().size(), names.size());
  EXPECT_FALSE(export_text(*source, folder / "out").ok());
  EXPECT_TRUE(std::filesystem::is_empty(folder / "out"));
}

TEST_F(TextTest, ImportWithOtherSegmentsNamesTheFileTheUserKnows) {
  auto source = RecordingSource::open(folder.path());
  EXPECT_ERROR(
      import_binary(**source, {make_segment(1, SegmentKind::still, 0, 60)}, folder / "out.tcr"),
      (folder / "out.tcr") + ": segment 1: end_sample = '60': expected at most one more than the last sample, 5");
  ASSERT_OK(import_binary(**source, {make_segment(7, SegmentKind::still, 0, 5)}, folder / "out.tcr"));
  expect_same((*RecordingSource::open(folder / "out.tcr"))->segments(), {make_segment(7, SegmentKind::still, 0, 5)});
}

// The layout of what is hashed is a promise to files that hold the hash: this value must never change.
TEST_F(TextTest, ContentHashIsPinned) {
  auto source = RecordingSource::open(folder.path());
  EXPECT_EQ(*(*source)->content_hash(), "283625a399b5868f4ca7438ff451180d");
}

TEST_F(TextTest, EveryChangeOfContentChangesTheHash) {
  const auto hash = [&] {
    auto source = RecordingSource::open(folder.path());
    EXPECT_OK(source);
    return *(*source)->content_hash();
  };
  std::vector<std::string> hashes = {hash()};
  const auto change = [&](const std::string& path, const char* original, const std::string& what,
                          const std::string& with) {
    write_file(path, replaced(original, what, with));
    hashes.push_back(hash());
    write_file(path, original);
  };
  change(conf_path, conf, "0.005\n", "0.0050000001\n");
  change(conf_path, conf, "29.53", "29.54");
  change(conf_path, conf, "9.7914", "9.7915");
  change(conf_path, conf, "LG-7", "LG-8");
  change(conf_path, conf, "0.0005", "0.0006");
  change(conf_path, conf, "gyro_increment = pulses", "gyro_increment = rad");
  change(conf_path, conf, "format = 1", "format = 1\nsimulated = true");
  change(segments_path, segments_csv, "rotate", "static");
  change(segments_path, segments_csv, "12.5,360", "12.5,361");
  change(csv_path, csv, "4,2147483647", "3,2147483647");
  change(csv_path, csv, "2147483647", "2147483646");
  change(csv_path, csv, "24.001", "24.002");
  change(csv_path, csv, "24.001", "");
  write_file(folder / "flags.csv", "sample,flags\n4,1\n");
  hashes.push_back(hash());
  std::ranges::sort(hashes);
  EXPECT_EQ(std::ranges::adjacent_find(hashes), hashes.end());
}

// The fast row parser against the slow one on text that is nearly a row.
TEST(ImuCsvRow, FastAndSlowParserAgree) {
  std::mt19937 random(5);
  const auto parsers = [](IncrementKind gyro, bool temperature) {
    return ImuCsvParser("x", make_info(gyro, IncrementKind::pulses, temperature));
  };
  const std::string alphabet = "0123456789-+.e, \r,,,000111";
  int accepted = 0;
  for (int round = 0; round < 300000; ++round) {
    const bool temperature = random() % 2 == 0;
    const auto gyro = random() % 2 == 0 ? IncrementKind::pulses : IncrementKind::physical;
    const ImuCsvParser parser = parsers(gyro, temperature);
    std::string row = "12,0,-3,450,2147483647,96,-1";
    if (temperature) row += ",24.125";
    for (unsigned change = random() % 4; change > 0; --change)
      row[random() % row.size()] = alphabet[random() % alphabet.size()];
    std::string padded = row + "\n" + std::string(64, '7');
    const char* at = padded.data();
    ImuSample fast;
    ImuSample slow;
    if (!parser.parse_plain(at, fast)) continue;
    ++accepted;
    ASSERT_EQ(at, padded.data() + row.size() + 1);
    if (row.ends_with('\r')) row.pop_back();
    ASSERT_OK(parser.parse(row, 1, slow)) << row << ": ";
    ASSERT_TRUE(same(fast, slow)) << row;
  }
  EXPECT_GT(accepted, 50000);
}

}  // namespace
}  // namespace turncal
