#include "imu_io/recordings/csv_map_import.h"

#include "calib/model/parameters.h"
#include "calib/statistics/clipping.h"
#include "tests/imu_io/text_columns.h"
#include "tests/said.h"

namespace turncal {
namespace {

const std::string base_map =
    "gravity_mps2 = 9.81\nunit_serial = s1\n"
    "gyro.columns = gx, gy, gz\ngyro.unit = deg/s\ngyro.scale = 0.5\ngyro.offset = 100\n"
    "accel.columns = ax, ay, az\naccel.unit = g\n";

std::string rows(int count, double step = 0.01) {
  std::string text = "t,gx,gy,gz,ax,ay,az,temp\n";
  for (int k = 0; k < count; ++k) text += std::to_string(5.0 + k * step) + ",102,100,96,0.5,0,1,300\n";
  return text;
}
CsvImport must(const std::string& map_text, const std::string& csv) {
  return expect_value(import_text(expect_value(parse_csv_map(map_text, "m.map")), csv));
}
TEST(CsvMapImport, UnitsOffsetsScalesAxes) {
  const CsvImport c = must(base_map +
                               "gyro.axes = +x, -z, +y\nrate_hz = 100\ntemperature.column = temp\n"
                               "temperature.offset = 280\ntemperature.scale = 0.1\n",
                           rows(12));
  ASSERT_EQ(c.samples.size(), 12u);
  const ImuSample& s = c.samples[3];
  EXPECT_EQ(s.counter, 3);
  // (102 - 100) * 0.5 deg/s over 10 ms; y is minus the third column, z the second.
  EXPECT_NEAR(s.gyro[0], 1.0 * rad_per_deg * 0.01, 1e-15);
  EXPECT_NEAR(s.gyro[1], 2.0 * rad_per_deg * 0.01, 1e-15);
  EXPECT_NEAR(s.gyro[2], 0.0, 1e-15);
  EXPECT_NEAR(s.accel[2], 9.80665 * 0.01, 1e-15);
  EXPECT_FLOAT_EQ(s.temperature_c, 2.0F);
  EXPECT_EQ(c.info.gyro_increment, IncrementKind::physical);
  EXPECT_TRUE(c.info.has_temperature);
}

// The stamps, which alone are in memory, then the samples; where stamps repeat the rows are looked at for those that were written twice.
TEST(CsvMapImport, RowsAreReadForTheStampsAndForTheSamples) {
  const std::string even = rows(20000);
  const auto at = [](int k) { return "\n" + std::to_string(5.0 + k * 0.01) + ","; };
  const struct {
    std::string csv;
    std::vector<std::size_t> columns;  // of each time that the rows are read
    std::int64_t counter;              // of the last sample
  } cases[] = {{even, {1, 7}, 19999},
               {replaced(even, at(15000), "\n#"), {1, 7}, 19999},                   // a row is missing
               {replaced(even, at(100) + "102", at(99) + "9"), {1, 7, 7}, 19999}};  // a late one's stamp repeats
  for (const auto& [csv, columns, counter] : cases) {
    const CsvMap map = expect_value(parse_csv_map(base_map + "time.column = t\ntime.increments = period\n", "m.map"));
    ColumnSource source = columns_of_text(csv, "d.csv");
    std::vector<std::size_t> read;
    source.read = [&, all = source.read](const std::vector<WantedColumn>& wanted, const auto&... more) {
      read.push_back(wanted.size());
      return all(wanted, more...);
    };
    int begun = 0;
    std::vector<ImuSample> samples;
    const CsvImport streamed = expect_value(stream_columns(
        map, source, nullptr, [&](const CsvImport&) { ++begun; },
        [&](std::span<const ImuSample> some) {
          samples.insert(samples.end(), some.begin(), some.end());
          return Status();
        }));
    EXPECT_EQ(read, columns);
    EXPECT_EQ(begun, 1);
    ASSERT_FALSE(samples.empty());
    EXPECT_EQ(samples.back().counter, counter);
    EXPECT_EQ(samples.size(), std::size_t(streamed.rows));
  }
}

TEST(CsvMapImport, MeasuredIntervalsOrTheMeanOne) {
  std::string csv = "t,gx,gy,gz,ax,ay,az\n";
  double t = 0.0;
  for (int k = 0; k < 20; ++k) {
    csv += std::to_string(t) + (k == 2 ? ",104" : ",102") + ",100,100,0,0,1\n";  // 2 deg/s, else 1
    t += k % 2 == 0 ? 9.0 : 11.0;  // ms; sums to the mean of 10 over an even number of intervals
    if (k == 9) t += 500.0;        // a gap, after which the samples are where they were before
  }
  const std::string timed = base_map + "time.column = t\ntime.unit = ms\n";
  const CsvImport measured = must(timed + "time.increments = intervals\n", csv);
  const double period_s = (9.0 * 10 + 11.0 * 8) / 18.0 * 1e-3;
  EXPECT_NEAR(measured.info.sample_period_s, period_s, 1e-12);
  // The row of 2 deg/s lasts from 9 to 20 ms.
  EXPECT_NEAR(measured.samples[1].gyro[0], rad_per_deg * (0.009 + 2.0 * (period_s - 0.009)), 1e-15);
  EXPECT_NEAR(measured.samples[2].gyro[0], rad_per_deg * 2.0 * period_s, 1e-15);
  EXPECT_NEAR(measured.samples[3].gyro[0], rad_per_deg * (0.02 - period_s), 1e-15);
  for (std::size_t k = 4; k < measured.samples.size(); ++k)
    EXPECT_NEAR(measured.samples[k].gyro[0], rad_per_deg * period_s, 1e-15);
  EXPECT_NEAR(measured.jitter_s, 1e-3, 1e-5);
  const CsvImport mean = must(timed + "time.increments = period\n", csv);
  EXPECT_NEAR(mean.samples[1].gyro[0], rad_per_deg * mean.info.sample_period_s, 1e-15);
  EXPECT_NEAR(mean.samples[2].gyro[0], rad_per_deg * 2.0 * mean.info.sample_period_s, 1e-15);
}

TEST(CsvMapImport, GapsAndSaturatedRowsShowInTheCounter) {
  std::string csv = "t,gx,gy,gz,ax,ay,az\n";
  for (int k = 0; k < 30; ++k) {
    if (k == 10 || k == 11) continue;  // two rows lost
    csv += std::to_string(0.01 * k) + (k == 20 ? ",32767,100,100,0,0,1\n" : ",102,100,100,0,0,1\n");
  }
  const CsvImport c = must(base_map + "time.column = t\ngyro.range = -32767, 32767\n", csv);
  EXPECT_EQ(c.gaps, 1);
  EXPECT_EQ(c.saturated, 1);
  ASSERT_EQ(c.samples.size(), 28u);
  EXPECT_EQ(c.samples[9].counter, 9);
  EXPECT_EQ(c.samples[10].counter, 12);
  EXPECT_EQ(c.samples.back().counter, 29);
  EXPECT_EQ(c.samples[18].counter, 20);  // the saturated one stays, and says so
  EXPECT_EQ(c.samples[18].flags, gyro_clipped_flag(0) | sample_flag_invalid);
  EXPECT_EQ(c.samples[19].flags, 0u);
}

TEST(CsvMapImport, IncrementsAreTakenAsTheyAre) {
  const std::string map = replaced(base_map, "deg/s", "arcsec") + "rate_hz = 50\n";
  EXPECT_NEAR(must(map, rows(12)).samples[0].gyro[0], rad_per_arcsec, 1e-18);
}

TEST(CsvMapImport, ColumnsByNumberAndOtherDelimiters) {
  const std::string map =
      "gravity_mps2 = 9.81\nunit_serial = s1\nrate_hz = 100\ncsv.delimiter = space\ncsv.header_lines = 0\n"
      "gyro.columns = 4, 5, 6\ngyro.unit = rad/s\naccel.columns = 1, 2, 3\naccel.unit = m/s^2\n";
  std::string csv;
  for (int k = 0; k < 10; ++k) csv += "  1 2   3  4 5 6\n";
  EXPECT_NEAR(must(map, csv).samples[5].gyro[2], 0.06, 1e-15);
}

// What is changed in a map, and in the rows that it reads.
TEST(CsvMapImport, DefectsNameFileLineAndColumn) {
  expect_said("imu_io/csv_maps.said", [](const std::string& name, const std::string& what, const std::string& with) {
    const bool of_map = name == "map";
    const std::string timed = base_map + "time.column = t\n", rated = base_map + "rate_hz = 100\n";
    const auto map = parse_csv_map(of_map                 ? replaced(rated, what, with)
                                   : name == "timed rows" ? timed
                                                          : rated,
                                   "m.map");
    if (!map) return said_of(map);
    return said_of(import_text(*map, of_map ? rows(12) : replaced(rows(name == "few rows" ? 3 : 12), what, with)));
  });
}

// ---- what people's files are like: bad rows, remarks, blanks, late stamps, two files, gyros at the end of their range ----

const std::string unscaled_map = replaced(base_map, "gyro.scale = 0.5\n", "");

CsvMap map_of(const std::string& more) { return expect_value(parse_csv_map(unscaled_map + more, "m.map")); }

TEST(ImportForms, BadRowsAreSkippedAndCounted) {
  std::string csv = "gx,gy,gz,ax,ay,az\n";
  for (int k = 0; k < 14; ++k) csv += k == 12 ? "oops,100,96,0.5,0,1\n" : "102,100,96,0.5,0,1\n";
  CsvMap map = map_of("rate_hz = 100\n");
  EXPECT_FALSE(import_text(map, csv).ok());
  map.format.skip_bad_rows = true;
  const Result<CsvImport> c = good(import_text(map, csv));
  EXPECT_EQ(c->bad_rows, 1);
  EXPECT_SAYS(c->first_bad, "d.csv:14: column 'gx' = 'oops'");
  ASSERT_EQ(c->samples.size(), 13u);
  EXPECT_EQ(c->samples.back().counter, 13);  // its number is left out
  map.format.skip_bad_rows = false;
  const Result<CsvImport> cut = good(import_text(map, replaced(csv, "oops", "102").substr(0, csv.size() - 2)));
  EXPECT_EQ(cut->bad_rows, 1);
  EXPECT_EQ(cut->samples.size(), 13u);
  EXPECT_SAYS(cut->first_bad, "d.csv:15: the last line has no end");
}

// The sampling went on while the clock was behind.
TEST(ImportForms, ARowsNumberIsLeftOutWhereTheClockWasSetBack) {
  for (const char* how : {"intervals", "period"}) {
    SCOPED_TRACE(how);
    std::string csv = "t,gx,gy,gz,ax,ay,az\n";
    const auto row = [](int k, int time) {
      return std::to_string(0.01 * time) + "," + std::to_string(k) + ",100,96,0.5,0,1\n";
    };
    for (int k = 0; k < 300; ++k) csv += row(k, k < 100 ? k : k - 50);
    CsvMap map = map_of("time.column = t\ntime.increments = " + std::string(how) + "\n");
    map.format.skip_bad_rows = true;
    const Result<CsvImport> c = good(import_text(map, csv));
    EXPECT_NEAR(double(c->bad_rows), 50.0, 6.0);
    EXPECT_EQ(c->samples.back().counter, 299);
    // Two rows exchanged, ten written twice, one split by a line feed: the stamps say how much time passed.
    csv = "t,gx,gy,gz,ax,ay,az\n";
    for (int k = 0; k < 300; ++k) csv += row(k == 50 ? 51 : k == 51 ? 50 : k, k == 50 ? 51 : k == 51 ? 50 : k);
    for (int k = 290; k < 300; ++k) csv += row(k, k);
    for (int k = 300; k < 310; ++k) csv += k == 305 ? "3.0\n5,0,1\n" : row(k, k);
    const Result<CsvImport> out_of_place = good(import_text(map, csv));
    EXPECT_EQ(out_of_place->bad_rows, 13);
    EXPECT_EQ(out_of_place->samples.back().counter, 309);
  }
}

// Times ahead of those that follow cost their own rows; a counter that begins anew is no defect of rows.
TEST(ImportForms, ARowIsBadByBothNeighbours) {
  for (const char* how : {"time.increments = intervals\n", "time.increments = period\n", ""})
    for (const int bad : {1, 3}) {
      SCOPED_TRACE(how);
      const auto table = [bad](double ahead, double anew) {
        std::string csv = "t,gx,gy,gz,ax,ay,az\n";
        for (int k = 0; k < 300; ++k)
          csv += std::to_string(0.01 * k + (k >= 100 && k < 100 + bad ? ahead : 0.0) - (k >= 200 ? anew : 0.0)) + "," +
                 std::to_string(k) + ",100,96,0.5,0,1\n";
        return csv;
      };
      CsvMap map = map_of("time.column = t\n" + std::string(how));
      for (const double ahead : {0.5, 1e6}) {
        map.format.skip_bad_rows = false;
        EXPECT_SAYS(said_of(import_text(map, table(ahead, 0.0))), "d.csv:102: column 't' = ");
        map.format.skip_bad_rows = true;
        const Result<CsvImport> c = good(import_text(map, table(ahead, 0.0)));
        EXPECT_EQ(c->bad_rows, bad);
        ASSERT_EQ(c->samples.size(), std::size_t(300 - bad));
        EXPECT_EQ(c->samples[100].counter, 100 + bad);
        EXPECT_EQ(c->samples.back().counter, 299);
      }
      EXPECT_SAYS(said_of(import_text(map, table(0.0, 2.0))),
                  "d.csv:202: column 't' = '0': expected a time that goes on");
    }
}

TEST(ImportForms, QuotesAndDecimalCommas) {
  std::string csv = "\"gx\";\"gy\";\"gz\";ax;ay;az\n";
  for (int k = 0; k < 12; ++k) csv += "\"1,5\";-2,25;0;3e-1;1.5;+4,5E1\n";
  const Result<CsvImport> c =
      good(import_text(map_of("rate_hz = 100\ncsv.delimiter = semicolon\ncsv.decimal = comma\n"), csv));
  EXPECT_NEAR(c->samples[3].gyro[0], (1.5 - 100.0) * rad_per_deg * 0.01, 1e-12);
  EXPECT_NEAR(c->samples[3].gyro[1], (-2.25 - 100.0) * rad_per_deg * 0.01, 1e-12);
  EXPECT_NEAR(c->samples[3].accel[2], 45.0 * 9.80665 * 0.01, 1e-12);
}

TEST(ImportForms, CommentedHeaderAndBlankTemperature) {
  std::string csv = "# gx, gy, gz, ax, ay, az, temp\n";
  for (int k = 0; k < 20; ++k)
    csv += std::string("102,100,96,0.5,0,1,") + (k % 5 == 0 ? "30" : "") + (k == 7 ? "\n# a remark\n" : "\n");
  const Result<CsvImport> c = good(import_text(map_of("rate_hz = 100\ntemperature.column = temp\n"), csv));
  ASSERT_EQ(c->samples.size(), 20u);
  EXPECT_EQ(c->samples[5].temperature_c, 30.0F);
  EXPECT_TRUE(std::isnan(c->samples[6].temperature_c));
}

TEST(ImportForms, AccelerometersInAFileOfTheirOwn) {
  const CsvMap map = map_of("time.column = t\n");
  std::string gyro = "t,gx,gy,gz\n";
  std::string same = "t,ax,ay,az\n";
  std::string other = "t,ax,ay,az\n";
  for (int k = 0; k < 50; ++k) {
    gyro += std::to_string(0.01 * k) + ",102,100,96\n";
    same += std::to_string(0.01 * k) + ",0.5,0,1\n";
  }
  for (int k = 0; k < 30; ++k) other += std::to_string(0.004 + 0.02 * k) + "," + std::to_string(0.02 * k) + ",0,1\n";
  const ColumnSource gyros = columns_of_text(gyro, "g.csv"), others = columns_of_text(other, "a.csv"),
                     sames = columns_of_text(same, "a.csv");
  const ColumnSource later = columns_of_text("t,ax,ay,az\n9000,0,0,1\n9001,0,0,1\n", "a.csv");
  EXPECT_TRUE(
      fails(import_columns(map, gyros, &later),
            "a.csv: 0 of 2 rows fall into the time of g.csv: expected at least 10, with times in the same unit"));
  const Result<CsvImport> joined = good(import_columns(map, gyros, &sames));
  ASSERT_EQ(joined->samples.size(), 50u);
  EXPECT_NEAR(joined->samples[9].accel[0], 0.5 * standard_gravity_mps2 * 0.01, 1e-9);
  // A ramp sampled at another rate: the velocity over the common time is kept. A number holds for the interval that it ends.
  const Result<CsvImport> resampled = good(import_columns(map, gyros, &others));
  EXPECT_EQ(resampled->samples.size(), 49u);  // the first row is before the accelerometers begin
  double velocity = 0.0;
  for (std::size_t k = 1; k < resampled->samples.size(); ++k) velocity += resampled->samples[k].accel[0];
  double expected = 0.0;
  for (int k = 1; k < 30; ++k) {
    const double from = std::max(0.01, 0.004 + 0.02 * (k - 1));
    const double to = std::min(0.49, 0.004 + 0.02 * k);
    if (to > from) expected += 0.02 * k * (to - from);
  }
  EXPECT_NEAR(velocity, expected * standard_gravity_mps2, 1e-6);
}

// Where the second file lacks rows nothing is made up, and the gyros' rows there are left out and counted.
TEST(ImportForms, GapsInTheAccelerometersOfTheirOwn) {
  std::string gyro = "t,gx,gy,gz\n", gap = "t,ax,ay,az\n", ms = gap;
  for (int k = 0; k < 3000; ++k) {
    const double t = 0.01 * k;
    gyro += fmt::format("{:.4f},102,100,96\n", t);
    if (k <= 1000 || k > 1500) gap += fmt::format("{:.4f},{},0,1\n", t, k < 1200 ? 0.5 : 2.5);
    ms += fmt::format("{},0.5,0,1\n", 10 * k);
  }
  const ColumnSource gyros = columns_of_text(gyro, "g.csv"), gaps = columns_of_text(gap, "a.csv"),
                     others = columns_of_text(ms, "ms.csv");
  const Result<CsvImport> joined = good(import_columns(map_of("time.column = t\n"), gyros, &gaps));
  EXPECT_NEAR(double(joined->without_accel), 500.0, 2.0);
  EXPECT_EQ(joined->rows, 3000);
  EXPECT_EQ(std::ssize(joined->samples) + joined->without_accel, 3000);
  EXPECT_EQ(joined->gaps, 1);
  for (const ImuSample& sample : joined->samples)
    EXPECT_NEAR(sample.accel[0], (sample.counter < 1200 ? 0.5 : 2.5) * standard_gravity_mps2 * 0.01, 1e-6);
  EXPECT_TRUE(
      fails(import_columns(map_of("time.column = t\n"), gyros, &others),
            "ms.csv: 3 of 3000 rows fall into the time of g.csv: expected at least 10, with times in the same unit"));
}

// A gyro that stands at its extreme value is found on the numbers, whatever the intervals are.
TEST(ImportForms, ClippingIsFoundBesideMeasuredIntervals) {
  std::string csv = "t,gx,gy,gz,ax,ay,az\n";
  double t = 0.0;
  for (int k = 0; k < 400; ++k) {
    const double rate = std::min(2000.0, std::round(3000.0 * std::sin(0.02 * k)));
    csv += std::to_string(t) + "," + std::to_string(100.0 + rate) + ",100,100,0,0,1\n";
    t += k % 2 == 0 ? 0.0099 : 0.0101;
  }
  const Result<CsvImport> c = good(import_text(map_of("time.column = t\n"), csv));
  EXPECT_GT(c->clipped, 50);
}

}  // namespace
}  // namespace turncal
