// Tables without a map, the maps that are shipped, and whether stamps or intervals are believed.
#include "imu_io/recordings/map_proposal.h"
#include "imu_io/recordings/stamps.h"

#include <fmt/format.h>
#include <regex>
#include "imu_io/base/text.h"
#include "tests/imu_io/bag_writer.h"
#include "tests/imu_io/text_columns.h"
#include "tests/test.h"

namespace turncal {
namespace {

using namespace test;

const std::string samples = TURNCAL_SOURCE_DIR "/tests/imu_io/map_samples/";
const std::string maps = TURNCAL_SOURCE_DIR "/docs/maps/";

// The motion in every sample: 60 rows, 0.5 rad/s about x from the 20th on, 9.8 m/s^2. `axes`: where front, up and right are in the file.
void expect_sample_motion(const Result<CsvImport>& import, double period_s, double tolerance, const std::string& where,
                          const AxisOrder& axes = {}) {
  SCOPED_TRACE(where);
  ASSERT_OK(import);
  EXPECT_NEAR(import->info.sample_period_s, period_s, 1e-8);
  ASSERT_EQ(import->samples.size(), 60u);
  double angle = 0.0;
  for (std::size_t k = 0; k < 60; ++k) {
    const double rate = k >= 20 ? 0.5 : 0.0, mid = angle + rate * 0.005;
    angle += rate * 0.01;
    const double gyro[] = {rate, 0.01, -0.02}, accel[] = {0.1, 9.8 * std::sin(mid), 9.8 * std::cos(mid)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double per = axes.sign[axis] / period_s;
      ASSERT_NEAR(import->samples[k].gyro[axis] * per, gyro[axes.from[axis]], tolerance) << k;
      ASSERT_NEAR(import->samples[k].accel[axis] * per, accel[axes.from[axis]], 10.0 * tolerance) << k;
    }
  }
}

TEST(ShippedMaps, EachReadsItsSample) {
  const AxisOrder front_right_down{{0, 2, 1}, {1, -1, 1}}, front_left_up{{0, 2, 1}, {1, 1, -1}},
      right_front_up{{1, 2, 0}, {1, 1, 1}};
  const struct {
    const char *map, *file;
    double period_s, tolerance;
    bool warm;
    AxisOrder axes;
  } cases[] = {{"euroc", "euroc.csv", 0.01, 1e-6, false, {}},
               {"psins_imu", "psins_imu.mat", 0.01, 1e-6, false, right_front_up},
               {"kf_gins", "kf_gins.txt", 0.01, 1e-6, false, front_right_down},
               {"xsens", "xsens.txt", 0.01, 1e-6, false, front_left_up},
               {"vectornav", "vectornav.csv", 0.01, 1e-6, true, front_right_down},
               {"sbg", "sbg.txt", 0.01, 1e-6, true, front_right_down},
               {"adi_adis16475_2", "adi_adis16475_2.csv", 0.0005, 3e-4, true, {}}};
  for (const auto& c : cases) {
    const Result<CsvMap> map = good(read_csv_map(maps + c.map + ".map"));
    const Result<CsvImport> import = import_csv(*map, samples + c.file);
    expect_sample_motion(import, c.period_s, c.tolerance, c.file, c.axes);
    if (import.ok() && c.warm) {
      EXPECT_FLOAT_EQ(import->samples[7].temperature_c, 25.5F) << c.file;
    }
  }
}

Result<MapProposal> propose(const std::string& path, double rate_hz = 0.0) {
  const Result<ColumnSource> source = open_columns(path);
  return source ? propose_map(*source, {9.81, 30.0, rate_hz, "u"}) : Result<MapProposal>(source.error());
}

TEST(MapProposal, ReadsTheSamplesWithoutAMap) {
  for (const char* file : {"euroc.csv", "sbg.txt"}) {
    const Result<MapProposal> proposal = good(propose(samples + file));
    EXPECT_EQ(proposal->doubts, std::vector<std::string>()) << file;
    const Result<CsvMap> map = parse_csv_map(proposal->text, "proposed");
    ASSERT_OK(map) << proposal->text;
    expect_sample_motion(import_csv(*map, samples + file), 0.01, 1e-6, file);
  }
  // Columns that the logger names and leaves empty are none: the time is not GpsToW.
  EXPECT_SAYS(expect_value(propose(samples + "vectornav.csv")).text, "time.column = TimeStartup\ntime.unit = ns\n");
}

// A table of 400 rows that turns or does not, in the given units.
std::string table(const std::string& header, double gyro_unit, double accel_unit, double time_unit, bool turns,
                  double sign = 1.0) {
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0.0, 1e-3);
  std::string text = header + "\n";
  double angle = 0.0;
  for (int k = 0; k < 400; ++k) {
    const double rate = turns ? 0.6 * std::sin(0.02 * k) : 0.0;
    angle += rate * 0.01;
    const double row[] = {0.01 * k / time_unit,
                          sign * (rate + noise(random)) / gyro_unit,
                          noise(random) / gyro_unit,
                          noise(random) / gyro_unit,
                          noise(random) / accel_unit,
                          9.8 * std::sin(angle) / accel_unit,
                          9.8 * std::cos(angle) / accel_unit};
    for (std::size_t c = 0; c < 7; ++c) text += (c == 0 ? "" : ",") + std::to_string(row[c]);
    text += "\n";
  }
  return text;
}

TEST(MapProposal, UnitsAreSeenOrInDoubt) {
  TemporaryFolder folder;
  constexpr double deg = 0.017453292519943295, g = 9.80665;
  const std::string bare = "t,gx,gy,gz,ax,ay,az";
  const struct {
    std::string header;
    double gyro, accel, time;
    bool turns;
    double sign;
    const char *says, *doubt;  // of the map; empty: none
  } cases[] = {
      {bare, 1, 1, 1, true, 1, "gyro.unit = rad/s\n", ""},
      {bare, deg, g, 1, true, 1, "accel.unit = g\n", ""},
      {bare, deg, 1, 1, true, 1, "gyro.unit = deg/s\n", ""},
      {bare, deg, 1, 1e-3, true, 1, "time.unit = ms\n", ""},
      {bare, deg, 1, 1e-6, true, 1, "time.unit = us\n", ""},
      {bare, deg, 1e-3 * g, 1, true, 1, "", "the norm of 999.3 is gravity in cm/s^2 and in mg"},
      {"t,gx,gy,gz,ax [mg],ay [mg],az [mg]", deg, 1e-3 * g, 1, true, 1, "accel.unit = mg\n", ""},
      {"t,gx,gy,gz,ax [cm/s^2],ay [cm/s^2],az [cm/s^2]", 1, 1e-2, 1, true, 1, "accel.unit = cm/s^2\n", ""},
      {bare, 1e-3, 1, 1, true, 1, "gyro.unit = mrad/s\n", ""},
      {"t (s),wx (°/s),wy (°/s),wz (°/s),ax (m/s²),ay (m/s²),az (m/s²)", deg, 1, 1, false, 1, "gyro.unit = deg/s\n",
       ""},
      {"t (µs),wx (°/h),wy (°/h),wz (°/h),ax,ay,az", deg / 3600, 1, 1e-6, false, 1, "gyro.unit = deg/h\n", ""},
      {"t_s,wx [rad·s⁻¹],wy [rad·s⁻¹],wz [rad·s⁻¹],ax [cm·s⁻²],ay [cm·s⁻²],az [cm·s⁻²]", 1, 1e-2, 1, false, 1,
       "accel.unit = cm/s^2\n", ""},
      {"elapsed,gyro1,gyro2,gyro3,ax,ay,az", 1, 1, 1, true, 1, "gyro.columns = gyro1, gyro2, gyro3\n", ""},
      {bare, deg / 3600, 1, 1, true, 1, "gyro.unit = deg/h\n", ""},
      {bare, 1, 1, 1, false, 1, "", "gyro.unit: the header does not say it"},
      {"t_s,gx_mdps,gy_mdps,gz_mdps,ax,ay,az", 1, 1, 1, false, 1, "gyro.unit = mdeg/s\n", ""},
      {"sensor_time,gx_mdps,gy_mdps,gz_mdps,ax,ay,az", 1, 1, 1, false, 1, "", "time.unit: the header does not say it"},
      {bare, 1, 1.2, 1, true, 1, "", "is within 12 % of gravity in none of"},
      {bare, 1, 1, 1, true, -1, "", "gravity turns against the gyros"},
      {"t,gy,gx,gz,ax,ay,az", 1, 1, 1, true, 1, "", "gravity turns against the gyros"},
      {bare, 1, 0.004, 1, true, 1, "", "gravity in none of"},
      {"t_ms,gx,gy,gz,ax,ay,az", 1, 1, 1, true, 1, "", "the header says ms, which is 1e+05 Hz; in s it is 100 Hz"},
      {"time [s],gyr_x_degps,gyr_y_degps,gyr_z_degps,acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]", deg, 1, 1, false, 1,
       "gyro.unit = deg/s\n", ""},
      {"time,gyr_x_degps,gyr_y_degps,gyr_z_degps,ax,ay,az", 1, 1, 1, true, 1, "",
       "which is rad/s; the header says deg/s"},
      {"a,gx,gy,gz,ax,ay,az", 1, 1, 1, true, 1, "", "there is no column of times (--rate"}};
  for (const auto& c : cases) {
    const std::string path = folder / "log.csv";
    std::ofstream(path) << table(c.header, c.gyro, c.accel, c.time, c.turns, c.sign);
    const Result<MapProposal> proposal = good(propose(path));
    const std::string all = ::testing::PrintToString(proposal->doubts);
    EXPECT_TRUE(*c.doubt != '\0' || proposal->doubts.empty()) << all << proposal->text;
    EXPECT_SAYS(all, c.doubt);
    EXPECT_SAYS(proposal->text, c.says);
    EXPECT_OK(parse_csv_map(proposal->text, "proposed"));
  }
  EXPECT_SAYS(propose(folder / "log.csv", 125.0)->text, "400 rows at 125 Hz.\ngyro.columns") << "without a doubt";
  const std::string rows = table(bare, 1, 1, 1, true);
  std::ofstream(folder / "dead.csv") << std::regex_replace(rows, std::regex("\n((?:[^,\n]*,){3})[^,\n]+"), "\n$010");
  std::string stamped, split;
  for (std::string_view left = rows; !left.empty();) {
    const std::string_view line = next_line(left);
    const std::string time(line.substr(0, line.find(','))), cells(line.substr(line.find(',')));
    split += split.empty() ? "stamp.nsecs,stamp.secs" : fmt::format("{}000000,170000000{}", line.substr(2, 3), line[0]);
    split += cells + "\n";
    const std::string abroad = "2026-01-01T02:00:0" + time + "+02:00", here = "2026-01-01 00:00:0" + time;
    stamped += (stamped.empty() ? "when" : line.size() % 2 == 0 ? abroad : here) + cells + "\n";
  }
  EXPECT_SAYS(propose(folder / "dead.csv")->text, "# In doubt: gyro.columns: 'gz' is 0 throughout");
  std::ofstream(folder / "stamped.csv") << stamped;
  std::ofstream(folder / "split.csv") << split;
  for (const char* file : {"stamped.csv", "split.csv"}) {
    const CsvMap times = expect_value(parse_csv_map(propose(folder / file)->text, "proposed"));
    EXPECT_NEAR(expect_value(import_csv(times, folder / file)).info.sample_period_s, 0.01, 1e-6);
  }
  std::ofstream(folder / "x.csv") << table("t,mx,my,mz,qx,qy,qz", 1, 1, 1, true);
  EXPECT_TRUE(fails(
      propose(folder / "x.csv"),
      "no three columns can be recognised as the gyros: expected --map with their names; the columns are 't', 'mx'"));
  std::ofstream(folder / "y.csv") << "nothing but words\n";
  EXPECT_TRUE(fails(propose(folder / "y.csv"), "no row of six numbers"));
  std::ofstream(folder / "z.csv") << table("t,gx,gy,gz,gyro2_x,gyro2_y,gyro2_z", 1, 1, 1, true);
  EXPECT_TRUE(fails(propose(folder / "z.csv"), "accelerometers"));
}

// KF-GINS, and the other way round: increments in a matrix without names.
TEST(MapProposal, OfColumnsWithoutNames) {
  TemporaryFolder folder;
  const std::string rows = table("", 100, 100, 1, true);
  std::ofstream(folder / "first.txt") << rows.substr(1);
  std::ofstream(folder / "last.txt") << std::regex_replace(
      rows.substr(1), std::regex("(.*),(.*),(.*),(.*),(.*),(.*),(.*)"), "$5 $6 $7 $2 $3 $4 $1");
  for (const char* file : {"first.txt", "last.txt"}) {
    const Result<MapProposal> proposal = good(propose(folder / file));
    EXPECT_TRUE(proposal->doubts.empty()) << proposal->text;
    const bool first = std::string_view(file) == "first.txt";
    EXPECT_SAYS(
        proposal->text,
        first
            ? "gyro.columns = 2, 3, 4\ngyro.unit = rad\naccel.columns = 5, 6, 7\naccel.unit = m/s\ntime.column = 1\n"
            : "gyro.columns = 4, 5, 6\ngyro.unit = rad\naccel.columns = 1, 2, 3\naccel.unit = m/s\ntime.column = 7\n");
    EXPECT_OK(import_csv(expect_value(parse_csv_map(proposal->text, "p")), folder / file));
  }
}

TEST(MapProposal, OfThermometers) {
  TemporaryFolder folder;
  const struct {
    std::string names, readings;
    const char *says, *doubt;  // empty: none
  } cases[] = {{"temp", "25.5", "temperature.column = temp\n", ""},
               {"Temperatur (°F)", "77", "temperature.offset = 32\ntemperature.scale = 0.5555555555555556\n", ""},
               {"temp", "-3200", "", "a reading of -3200 is -3200 C"},
               {"temp", "25000", "", "a reading of 25000 is 25000 C"},
               {"temp", "298.15", "", "a reading of 298.15 is 298.15 C"},
               {"temp [K]", "298.15", "temperature.offset = 273.15\n", ""},
               {"cpu_temp,imu_temp", "50,25", "temperature.column = imu_temp\n", ""},
               {"Gyro_Temp [C],Acc_Temp [C]", "25,26", "temperature.column = Gyro_Temp [C]\n", ""},
               {"baro_temperature,Temperature", "50,25", "temperature.column = Temperature\n", ""},
               {"CPU_temp", "50", "", "which temperature is the unit's: 'CPU_temp'"},
               {"temp1,temp2", "50,25", "", "which temperature is the unit's: 'temp1', 'temp2'"}};
  for (const auto& c : cases) {
    std::string text = table("t_s,gyro_x,gyro_y,gyro_z,ax,ay,az," + c.names, 1, 1, 1, true);
    for (std::size_t at = text.find('\n') + 1; (at = text.find('\n', at)) != text.npos; at += c.readings.size() + 2)
      text.insert(at, "," + c.readings);
    write_file(folder / "log.csv", text);
    const Result<MapProposal> proposal = good(propose(folder / "log.csv"));
    EXPECT_SAYS(proposal->text, c.says);
    EXPECT_EQ(proposal->doubts.empty(), *c.doubt == 0) << c.names << ::testing::PrintToString(proposal->doubts);
    EXPECT_SAYS(::testing::PrintToString(proposal->doubts), c.doubt);
  }
}

TEST(MapProposal, OfABag) {
  TemporaryFolder folder;
  BagTopic topic;
  for (int k = 0; k < 50; ++k) {
    const BagMessage m{1'700'000'000'000'000'000 + 10'000'000 * k, {0.1, 0.0, 0.0}, {0.0, 0.0, 9.8}};
    topic.messages.emplace_back(m.ns, imu_message(m));
  }
  std::ofstream(folder / "a.mcap", std::ios::binary) << mcap({topic}, "zstd");
  const Result<ColumnSource> source = good(open_columns(folder / "a.mcap"));
  const Result<MapProposal> proposal = good(propose_map(*source, {}));
  const Result<CsvImport> import = good(import_columns(
      expect_value(parse_csv_map(replaced(proposal->text, "unit_serial = ", "unit_serial = a"), "p")), *source));
  EXPECT_NEAR(import->samples[3].accel[2], 0.098, 1e-12);
  EXPECT_EQ(import->info.started_utc_s, 1'700'000'000);
  for (auto& [ns, message] : topic.messages) message = imu_message({ns, {0.1, 0.0, 0.0}, {0.0, 0.0, 1.0}});
  std::ofstream(folder / "g.mcap", std::ios::binary) << mcap({topic}, "zstd");
  EXPECT_SAYS(propose(folder / "g.mcap")->text, "the header says m/s^2, the norm of 1 is gravity in g");
  EXPECT_TRUE(fails(open_columns(samples + "euroc.csv", "/imu"), "topic '/imu': expected a ROS bag"));
}

// A comma at the end of the rows alone is nothing; cells without a name are said.
TEST(MapProposal, OfRowsLongerThanTheHeader) {
  TemporaryFolder folder;
  for (const auto& [more, what] : {std::pair(",", ""), {",1,2", "(line 1 has 7 names, a row 9 cells)"}}) {
    std::ofstream(folder / "log.csv") << std::regex_replace(table("t,gx,gy,gz,ax,ay,az", 1, 1, 1, true),
                                                            std::regex("(\\d)\n"), std::string("$1") + more + "\n");
    const Result<MapProposal> proposal = propose(folder / "log.csv");
    if (std::strlen(what) > 0)
      EXPECT_TRUE(fails(proposal, what));
    else
      EXPECT_EQ(expect_value(proposal).doubts, std::vector<std::string>());
  }
}

// Columns are what they are called at their end; a thermometer counts in what its header says.
TEST(MapProposal, OfNamesInAGroup) {
  TemporaryFolder folder;
  for (const char* separator : {"/", ".", ":"}) {
    std::string header = "t,gx,gy,gz,ax,ay,az";
    for (const char* name : {"gx", "gy", "gz", "ax", "ay", "az", "t"})
      header = replaced(header, name, std::string("imu0") + separator + name);
    std::ofstream(folder / "log.csv") << table(header, 1, 1, 1, true);
    const Result<MapProposal> proposal = good(propose(folder / "log.csv"));
    EXPECT_EQ(proposal->doubts, std::vector<std::string>()) << header;
    EXPECT_OK(import_csv(expect_value(parse_csv_map(proposal->text, "p")), folder / "log.csv"));
  }
  for (const auto& [name, reads] : {std::pair("temp [C]", 300.0), {"temp [K]", 26.85}, {"T_imu temp (F)", 148.8889}}) {
    std::ofstream(folder / "log.csv") << std::regex_replace(
        table(std::string("t,gx,gy,gz,ax,ay,az,") + name, 1, 1, 1, true), std::regex("(\\d)\n"), "$1,300\n");
    const Result<MapProposal> proposal = good(propose(folder / "log.csv"));
    const CsvImport import =
        expect_value(import_csv(expect_value(parse_csv_map(proposal->text, "p")), folder / "log.csv"));
    EXPECT_NEAR(import.samples[5].temperature_c, reads, 1e-3) << name;
  }
}

// ---- do the stamps jitter, or the intervals? ----

enum class Stamps { late, walking, drifting, rounded };

std::vector<double> stamps(Stamps kind, unsigned seed, int rows, double jitter_s) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, jitter_s);
  std::vector<double> times;
  double clock = 1000.0;
  for (int k = 0; k < rows; ++k) {
    double interval = 0.01;
    if (kind == Stamps::walking) interval += noise(random);
    if (kind == Stamps::drifting) interval *= 1.0 + 2e-5 * k / rows;  // 20 ppm: a clock that warms up
    clock += k % 997 == 500 ? 7.0 * 0.01 : interval;                  // a gap
    const double stamp = clock + (kind == Stamps::late || kind == Stamps::drifting ? noise(random) : 0.0);
    times.push_back(kind == Stamps::rounded ? std::round(stamp * 128.0) / 128.0 : stamp);
  }
  return times;
}

