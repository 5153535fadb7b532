// A parameter file in other forms: the binary block there and back, damaged at every byte; the C header compiled and read by a C program.
#include "imu_io/recordings/parameter_file.h"

#include "imu_io/base/bytes.h"
#include "imu_io/base/crc.h"
#include "imu_io/base/text.h"
#include "recording_samples.h"
#include "tests/test.h"

namespace turncal {
namespace {

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
