// A results database of many units, to measure what `fleet diagnose` costs (docs/fleet.md): scores are drawn as in tests/fleet/drawn_fleet.h.
//
//   study_fleet_database UNITS DATABASE      a file, or the name of a server's; S2 of four stations has an effect of one sigma
// Then: time turncal fleet diagnose DATABASE
#include <cstdio>
#include <cstdlib>

#include "imu_io/base/clock.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/statistics_file.h"
#include "orchestrator/records/results_database.h"
#include "tests/fleet/drawn_fleet.h"

namespace turncal {
namespace {

constexpr double first_utc_s = 1767225600.0;  // 2026-01-01
constexpr std::size_t at_a_time = 100;

Status add(ResultsDatabase& database, const FleetMember& member, std::size_t number) {
  StatisticsFile s;
  s.file.unit_serial = "U" + std::to_string(100000 + number);
  s.file.time_utc = format_utc(first_utc_s + 86400.0 * member.day);
  s.file.recording_hash = hash_of_text(s.file.unit_serial);
  s.file.software_version = "drawn";
  s.file.method = "joint";
  s.file.model = "base";
  s.file.gravity_mps2 = 9.8;
  s.file.sample_period_s = 0.005;
  s.file.accel_pulse_mps = 0.0005;
  s.file.simulated = true;
  s.file.parameters = member.statistics.value;
  for (int k = 0; k < parameter_count; ++k)
    if (member.statistics.sigma[k] > 0.0) s.file.sigma[std::size_t(k)] = member.statistics.sigma[k];
  s.file.add_further("record.station", member.level.front());
  s.file.add_further("record.lot", std::to_string(number / 500));
  s.file.add_further("record.part", std::string("P7"));
  s.statistics = member.statistics;
  const Result<std::vector<std::byte>> bytes = format_statistics(s);
  if (!bytes) return bytes.error();
  AttemptRecord attempt;
  attempt.run = attempt.unit = s.file.unit_serial;
  attempt.began_utc = attempt.time_utc = s.file.time_utc;
  attempt.simulated = true;
  attempt.outcome = "pass";
  attempt.station = member.level.front();
  return database.add(s.file, attempt, *bytes);
}

DrawnEffects has(const DrawnUnit& unit) {
  if (unit.station != "S2") return {};
  return {{"accel_second_order.x", sigma_of("accel_second_order.x")}};
}

Status fill(ResultsDatabase& database, std::size_t units) {
  std::size_t number = 0;
  while (number < units)
    for (const FleetMember& member : drawn_fleet(100 + number, std::min(at_a_time, units - number), 4, has))
      if (Status status = add(database, member, number++); !status) return status;
  return {};
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc != 3) {
    std::fprintf(stderr, "usage: study_fleet_database UNITS DATABASE\n");
    return 1;
  }
  Result<ResultsDatabase> database = ResultsDatabase::open(argv[2]);
  const Status status = database ? fill(*database, std::strtoull(argv[1], nullptr, 10)) : Status(database.error());
  if (!status) std::fprintf(stderr, "%s\n", status.error().message.c_str());
  return status ? 0 : 1;
}
