#include "imu_io/recordings/parameter_file.h"

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/text.h"
#include "recording_samples.h"
#include "tests/said.h"
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

TEST(ParameterFile, OneLineForEachDefect) {
  const std::string text = formatted(make_file());
  expect_said("imu_io/parameters.said", [&](const std::string& name, const std::string& what, const std::string& with) {
    const std::string changed = replaced(text, what, with);
    return said_of(parse_parameter_file(name == "resealed" ? resealed(changed) : changed, "p.conf"));
  });
  const auto said = [](const std::string& cut) { return said_of(parse_parameter_file(cut, "p.conf")); };
  const std::string none = "p.conf: no checksum: expected 'checksum = ' and 8 hex digits in the last line";
  EXPECT_EQ(said(text.substr(0, text.size() - 1)),
            "p.conf: wrong checksum: the file was damaged or edited after it was written");
  EXPECT_EQ(said(text.substr(0, text.rfind("checksum"))), none);
  EXPECT_EQ(said(""), none);
}

TEST(ParameterFile, WhatCannotBeWrittenIsRefusedBeforeTheFileIsTouched) {
  using Change = void (*)(ParameterFile&);
  const std::string printable = "expected printable text without '#', not empty",
                    begins = "expected one that begins with noise., quality., record. or verdict.";
  const std::pair<Change, std::string> cases[] = {
      {[](ParameterFile& f) { f.parameters[6] = std::nan(""); }, "'n11' is not finite"},
      {[](ParameterFile& f) { f.sigma[0] = -1.0; }, "'sigma.N01' expected a number >= 0"},
      {[](ParameterFile& f) { f.unit_serial = "a\nb"; }, "'unit_serial' = 'a\nb': " + printable},
      {[](ParameterFile& f) { f.method.clear(); }, "'method' = '': " + printable},
      {[](ParameterFile& f) { f.effects.push_back(f.effects[0]); }, "'effect.accel_size_effect.x_rx' occurs twice"},
      {[](ParameterFile& f) { f.effects[0].component = "x.y"; },
       "'effect.accel_size_effect.x.y' expected effect.<name>.<component>"},
      {[](ParameterFile& f) { f.add_further("colour", "red"); }, "'colour' " + begins},
      {[](ParameterFile& f) { f.add_further("noise..x", "1"); }, "'noise..x' " + begins}};
  TemporaryFolder folder;
  for (const auto& [change, message] : cases) {
    ParameterFile file = make_file();
    change(file);
    EXPECT_ERROR(write_parameter_file(file, folder / "p.conf"), "parameter file: key " + message);
    EXPECT_TRUE(folder.names().empty());
  }
}

TEST(ParameterFile, ReplacesOnlyItsOwnKind) {
  TemporaryFolder folder;
  const std::string path = folder / "p.conf";
  write_file(path, "TCREC recording");
  EXPECT_ERROR(write_parameter_file(make_file(), path),
               path + ": is a file of another kind, and is not replaced: expected another name");
  write_file(path, formatted(make_file()));
  EXPECT_OK(write_parameter_file(make_file(), path));
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
  using Change = void (*)(RecordingInfo&);
  const std::pair<Change, std::string> cases[] = {
      {[](RecordingInfo& i) { i.unit_serial = "LG-8"; }, "'unit_serial' = 'LG-7': expected 'LG-8'"},
      {[](RecordingInfo& i) { i.gyro_increment = IncrementKind::physical; },
       "'gyro_increment' = 'pulses': expected rad"},
      {[](RecordingInfo& i) { i.accel_increment = IncrementKind::physical; },
       "'accel_increment' = 'pulses': expected mps"},
      {[](RecordingInfo& i) { i.sample_period_s = 0.0025; }, "'sample_period_s' = '0.005': expected 0.0025"},
      {[](RecordingInfo& i) { i.sample_period_s = 0.0050015; }, "'sample_period_s' = '0.005': expected 0.0050015"},
      {[](RecordingInfo& i) { i.sample_period_s = 0.0050005; }, ""},  // another clock
      {[](RecordingInfo& i) { i.accel_pulse_mps = 0.001; }, "'accel_pulse_mps' = '0.0005': expected 0.001"}};
  for (const auto& [change, message] : cases) {
    RecordingInfo other = make_info();
    change(other);
    const Status said = check_applicable(file, "p.conf", other);
    EXPECT_EQ(said.ok() ? "" : said.error().message,
              message.empty() ? "" : "p.conf: key " + message + ", as in the recording");
  }
  ParameterFile simulated = file;
  simulated.simulated = true;
  EXPECT_ERROR(check_applicable(simulated, "p.conf", make_info()),
               "p.conf: simulated parameters: expected those of a real calibration for this recording");
  RecordingInfo rig = make_info();
  rig.simulated = true;
  ASSERT_OK(check_applicable(simulated, "p.conf", rig));
}

