#include "imu_io/recordings/parameter_file.h"

#include "imu_io/base/crc.h"
#include "recording_samples.h"
#include "tests/test.h"

namespace turncal {
namespace {

using test::make_info;

ParameterFile make_file() {
  ParameterFile file = test::make_parameter_file();
  file.reference_temperature_c = 27.25;
  file.add_further("noise.gyro_arw_deg_per_sqrt_h.x", 0.002);
  file.add_further("record.operator", "A. Smith");
  return file;
}

std::string formatted(const ParameterFile& file) { return expect_value(format_parameter_file(file)); }

// Puts a right checksum under an edited text, so that what stands above it is judged.
std::string resealed(std::string text) {
  text.resize(text.rfind("checksum = "));
  return with_checksum(text);
}

// Doubles of every exponent, denormals and negative zero among them.
TEST(ParameterFile, ReadingAndWritingAgainGivesTheSameBytes) {
  std::mt19937_64 random(11);
  const auto any_double = [&] {
    for (;;) {
      switch (random() % 8) {
        case 0: return -0.0;
        case 1: return std::bit_cast<double>(random() >> 12);  // denormal
        default: break;
      }
      const double x = std::bit_cast<double>(random());
      if (std::isfinite(x)) return x;
    }
  };
  for (int round = 0; round < 2000; ++round) {
    ParameterFile file = make_file();
    for (int i = 0; i < parameter_count; ++i) file.parameters[i] = any_double();
    for (auto& sigma : file.sigma) {
      sigma.reset();
      if (random() % 2 == 0) sigma = std::abs(any_double());
    }
    file.effects.clear();
    for (int i = 0; i < int(random() % 5); ++i) {
      file.effects.push_back({"effect_" + std::to_string(i), "x_rx", any_double(), {}});
      if (random() % 2 == 0) file.effects.back().sigma = std::abs(any_double());
    }
    file.simulated = random() % 2 == 0;
    if (random() % 2 == 0) file.reference_temperature_c.reset();
    file.add_further("noise.x", any_double());
    const std::string text = formatted(file);
    const auto read = good(parse_parameter_file(text, "p.conf"));
    ASSERT_EQ(formatted(*read), text);
    for (int i = 0; i < parameter_count; ++i)
      ASSERT_EQ(std::bit_cast<std::uint64_t>(read->parameters[i]), std::bit_cast<std::uint64_t>(file.parameters[i]));
  }
}

// Coefficients of temperature: the same bytes again; the value clamped to the range; a range that holds no reference is refused. Without them no
// key is written.
TEST(ParameterFile, TemperatureCoefficients) {
  ParameterFile file = make_file();
  EXPECT_SAYS_NOT(formatted(file), "temperature.");
  TemperaturePolynomials& t = file.temperature.emplace();
  t.reference_c = 20.0, t.low_c = -30.0, t.high_c = 70.0;
  t.coefficient.row(0) << 0.5, 0.25, -0.125;
  t.coefficient(23, 1) = -0.0;
  t.sigma(0, 0) = 1e-3;
  const std::string text = formatted(file);
  EXPECT_SAYS(text,
              "temperature.reference_c = 20\ntemperature.range_c = -30, 70\ntemperature.N01.1 = "
              "0.5\nsigma.temperature.N01.1 = 0.001\n");
  const auto read = parse_parameter_file(text, "p.conf");
  ASSERT_OK(read);
  EXPECT_EQ(formatted(*read), text);
  EXPECT_EQ(read->temperature->at(read->parameters, 22.0)[0], read->parameters[0] + 1.0 + 1.0 - 1.0);
  EXPECT_EQ(read->temperature->at(read->parameters, 22.0)[1], read->parameters[1]);
  EXPECT_EQ(read->temperature->at(read->parameters, 90.0), read->temperature->at(read->parameters, 70.0));
  EXPECT_TRUE(fails(parse_parameter_file(resealed(replaced(text, "range_c = -30, 70", "range_c = 70, -30")), "p.conf"),
                    "'temperature.range_c' = '70, -30': expected the lower"));
  EXPECT_TRUE(fails(parse_parameter_file(resealed(replaced(text, "temperature.N01.1 = 0.5\n", "")), "p.conf"),
                    "'sigma.temperature.N01.1' is unknown"));
}

TEST(ParameterFile, EveryFlippedBitAndEveryCutIsRefused) {
  const std::string text = formatted(make_file());
  for (std::size_t place = 0; place < text.size(); ++place) {
    ASSERT_FALSE(parse_parameter_file(text.substr(0, place), "p.conf").ok()) << place;
    for (int bit = 0; bit < 8; ++bit) {
      std::string damaged = text;
      damaged[place] = char(damaged[place] ^ (1 << bit));
      ASSERT_FALSE(parse_parameter_file(damaged, "p.conf").ok()) << place << " " << bit;
    }
  }
}

TEST(ParameterFile, Refusals) {
  const std::string text = formatted(make_file());
  const auto parse = [](const std::string& t) { return parse_parameter_file(t, "p.conf"); };
  const std::string wrong = "p.conf: wrong checksum: the file was damaged or edited after it was written";
  EXPECT_ERROR(parse(replaced(text, "n12 = 0", "n12 = 1")), wrong);
  EXPECT_ERROR(parse(text.substr(0, text.size() - 1)), wrong);  // the last line end is gone
  EXPECT_ERROR(parse(replaced(text, "N01 = 0\n", "N01 = 0\r\n")), wrong);
  EXPECT_ERROR(parse(text + "n12 = 1\n"), "p.conf: text after the checksum: expected it to be the last line");
  EXPECT_ERROR(parse(text.substr(0, text.rfind("checksum"))),
               "p.conf: no checksum: expected 'checksum = ' and 8 hex digits in the last line");
  EXPECT_ERROR(parse(""), "p.conf: no checksum: expected 'checksum = ' and 8 hex digits in the last line");
  EXPECT_ERROR(parse(resealed(replaced(text, "n23 = 0\n", ""))), "p.conf: key 'n23' is missing: expected a number");
  EXPECT_ERROR(parse(resealed(replaced(text, "unit_serial = LG-7\n", ""))),
               "p.conf: key 'unit_serial' is missing: expected a text");
  // What the writer would refuse the reader refuses too.
  EXPECT_ERROR(parse(resealed(replaced(text, "unit_serial = LG-7\n", "unit_serial = LG\t7\n"))),
               "p.conf:51: key 'unit_serial' = 'LG?7': expected printable text");
  EXPECT_ERROR(parse(resealed(replaced(text, "n23 = 0\n", "n23 = 0\nn23 = 0\n"))),
               "p.conf:14: key 'n23' again: it is already in line 13");
  EXPECT_ERROR(parse(resealed(replaced(text, "n23 = 0\n", "n23 = 0\nn24 = 0\n"))), "p.conf:14: key 'n24' is unknown");
  EXPECT_ERROR(parse(resealed(replaced(text, "sigma.N01", "sigma.N09"))),
               "p.conf:26: key 'sigma.N09' is unknown; did you mean 'sigma.N01'?");
  EXPECT_ERROR(parse(resealed(replaced(text, "n23 = 0\n", "n23 = nan\n"))),
               "p.conf:13: key 'n23' = 'nan': expected a number");
  EXPECT_ERROR(parse(resealed(replaced(text, "sigma.N01 = 1e-07", "sigma.N01 = -1"))),
               "p.conf:26: key 'sigma.N01' = '-1': expected a number >= 0");
  EXPECT_ERROR(parse(resealed(replaced(text, "effect.gyro_warm_up.tau_s", "effect.gyro_warm_up"))),
               "p.conf:50: key 'effect.gyro_warm_up' = '600': expected a key effect.<name>.<component>");
  EXPECT_ERROR(
      parse(resealed(replaced(text, "sigma.effect.accel_size_effect.x_rx", "sigma.effect.accel_size_effect.x_ry"))),
      "p.conf:49: key 'sigma.effect.accel_size_effect.x_ry' is unknown; did you mean "
      "'sigma.effect.accel_size_effect.x_rx'?");
}

TEST(ParameterFile, WhatCannotBeWrittenIsRefusedBeforeTheFileIsTouched) {
  TemporaryFolder folder;
  const auto refused = [&](auto change, const std::string& message) {
    ParameterFile file = make_file();
    change(file);
    const Status status = write_parameter_file(file, folder / "p.conf");
    EXPECT_ERROR(status, "parameter file: key " + message);
    EXPECT_TRUE(folder.names().empty());
  };
  refused([](ParameterFile& f) { f.parameters[6] = std::nan(""); }, "'n11' is not finite");
  refused([](ParameterFile& f) { f.sigma[0] = -1.0; }, "'sigma.N01' expected a number >= 0");
  refused([](ParameterFile& f) { f.unit_serial = "a\nb"; },
          "'unit_serial' = 'a\nb': expected printable text without '#', not empty");
  refused([](ParameterFile& f) { f.method.clear(); }, "'method' = '': expected printable text without '#', not empty");
  refused([](ParameterFile& f) { f.effects.push_back(f.effects[0]); }, "'effect.accel_size_effect.x_rx' occurs twice");
  refused([](ParameterFile& f) { f.effects[0].component = "x.y"; },
          "'effect.accel_size_effect.x.y' expected effect.<name>.<component>");
  refused([](ParameterFile& f) { f.add_further("colour", "red"); },
          "'colour' expected one that begins with noise., quality., record. or verdict.");
  refused([](ParameterFile& f) { f.add_further("noise..x", "1"); },
          "'noise..x' expected one that begins with noise., quality., record. or verdict.");
}

// What a calibration left open is read for the record, not for use.
TEST(ParameterFile, UndeterminedParametersAreNotForUse) {
  ParameterFile file = make_file();
  file.add_further(std::string(undetermined_key), "a11 A01");
  ASSERT_OK(parse_parameter_file(formatted(file), "p.conf"));
  TemporaryFolder folder;
  const std::string path = folder / "p.conf";
  ASSERT_OK(write_parameter_file(file, path));
  EXPECT_ERROR(read_parameter_file(path), path + ": its calibration did not determine a11 A01: expected one that did");
  write_file(path, "");
  EXPECT_ERROR(read_parameter_file(path), path + ": empty file: expected a parameter file");
}

TEST(ParameterFile, AppliesOnlyToItsUnit) {
  const ParameterFile file = make_file();
  ASSERT_OK(check_applicable(file, "p.conf", make_info()));
  const auto refused = [&](auto change, const std::string& message) {
    RecordingInfo other = make_info();
    change(other);
    EXPECT_ERROR(check_applicable(file, "p.conf", other), "p.conf: key " + message + ", as in the recording");
  };
  refused([](RecordingInfo& i) { i.unit_serial = "LG-8"; }, "'unit_serial' = 'LG-7': expected 'LG-8'");
  refused([](RecordingInfo& i) { i.gyro_increment = IncrementKind::physical; },
          "'gyro_increment' = 'pulses': expected rad");
  refused([](RecordingInfo& i) { i.accel_increment = IncrementKind::physical; },
          "'accel_increment' = 'pulses': expected mps");
  refused([](RecordingInfo& i) { i.sample_period_s = 0.0025; }, "'sample_period_s' = '0.005': expected 0.0025");
  refused([](RecordingInfo& i) { i.sample_period_s = 0.0050015; }, "'sample_period_s' = '0.005': expected 0.0050015");
  RecordingInfo another_clock = make_info();
  another_clock.sample_period_s = 0.0050005;
  ASSERT_OK(check_applicable(file, "p.conf", another_clock));
  refused([](RecordingInfo& i) { i.accel_pulse_mps = 0.001; }, "'accel_pulse_mps' = '0.0005': expected 0.001");
  ParameterFile simulated = file;
  simulated.simulated = true;
  EXPECT_ERROR(check_applicable(simulated, "p.conf", make_info()),
               "p.conf: simulated parameters: expected those of a real calibration for this recording");
  RecordingInfo rig = make_info();
  rig.simulated = true;
  ASSERT_OK(check_applicable(simulated, "p.conf", rig));
}

}  // namespace
}  // namespace turncal
