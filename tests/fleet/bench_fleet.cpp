// How long a fleet's diagnosis takes: units of four stations, an effect at one, ten units that stand out.
#include <benchmark/benchmark.h>

#include "tests/fleet/drawn_fleet.h"

namespace turncal {
namespace {

void diagnosis_of_a_fleet(benchmark::State& state) {
  const std::vector<FleetMember> members = drawn_fleet(5, std::size_t(state.range(0)), 4, [](const DrawnUnit& unit) {
    DrawnEffects has;
    if (unit.station == "S2") has.emplace_back("accel_second_order.x", sigma_of("accel_second_order.x"));
    if (unit.index % 1000 == 7) has.emplace_back("gyro_magnetic.zy", 20.0 * sigma_of("gyro_magnetic.zy"));
    return has;
  });
  std::size_t effects = 0, units = 0;
  for (auto _ : state) {
    const FleetDiagnosis d = diagnose_fleet(members, {});
    effects = d.effects.size();
    units = d.units.size();
  }
  state.counters["effects"] = double(effects);
  state.counters["units"] = double(units);
}
BENCHMARK(diagnosis_of_a_fleet)->Arg(200)->Arg(1000)->Arg(10000)->Unit(benchmark::kSecond)->Iterations(1);

}  // namespace
}  // namespace turncal