CsvMap numbered_map(const std::string& more = "") {
  return expect_value(parse_csv_map(
      "gravity_mps2 = 9.8\nunit_serial = s\ngyro.columns = 2, 3, 4\ngyro.unit = rad/s\naccel.columns = 5, 6, "
      "7\naccel.unit = m/s^2\ntime.column = 1\ncsv.header_lines = 0\n" +
          more,
      "m"));
}

IncrementsChoice choice_of(const std::vector<double>& times) { return choose_increments(times, fit_stamps(times)); }

TEST(Increments, ByTheStamps) {
  int wrong = 0, all = 0;
  for (const auto& [rows, seeds] : {std::pair(120, 20u), {1000, 8u}, {4000, 2u}})
    for (unsigned seed = 1; seed <= seeds; ++seed)
      for (const double jitter_s : {1e-6, 1e-4, 1e-3})
        for (const auto& [kind, expected] :
             {std::pair(Stamps::late, true), {Stamps::walking, false}, {Stamps::drifting, true}}) {
          ++all;
          wrong += choice_of(stamps(kind, seed, rows, jitter_s)).even != expected ? 1 : 0;
        }
  EXPECT_LE(wrong, all / 100) << "of " << all;  // records of 120 rows have 7 independent spans of 16
  EXPECT_TRUE(choice_of(stamps(Stamps::rounded, 1, 3000, 0.0)).even);
  EXPECT_FALSE(choice_of(stamps(Stamps::late, 1, 20, 1e-3)).even);
}

