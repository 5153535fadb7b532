#include "imu_io/frames/frame_description.h"

#include "frame_streams.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;  // NOLINT

TEST(FrameDescription, EveryShippedOneIsReadAndKnownByName) {
  const auto names = builtin_frame_names();
  const std::vector<std::string_view> expected = {"f32_bddb0a",       "f64_55aa34",  "kvh1750", "laser_gyro",
                                                  "novatel_rawimusx", "pulses_9966", "stim300"};
  EXPECT_EQ(names, expected);
  for (const std::string_view name : names) {
    const auto frame = good(find_frame(std::string(name)));
    EXPECT_EQ(frame->name, name);
    // As the file says, so is what is compiled in.
    const std::string file = std::string(TURNCAL_SOURCE_DIR) + "/imu_io/frames/" + std::string(name) + ".frame";
    EXPECT_EQ(builtin_frame_text(name), file_text(file));
    ASSERT_OK(find_frame(file));
    // 10 bits a byte: the line carries the frames, with a tenth to spare.
    const double bits = 10.0 * static_cast<double>(frame->variants[0].length) / frame->sample_period_s;
    EXPECT_LT(bits * 1.1, frame->line.baud) << name;
  }
}

TEST(FrameDescription, UnitsOfRecordings) {
  RecordingInfo info;
  info.unit_serial = "kept";
  frame_named("stim300").describe(info);
  EXPECT_EQ(info.sample_period_s, 0.002);
  EXPECT_EQ(info.gyro_increment, IncrementKind::physical);
  EXPECT_EQ(info.accel_increment, IncrementKind::physical);
  EXPECT_FALSE(info.has_temperature);
  EXPECT_EQ(info.unit_serial, "kept");
  frame_named("pulses_9966").describe(info);
  EXPECT_EQ(info.gyro_increment, IncrementKind::pulses);
  EXPECT_EQ(info.accel_pulse_mps, 0.0005);
  EXPECT_TRUE(info.has_temperature);
}

// What is changed in laser_gyro.frame, and the whole line that comes of it. Lines that are added stand at the end.
struct BadDescription {
  std::string from;
  std::string to;
  std::string message;  // after "x.frame:LINE: "
};

