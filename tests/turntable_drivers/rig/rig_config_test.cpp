// The rig's text configuration: defaults, every kind of key, every kind of mistake, and docs/rig.md.
#include "turntable_drivers/rig/rig_config.h"

#include <regex>
#include "tests/said.h"

#include "tests/turntable_drivers/rig/perfect_rig.h"
#include "turntable_drivers/rig/rig.h"

namespace turncal {
namespace {

TEST(RigConfig, ReadsEveryPartOfAFile) {
  const Result<RigConfig> config = good(parse_rig_config(R"(
# a unit with one effect and three faults
seed = 17
noise.seed = 18
unit_serial = RLG-0042
random_truth = false
truth.N01 = -0.05
truth.a33 = 1.02
quantisation = round
site.latitude_deg = 45
site.magnetic_up_gauss = -0.4
noise.gyro_random_walk_deg_per_rt_h = 0
temperature.reference_c = 27
table_error.random_arcmin = 0
table_error.north_arcmin = 2.5
table_error.roll.encoder_order = 5
table_error.roll.encoder_harmonic_arcsec = 3
table.pitch.limit_max_deg = 400
table.in_position = late
effect.accel_second_order.y = 12.5
effect.gyro_warm_up.tau_s = 600
outside.gyro_angle_periodic.axis = z
outside.gyro_angle_periodic.table_axis = roll
outside.gyro_angle_periodic.size_degph = 0.02
fault.1.kind = lost_sample
fault.1.sample = 120000
fault.1.count = 3
fault.1.hidden = true
fault.2.kind = velocity_knock
fault.2.sample = 5
fault.2.axis = y
fault.2.size_mps = 0.05
fault.3.kind = table_moved
fault.3.time_s = 350.5
fault.3.axis = pitch
fault.3.size_deg = 0.01
fault.3.rate_degps = 0.2
fault.4.kind = emergency_stop
fault.4.time_s = 12
fault.4.duration_s = 34
)",
                                                         "bench.rig"));
  EXPECT_EQ(config->seed, 17u);
  EXPECT_EQ(config->noise_seed, 18u);
  EXPECT_EQ(config->unit_serial, "RLG-0042");
  EXPECT_FALSE(config->random_truth);
  EXPECT_EQ(config->truth[0], -0.05);
  EXPECT_EQ(config->truth[23], 1.02);
  EXPECT_FALSE(config->truth[1].has_value());
  EXPECT_EQ(config->quantisation, RigQuantisation::round);
  EXPECT_EQ(config->site.latitude_deg, 45.0);
  EXPECT_EQ(config->site.magnetic_field_gauss[1], -0.4);
  EXPECT_EQ(config->noise.gyro_random_walk_deg_per_rt_h, 0.0);
  EXPECT_EQ(config->noise.accel_random_walk_ug_per_rt_hz, 8.0);
  EXPECT_EQ(config->temperature.reference_c, 27.0);
  EXPECT_EQ(config->table_errors.north_arcmin, 2.5);
  EXPECT_EQ(config->table_errors.encoder[2].order, 5);
  EXPECT_EQ(config->table.limit_max_deg[1], 400.0);
  EXPECT_EQ(config->table.in_position, InPositionFlag::late);
  EXPECT_EQ(config->effects.accel_second_order[1], 12.5);
  EXPECT_EQ(config->effects.gyro_warm_up_tau_s, 600.0);
  EXPECT_EQ(config->outside.gyro_angle_periodic.axis, 2);
  EXPECT_EQ(config->outside.gyro_angle_periodic.table_axis, Axis::roll);
  ASSERT_EQ(config->faults.size(), 4u);
  EXPECT_EQ(config->faults[0].kind, RigFaultKind::lost_sample);
  EXPECT_EQ(config->faults[0].sample, 120000);
  EXPECT_EQ(config->faults[0].count, 3);
  EXPECT_TRUE(config->faults[0].hidden);
  EXPECT_EQ(config->faults[1].axis, 1);
  EXPECT_EQ(config->faults[1].size, 0.05);
  EXPECT_EQ(config->faults[2].axis, int(Axis::pitch));
  EXPECT_EQ(config->faults[2].time_s, 350.5);
  EXPECT_EQ(config->faults[2].rate_degps, 0.2);
  EXPECT_EQ(config->faults[3].duration_s, 34.0);
}

TEST(RigConfig, ErrorsNameFileLineKeyAndValue) {
  expect_said("turntable_drivers/rigs.said", [](const std::string&, const std::string&, const std::string& with) {
    return said_of(parse_rig_config(with, "bench.rig"));
  });
  EXPECT_TRUE(fails(read_rig_config("/nonexistent/rig.conf"), ErrorKind::input));
}

std::string replace_all(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

// docs/rig.md lists `key = default` lines; all of them, read as one file, are the default configuration. AXIS and B
// stand for the three table axes and x y z.
TEST(RigConfig, TheDocumentListsTheDefaults) {
  std::ifstream document(TURNCAL_SOURCE_DIR "/docs/rig.md");
  ASSERT_TRUE(document.is_open());
  std::set<std::string> lines;
  std::string line;
  bool inside = false;
  while (std::getline(document, line)) {
    if (line.rfind("```", 0) == 0) {
      inside = line == "```rig";
    } else if (inside && line.find('=') != std::string::npos) {
      for (const char* axis : {"heading", "pitch", "roll"})
        for (const char* b : {"x", "y", "z"}) lines.insert(replace_all(replace_all(line, "AXIS", axis), "(B)", b));
    }
  }
  EXPECT_GT(lines.size(), 90u);
  std::string text;
  for (const std::string& each : lines) text += each + "\n";
  const Result<RigConfig> config = good(parse_rig_config(text, "docs/rig.md"));
  // The same unit, table, time and noise as without any key, so every default is the one in force.
  Rig a(*config), b(default_rig_config());
  EXPECT_EQ(a.truth(), b.truth());
  EXPECT_EQ(a.table_errors(), b.table_errors());
  EXPECT_EQ(config->start_utc_s, default_rig_config().start_utc_s);
  EXPECT_EQ(config->table.limit_min_deg, default_rig_config().table.limit_min_deg);
  EXPECT_EQ(config->table.max_rate_degps, default_rig_config().table.max_rate_degps);
  EXPECT_EQ(config->table.home_time_s, default_rig_config().table.home_time_s);
  EXPECT_EQ(config->table.in_position_time_s, default_rig_config().table.in_position_time_s);
  EXPECT_EQ(config->site.magnetic_field_gauss, default_rig_config().site.magnetic_field_gauss);
  a.command_move(Axis::pitch, 20.0, 10.0, 10.0);
  b.command_move(Axis::pitch, 20.0, 10.0, 10.0);
  for (int i = 0; i < 1000; ++i) {
    const ImuSample x = next_sample(a), y = next_sample(b);
    ASSERT_EQ(x.gyro, y.gyro);
    ASSERT_EQ(x.accel, y.accel);
    ASSERT_EQ(x.temperature_c, y.temperature_c);
  }
}

// Every piece of a key that the reader asks for stands in the document.
TEST(RigConfig, TheDocumentHasEveryKeyOfTheReader) {
  const std::string document = file_text(TURNCAL_SOURCE_DIR "/docs/rig.md");
  const std::string reader = file_text(TURNCAL_SOURCE_DIR "/turntable_drivers/rig/rig_config.cpp");
  const std::regex literal("\"([a-z_][a-z_0-9.]*)\"");
  int found = 0;
  for (auto at = std::sregex_iterator(reader.begin(), reader.end(), literal); at != std::sregex_iterator(); ++at) {
    std::string piece = (*at)[1];
    if (std::ranges::find(rig_truth_keys, piece) != rig_truth_keys.end()) continue;
    while (!piece.empty() && (piece.back() == '.' || piece.back() == '_')) piece.pop_back();
    EXPECT_SAYS(document, piece) << piece;
    ++found;
  }
  EXPECT_GT(found, 100);
  for (const std::string& key : rig_effect_keys())
    EXPECT_SAYS(document, "effect." + key.substr(0, key.find('.')) + ".") << key;
}

}  // namespace
}  // namespace turncal