double turn(const CsvImport& content) {
  double sum = 0.0;
  for (const ImuSample& sample : content.samples) sum += sample.gyro[0];
  return sum;
}

// A sensor at rest that samples evenly, with late stamps; and one whose intervals are what they say, in a turn at a rate that varies.
TEST(Increments, WhatTheyAreWorth) {
  const auto import = [](Stamps kind, const std::string& line, double& angle) {
    const std::vector<double> times = stamps(kind, 7, 900, 1e-3);
    std::string csv;
    for (std::size_t k = 0; k < times.size(); ++k) {
      const auto turned = [](double t) { return 2.0 * t - std::cos(3.0 * t); };
      const double mean = k == 0 ? 0.0 : (turned(times[k]) - turned(times[k - 1])) / (times[k] - times[k - 1]);
      csv += fmt::format("{:.6f},{:.12f},0,0,0,0,9.8\n", times[k], mean);
      angle = turned(times[k]) - turned(times[0]);
    }
    return expect_value(import_text(numbered_map(line), csv));
  };
  double angle = 0.0;
  const CsvImport even = import(Stamps::late, "", angle),
                  as_stamped = import(Stamps::late, "time.increments = intervals\n", angle);
  const auto noise = [](const CsvImport& content) {
    double sum = 0.0;
    for (const ImuSample& sample : content.samples) sum += std::pow(sample.accel[2] - 0.098, 2);
    return std::sqrt(sum / double(content.samples.size()));
  };
  EXPECT_SAYS(even.chosen, "time.increments = period");
  EXPECT_LT(noise(even), 1e-4);        // what the mean period is off by
  EXPECT_LT(noise(as_stamped), 1e-4);  // a force that stays is the same in every sample
  EXPECT_EQ(even.gaps, 1);
  const CsvImport real = import(Stamps::walking, "", angle),
                  evened = import(Stamps::walking, "time.increments = period\n", angle);
  EXPECT_SAYS(real.chosen, "time.increments = intervals");
  EXPECT_LT(std::abs(turn(real) - angle), 6.0 * 0.01 * 5.0);  // what was turned in the gap, at most 5 rad/s, is nowhere
  EXPECT_GT(std::abs(turn(evened) - turn(real)), 1e-3);
}