TEST(FrameDescription, OneLineForEachMistake) {
  const BadDescription cases[] = {
      {"format = 1", "format = 2", "key 'format' = '2': expected a whole number between 1 and 1"},
      {"sync = EB 90", "sync = EB 9",
       "key 'sync' = 'EB 9': expected at most 16 bytes of two hexadecimal digits, with blanks between"},
      {"sync = EB 90", "sync =", "key 'sync' = '': expected at least one byte"},
      {"sync = EB 90", "sync = EB 90\nsync.mask = FF", "key 'sync.mask' = 'FF': expected as many bytes as sync"},
      {"length = 36", "length = 35",
       "key 'check.offset' = '34': expected a place inside the frame, after what the check covers and before the tail"},
      {"length = 36", "length = 2000", "key 'length' = '2000': expected a whole number between 2 and 1024"},
      {"sample_period_s = 0.005", "sample_period_s = 0",
       "key 'sample_period_s' = '0': expected a number between 1e-05 and 10"},
      {"gyro.offset = 6", "gyro.offset = 30",
       "key 'gyro.offset' = '30': expected a place inside the frame of 36 bytes"},
      {"gyro.offset = 6", "gyro.offset = 6, 10", "key 'gyro.offset' = '6, 10': expected 1 or 3 whole byte offsets"},
      {"gyro.offset = 6", "gyro.offset = 6.5", "key 'gyro.offset' = '6.5': expected 1 or 3 whole byte offsets"},
      {"gyro.type = i32", "gyro.type = int",
       "key 'gyro.type' = 'int': expected u8, i8, u16, i16, u24, i24, u32, i32, u64, i64, f32, f64, sm8, sm16, sm24 or "
       "sm32"},
      {"gyro.unit = pulses", "gyro.unit = degrees",
       "key 'gyro.unit' = 'degrees': expected one of pulses, rad, deg, arcsec, rad/s, deg/s, deg/h"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.scale = 2",
       "key 'gyro.scale' = '2': expected no such key with unit = pulses: they are counted as they come"},
      {"gyro.unit = pulses", "gyro.unit = rad\ngyro.scale = 0",
       "key 'gyro.scale' = '0': expected numbers other than 0"},
      {"gyro.unit = pulses", "gyro.unit = deg/s\ngyro.kind = cumulative",
       "key 'gyro.kind' = 'cumulative': expected 'each' unless the field is a whole number of increments"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.kind = cumulative\ngyro.modulus = 4294967297",
       "key 'gyro.modulus' = '4294967297': expected 2 to 2^32"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.axes = +x, +x, -z",
       "key 'gyro.axes' = '+x, +x, -z': expected three axes such as '+x, -z, +y', each letter once"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0",
       "key 'gyro.mask' = '0': expected a mask that leaves something of the field"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0xF0F",
       "key 'gyro.mask' = '0xF0F': expected a mask of neighbouring bits"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 0xG",
       "key 'gyro.mask' = '0xG': expected a whole number, 0x before hexadecimal, at most 64 bits"},
      {"accel.unit = pulses", "accel.unit = m/s",
       "key 'accel.pulse_mps' = '0.0005': expected no such key unless accel.unit = pulses"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = -1", "key 'accel.pulse_mps' = '-1': expected a number > 0"},
      {"counter.type = u32", "counter.type = f64\ncounter.step = 1e-308",
       "key 'counter.step' = '1e-308': expected a number between 1e-09 and 1000000000000"},
      {"counter.type = u32", "counter.type = i32", "key 'counter.type' = 'i32': expected an unsigned or floating type"},
      {"counter.type = u32", "counter.type = u64",
       "key 'counter.type' = 'u64': expected a counter of at most 53 bits: a mask can leave the upper ones out"},
      {"counter.type = u32", "counter.type = u8\ncounter.step = 100",
       "key 'counter.step' = '100': expected a step that divides the modulus into 4 samples or more"},
      {"check = crc", "check = crc32",
       "key 'check' = 'crc32': expected none, sum8, sum16, sum32, xor8, xor16, crc, fletcher16 or fletcher32"},
      {"crc.width = 16", "crc.width = 12", "key 'crc.width' = '12': expected 8, 16, 24 or 32"},
      {"crc.width = 16", "crc.width = 8", "key 'crc.polynomial' = '0x1021': expected at most 8 bits"},
      {"line.baud = 115200", "line.baud = 7", "key 'line.baud' = '7': expected a whole number between 50 and 20000000"},
      {"line.baud = 115200", "line.speed = 7", "key 'line.speed' is unknown"},
      {"line.baud = 115200", "temperature.when = 1",
       "key 'temperature.when' = '1': expected a key mux.offset beside it"},
      {"sync = EB 90", "sync = EB 90\nsync.mask = 00 00",
       "key 'sync.mask' = '00 00': expected at least one bit: without any every byte begins a frame"},
      {"accel.offset = 18", "accel.offset = 16",
       "key 'accel.offset' = '16': expected a place of its own, not that of gyro.offset"},
      {"gyro.offset = 6", "gyro.offset = 6, 8, 14",
       "key 'gyro.offset' = '6, 8, 14': expected a place of its own, not that of gyro.offset"},
      {"gyro.offset = 6", "gyro.offset = 6\ngyro.down = 6",
       "key 'gyro.down' = '6': expected a place of its own, not that of gyro.offset"},
      {"counter.offset = 2", "counter.offset = 1",
       "key 'counter.offset' = '1': expected a place of its own, not that of sync"},
      {"temperature.offset = 30", "temperature.offset = 31",
       "key 'temperature.offset' = '31': expected a place of its own, not that of status.offset"},
      {"status.offset = 32", "status.offset = 34",
       "key 'check.offset' = '34': expected a place of its own, not that of status.offset"},
      {"check.offset = 34", "check.offset = 29",
       "key 'check.offset' = '29': expected a place of its own, not that of accel.offset"},
      {"status.offset = 32", "status.offset = 0",
       "key 'status.offset' = '0': expected a place of its own, not that of sync"},
      {"gyro.unit = pulses", "gyro.unit = pulses\ngyro.mask = 7",
       "key 'gyro.mask' = '7': expected a mask that leaves 4 bits or more"},
      {"crc.polynomial = 0x1021", "crc.polynomial = 0x8408",
       "key 'crc.polynomial' = '0x8408': expected an odd number: the term 1 is in every polynomial"},
      {"temperature.scale = 0.01", "temperature.scale = 0",
       "key 'temperature.scale' = '0': expected a number other than 0"},
      {"status.bits = 0x0001", "status.bits = 0", "key 'status.bits' = '0': expected at least one bit of the field"},
      {"status.bits = 0x0001", "status.bits = 0x10000",
       "key 'status.bits' = '0x10000': expected at least one bit of the field"},
      {"status.good = 0", "status.good = 2", "key 'status.good' = '2': expected a number of status.bits alone"},
      {"line.baud = 115200", "id.offset = 33\nid.value = 300",
       "key 'id.value' = '300': expected at most 255, which its field can hold"},
      {"line.baud = 115200", "mux.offset = 33\ntemperature.when = 256",
       "key 'temperature.when' = '256': expected at most 255, which its field can hold"},
      {"line.baud = 115200", "length.offset = 33\nlength.scale = 16",
       "key 'length' = '36': expected a length that the field at length.offset can say: field x length.scale + "
       "length.add"},
      {"line.baud = 115200", "line.data_bits = 7", "key 'line.data_bits' = '7': expected 8: a frame is of whole bytes"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = 1e-12",
       "key 'accel.pulse_mps' = '1e-12': expected a scale with which the field reaches gravity"},
      {"accel.pulse_mps = 0.0005", "accel.pulse_mps = 1e300",
       "key 'accel.pulse_mps' = '1e300': expected a scale with which a count is less than 1000 m/s^2"},
      {"gyro.unit = pulses", "gyro.unit = deg/h\ngyro.scale = 1e-9",
       "key 'gyro.scale' = '1e-9': expected a scale with which the field reaches 1 deg/s"},
      {"gyro.unit = pulses", "gyro.unit = rad",
       "key 'gyro.unit' = 'rad': expected a scale with which a count is less than 1000 deg/s"},
      {"line.baud = 115200", "variants =", "key 'variants' = '': expected names separated by commas"},
      {"line.baud = 115200", "variants = a, b", "key 'variants' = 'a, b': expected a key id.offset beside it"},
      {"line.baud = 115200", "variants = a, b\nid.offset = 33\na.id.value = 1\nb.id.value = 1",
       "key 'variants' = 'a, b': expected a different id for each variant"},
  };
  for (const BadDescription& bad : cases) {
    const std::string text =
        replaced(unmarked(builtin_frame_text("laser_gyro")), "\n" + bad.from + "\n", "\n" + bad.to + "\n");
    const auto frame = parse_frame_description(text, "x.frame");
    ASSERT_TRUE(fails(frame, ErrorKind::input)) << bad.to;
    const std::string& message = frame.error().message;
    ASSERT_TRUE(message.starts_with("x.frame:")) << message;
    EXPECT_EQ(message.substr(message.find(' ') + 1), bad.message) << bad.to;
  }
}

TEST(FrameDescription, AMissingKeyIsNamed) {
  std::string text = unmarked(builtin_frame_text("laser_gyro"));
  text.erase(text.find("gyro.unit"), std::string("gyro.unit = pulses\n").size());
  EXPECT_ERROR(parse_frame_description(text, "x.frame"), "x.frame: key 'gyro.unit' is missing: expected a text");
}

TEST(FrameDescription, AnUnknownNameShowsTheKnownOnes) {
  EXPECT_ERROR(
      find_frame("stim"),
      "frame 'stim' is not known: expected one of f32_bddb0a, f64_55aa34, kvh1750, laser_gyro, novatel_rawimusx, "
      "pulses_9966, stim300, or a file (with '/' or '.frame' in its name)");
  EXPECT_FALSE(find_frame("./not-there.frame").ok());
}

}  // namespace
}  // namespace turncal