// ---- in other forms: the binary block, and a C header read by a C program ----

ParameterFile forms_file() {
  ParameterFile file = test::make_parameter_file();
  for (int i = 0; i < parameter_count; ++i) file.parameters[i] += 1e-7 / (i + 3);
  file.add_further("quality.trusted", "false");
  return file;
}

// Read as docs/files.md has it.
TEST(ParameterForms, TheBlockIsAsDocumented) {
  const ParameterFile file = forms_file();
  const std::string block = format_parameter_block(file);
  ASSERT_TRUE(block.starts_with(std::string_view("TCPB\1\0\0\0\1\1\0\0", 12)))
      << "pulses, neither simulated nor trusted";
  const auto bytes = std::as_bytes(std::span(block));
  ByteReader reader(bytes.subspan(12));
  for (const double expected : {file.sample_period_s, file.accel_pulse_mps, file.latitude_deg, file.gravity_mps2})
    EXPECT_EQ(reader.get<double>(), expected);
  EXPECT_TRUE(std::isnan(reader.get<double>()));  // no reference temperature
  for (const double expected : file.parameters) EXPECT_EQ(reader.get<double>(), expected);
  for (const std::optional<double>& expected : file.sigma) {
    const double sigma = reader.get<double>();
    EXPECT_TRUE(expected ? sigma == *expected : std::isnan(sigma));
  }
  EXPECT_EQ(reader.get_text(), file.unit_serial);
  ASSERT_EQ(reader.get<std::uint32_t>(), file.effects.size());
  for (const EffectValue& effect : file.effects) {
    EXPECT_EQ(reader.get_text(), effect.name + "." + effect.component);
    EXPECT_EQ(reader.get<double>(), effect.value);
  }
  EXPECT_EQ(reader.get<std::uint32_t>(), crc32c(bytes.first(bytes.size() - 4)));
  EXPECT_TRUE(reader.at_end());
}

TEST(ParameterForms, ACProgramReadsTheHeader) {
  if (std::system("cc --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no C compiler";
  const TemporaryFolder folder;
  const ParameterFile file = forms_file();
  std::ofstream(folder / "calibration.h") << format_parameter_header(file);
  std::ofstream(folder / "main.c")
      << "#include <stdio.h>\n#include \"calibration.h\"\n#include \"calibration.h\"\nint main(void) {\n"
         "  printf(\"%.17g %.17g %.17g %d\", turncal_n[1][2], turncal_A0_g[2], turncal_effect_accel_size_effect_x_rx,\n"
         "         turncal_trusted);\n  return 0;\n}\n";
  const std::string command =
      "cd " + folder.path() + " && cc -std=c99 -pedantic -Werror main.c -o main && ./main > said";
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::ifstream said(folder / "said");
  double n23 = 0.0, A03 = 0.0, effect = 0.0;
  int trusted = 1;
  said >> n23 >> A03 >> effect >> trusted;
  EXPECT_EQ(n23, file.parameters[11]);
  EXPECT_EQ(A03, file.parameters[5]);
  EXPECT_EQ(effect, 12.5);
  EXPECT_EQ(trusted, 0);
}

// A serial number with all that a quote could trip over stays what it is.
TEST(ParameterForms, TextsAreNotAltered) {
  ParameterFile file = forms_file();
  file.unit_serial = "it's \"7\\8\"?\?/";
  EXPECT_SAYS(format_parameter_yaml(file), "\nunit_serial: 'it''s \"7\\8\"?\?/'\n");
  EXPECT_SAYS(format_parameter_header(file), "= \"it's \\0427\\1348\\042\\077\\077/\";");
}

}  // namespace
}  // namespace turncal