// A recording has one period: what is read at 100 Hz, and then at 50 Hz, becomes samples of an even clock.
TEST(Increments, ARateThatChanges) {
  std::string csv;
  for (int k = 0; k < 1500; ++k) csv += fmt::format("{:.2f},0.5,0,0,0,0,9.8\n", k < 1000 ? 0.01 * k : 0.02 * k - 10.0);
  const CsvImport content = *good(import_text(numbered_map(""), csv));
  EXPECT_SAYS(content.chosen, "time.increments = intervals");
  EXPECT_LE(content.gaps, 1);  // where it changes
  const double period_s = content.info.sample_period_s;
  for (const ImuSample& sample : content.samples) ASSERT_NEAR(sample.accel[2], 9.8 * period_s, 1e-9);
  EXPECT_NEAR(double(content.samples.back().counter) * period_s, 19.98, period_s);
}

// What a logger does to the stamps of an even 200 Hz sensor; three gaps of 3 periods are true.
TEST(Increments, GapsAndPeriodWhateverTheStampsDo) {
  constexpr double period_s = 0.005;
  std::mt19937 random(5);
  std::normal_distribution<double> noise;
  std::exponential_distribution<double> late(1.0);
  using Stamp = std::function<double(int k)>;  // in periods, of the row that was measured at k
  const auto in_steps = [](double step, int shift) {
    return [=](int k) { return std::floor((k + shift) / step) * step; };
  };
  const struct {
    const char* what;
    Stamp stamp;
    double tolerance;  // of the period
  } cases[] = {
      {"even", [](int k) { return k; }, 1e-9},
      {"early and late by a third", [&](int k) { return k + 0.3 * noise(random); }, 1e-5},
      {"late by up to three", [&](int k) { return k + 0.5 * late(random); }, 2e-5},
      {"knocks of the host", [](int k) { return k % 211 == 7 ? k + 3.4 : k; }, 1e-9},
      {"two rows of one stamp", in_steps(2.0, 0), 1e-6},
      {"steps of 0.7", in_steps(0.7, 0), 1e-5},
      {"steps of a third, slowly past", in_steps(0.3335, 0), 2e-5},
      {"bursts of ten", in_steps(10.0, 10), 1e-5},
      {"a queue", [&, at = 0.0](int k) mutable { return at = std::max(at + 0.1, random() % 99 ? k : k + 4.5); }, 1e-5}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.what);
    std::string csv;
    for (int row = 0, k = 0; row < 4000; ++row, k += row % 1000 == 0 ? 4 : 1) {
      const double stamp = period_s * c.stamp(k);
      csv += fmt::format("{:.9f},{},0,0,0,0,9.8\n", stamp, 1e-3 * noise(random));
    }
    const CsvImport import = *good(import_text(numbered_map(), csv));
    EXPECT_SAYS(import.chosen, "time.increments = period");
    EXPECT_EQ(import.gaps, 3);
    EXPECT_EQ(import.samples.back().counter, 3999 + 9);
    EXPECT_NEAR(import.info.sample_period_s / period_s, 1.0, c.tolerance);
  }
}

