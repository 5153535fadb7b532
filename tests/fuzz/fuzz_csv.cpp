// Bytes as a CSV file of an IMU, by a map with a time column, by one with a rate, or by the one that is proposed (byte 0 chooses).
#include <array>
#include <cmath>
#include <cstdlib>

#include "imu_io/recordings/csv_map_import.h"
#include "imu_io/recordings/map_proposal.h"
#include "input.h"
#include "tests/imu_io/text_columns.h"

namespace turncal {
namespace {

CsvMap map_of(std::string_view time) {
  const std::string text =
      "gyro.columns = gx, gy, gz\ngyro.unit = rad/s\naccel.columns = ax, ay, az\naccel.unit = g\n"
      "temperature.column = t_c\ngravity_mps2 = 9.8\nunit_serial = F\n" +
      std::string(time);
  auto map = parse_csv_map(text, "map");
  fuzz::require(map.ok());
  return *map;
}

}  // namespace
}  // namespace turncal

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  static const std::array<CsvMap, 2> maps = {map_of("time.column = t\ntime.unit = s\n"), map_of("rate_hz = 100\n")};
  fuzz::Input input(data, size);
  const std::uint8_t which = input.byte() % 3;
  CsvMap map = maps[which % 2];
  if (which == 2) {
    const ColumnSource source = columns_of_text(std::string(input.text()), "fuzz");
    const auto proposal = propose_map(source, {.gravity_mps2 = 9.8, .latitude_deg = 30.0, .unit_serial = "F"});
    if (!fuzz::taken(proposal)) return 0;
    auto proposed = parse_csv_map(proposal->text, "proposal");
    if (!fuzz::taken(proposed)) return 0;
    map = *proposed;
  }
  const auto result = import_columns(map, columns_of_text(std::string(input.text()), "fuzz"));
  if (!fuzz::taken(result)) return 0;
  for (std::size_t i = 0; i < result->samples.size(); ++i) {
    const ImuSample& sample = result->samples[i];
    fuzz::require(i == 0 || sample.counter > result->samples[i - 1].counter);
    for (std::size_t k = 0; k < 3; ++k) fuzz::require(std::isfinite(sample.gyro[k]) && std::isfinite(sample.accel[k]));
  }
  return 0;
}