// Rows that were lost while the stamps jitter, up to where nothing can be told: period and numbers of the rows are right, or said to be in doubt.
TEST(Increments, LossesAreCountedOrInDoubt) {
  std::mt19937 random(9);
  std::normal_distribution<double> noise;
  std::uniform_real_distribution<double> part;
  int in_doubt = 0;
  for (int run = 0; run < 30; ++run) {
    const bool of_five = run % 10 == 0;  // two gaps within six rows
    const double lost = of_five ? 0.0 : 0.6 * part(random) * part(random), jitter = 0.7 * part(random) * part(random);
    const int rows = int(500.0 * std::pow(12.0, part(random)));
    std::bernoulli_distribution is_lost(lost);
    std::vector<double> times;
    std::vector<std::int64_t> numbers;
    std::string csv;
    for (int row = 0, k = 0; row < rows; ++row) {
      k += of_five && (row % 100 == 20 || row % 100 == 26) ? 3 : 1;
      while (is_lost(random)) ++k;
      numbers.push_back(k);
      times.push_back(0.005 * (k + jitter * noise(random)));
      csv += fmt::format("{:.9f},0,0,0,0,0,9.8\n", times.back());
    }
    SCOPED_TRACE(fmt::format("{} of {} rows lost, {} of jitter", lost, rows, jitter));
    const StampModel model = fit_stamps(times);
    if (!model.sure) {
      EXPECT_TRUE(in_doubt++ > 0 ||
                  fails(import_text(numbered_map("time.increments = period\n"), csv), "another reading explains them"));
      continue;
    }
    EXPECT_NEAR(model.period / 0.005, 1.0, 5e-6 + 10.0 * jitter * std::pow(rows, -1.5));
    EXPECT_TRUE(choose_increments(times, model).even);
    std::int64_t wrong = 0, number = numbers.front();
    for (std::size_t row = 1, at = 0; row < times.size(); ++row) {
      number += at < model.gaps.size() && model.gaps[at].row == row ? model.gaps[at++].periods : 1;
      wrong += number != numbers[row] ? 1 : 0;
    }
    if (jitter > 0.2) continue;  // a row late by half a period changes places with the gap
    EXPECT_EQ(number, numbers.back());
    EXPECT_LE(wrong, rows / (jitter > 0.15 ? 100 : 500));
  }
  EXPECT_LE(in_doubt, 4);
}

// A logger that stops and starts again, with stamps in steps that are no part of the period: the periods of all rows last as long as they say.
TEST(Increments, PausesLastAsLongAsTheStampsSay) {
  int of_two = 0;
  for (const double rate_hz : {200.0, 800.0, 833.0, 238.0})
    for (const double step_s : {1e-7, 1e-3})
      for (const double pause_s : {0.0, 3.0037, 95.3017, 3600.002}) {
        if (++of_two % 2 != (rate_hz == 200.0 || rate_hz == 833.0)) continue;  // every pair of two is there
        SCOPED_TRACE(fmt::format("{} Hz, {} s, pause of {} s", rate_hz, step_s, pause_s));
        std::vector<double> times;
        for (int row = 0; row < 2000; ++row)
          times.push_back(std::floor((0.3 + row / rate_hz + (row < 850 ? 0.0 : pause_s)) / step_s) * step_s);
        const StampModel model = fit_stamps(times);
        EXPECT_TRUE(model.sure && choose_increments(times, model).even);
        EXPECT_NEAR(model.period * rate_hz, 1.0, 1e-4);
        double periods = 1999.0;
        for (const StampGap& gap : model.gaps) periods += double(gap.periods - 1);
        EXPECT_NEAR(periods, (times.back() - times.front()) / model.period, 1.5);
        EXPECT_EQ(model.gaps.size(), pause_s > 0.0 ? 1u : 0u);
      }
}

// A step near to the period is none, whatever is lost; another rate from a row on, and a loop that samples when it can, are intervals, and last as long.
TEST(Increments, NoAxisIsInvented) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> part;
  int in_doubt = 0;
  for (int run = 0; run < 16; ++run) {
    const double step = 0.8 + 0.19 * part(random), rate = run == 0 ? 1.04 : 0.5 * std::pow(6.0, part(random));
    std::vector<double> times, turns{0.0}, walks{0.0}, loop{0.0}, burst;
    std::string csv;
    for (int row = 0, k = 0; row < 600; ++row, ++k) {
      while (run % 2 == 0 && part(random) < 0.2) ++k;
      times.push_back(0.01 * step * std::floor((k + (run % 2 > 0 && row > 170 ? 731.3 : 0.3)) / step));
      csv += fmt::format("{:.9f},1,0,0,0,0,9.8\n", turns.back());
      turns.push_back(turns.back() + 0.01 * (row < 250 ? 1.0 : rate));
      walks.push_back(walks.back() + 0.01 * (0.6 + 0.8 * part(random)));
      loop.push_back(loop.back() + (part(random) < 0.3 ? 0.017 : 0.01));
      burst.push_back(0.1 * (row / 10) + 0.009 * (row % 10));
    }
    const StampModel model = fit_stamps(times);
    EXPECT_TRUE((!model.sure && ++in_doubt <= 5) || std::abs(model.period - 0.01) < 2e-5) << step;
    EXPECT_FALSE(choice_of(turns).even || choice_of(walks).even || choice_of(loop).even) << rate;
    EXPECT_EQ(real_intervals(loop, 1.5).gaps.size(), 0u);
    EXPECT_FALSE(fit_stamps(burst).sure);  // of ten rows, by a driver whose rate is off by a tenth
    EXPECT_NEAR(turn(expect_value(import_text(numbered_map(), csv))) / turns[599], 1.0, 0.005) << rate;
  }
}

// Written twice, or measured twice: a coarse sensor at rest repeats its numbers, and coarse stamps themselves.
TEST(Increments, DoubledRowsAreSaid) {
  const auto import = [](double stamp_s, double count, int doubled, const char* skip) {
    std::mt19937 random(6);
    std::normal_distribution<double> noise;
    std::string csv;
    for (int k = 0; k < 2000; ++k) {
      const std::string row = fmt::format("{:.6f},{},0,0,0,0,9.8\n", std::floor(k * 5e-4 / stamp_s + 1e-6) * stamp_s,
                                          std::round(noise(random) / count));
      csv += k >= 1000 && k < 1000 + doubled ? row + row : row;
    }
    CsvMap map = numbered_map();
    map.format.skip_bad_rows = skip != nullptr;
    return import_text(map, csv);
  };
  constexpr double fine = 1e-9, coarse = 1.5;  // counts
  for (const int doubled : {1, 10, 1000}) {
    EXPECT_TRUE(fails(import(5e-4, fine, doubled, nullptr),
                      fmt::format("d.csv:1002: repeats the row before, time and numbers, as {} of {} rows do", doubled,
                                  2000 + doubled)));
    const CsvImport once = *good(import(5e-4, fine, doubled, "skip"));
    EXPECT_EQ(once.samples.size(), 2000u);
    EXPECT_EQ(once.samples.back().counter, 1999);
    EXPECT_NEAR(once.info.sample_period_s, 5e-4, 1e-12);
  }
  for (const auto& [stamp_s, count] : {std::pair(1e-3, fine), {1e-3, coarse}, {5e-4, coarse}})
    EXPECT_OK(import(stamp_s, count, 0, nullptr));
}

}  // namespace
}  // namespace turncal
