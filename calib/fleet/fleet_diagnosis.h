// Diagnosis of a fleet: effects common to all units, to a station, to a lot, and units that stand out. No single unit shows these.
//
// Every recording leaves its scores of all effects (unit_statistics.h). For one component, y = s / Q with variance 1 / Q; units scatter besides
// (fleet_scores.h). N recordings show a common effect of 1 / sqrt(N) of the smallest that one recording shows.
//
// 1. Forward selection over component x (all, each level of each factor): z = beta / sigma of a generalised least squares fit, with sigma_b^2 by
//    restricted likelihood beside all levels of that factor, and the units' changes between recordings. p by Student's t with the units' degrees of
//    freedom, times the number of tests (Bonferroni). The best is removed from the scores (s - Q beta), so no alias follows; then all is retested.
// 2. The same for what began or grew at one level of a factor: a step or a ramp from a day t0 on, with half of the false alarms; a change in time
//    must be better than a constant by shape_margin (limits.h). t0 has an interval by likelihood.
// 3. Units that deviate from what is common by more than a family-wise limit, in units of their own sigma and the robust scatter of all. The
//    component that explains most is assigned to the unit and removed from its scores; then 1 and 2 again, until nothing changes. The search begins
//    with 1 and 2, or with 1 alone; the better one by chi-square and number of parts is kept (Rissanen, Automatica 14 (1978) 465).
// 4. Parameters are tested like effects, but against the other levels, since a fleet does not know their zero.
// 5. Lack of fit: the remainder at each level along directions with independent noise, as chi-square.
//
// An effect common to a station need not come from its units: `cause_at_station` names a cause in table, site or fixture that looks the same.
// Not modelled: interactions of factors; units that change; common effects that multiply another.
#pragma once

#include <string>
#include <vector>

#include "calib/fleet/unit_statistics.h"

namespace turncal {

struct FleetMember {  // one recording
  std::string unit;
  std::vector<std::string> level;  // one per factor; empty: unknown, a level of its own
  double day = 0.0;                // of the recording, from any beginning; NaN: not known
  UnitStatistics statistics;
};

struct FleetOptions {
  std::vector<std::string> factors = {"station"};
  bool summary = true;  // FleetDiagnosis::components
};

struct FleetEstimate {  // z: from zero (parameter: from the other levels)
  double value = 0.0, sigma = 0.0, z = 0.0;
};

enum class FleetShape { constant, step, ramp };
const char* to_string(FleetShape shape);

struct FleetEffect : FleetEstimate {  // in the component's unit; of a ramp, per day
  std::string component;              // column_key(), or "parameter a11"
  std::string factor, level;          // empty: common to all
  FleetShape shape = FleetShape::constant;
  double log10_p = 0.0;                                       // times the number of tests
  double begin_day = 0.0, begin_low = 0.0, begin_high = 0.0;  // of a step or ramp: 95 %
  std::vector<std::string> rivals;                            // other effects that explain about as much there
  std::size_t recordings = 0;
};

struct OutstandingUnit : FleetEstimate {
  std::size_t member = 0;
  std::string component;
};

struct ComponentSummary {  // for tables and drawings
  std::string component;
  double one_unit = 0.0;                           // median sigma of one recording
  double unit_scatter = 0.0;                       // root of sigma_b^2
  std::vector<double> factor_scatter;              // root of sigma_f^2, of each factor
  std::vector<std::vector<FleetEstimate>> levels;  // of each factor, in the order of FleetDiagnosis::levels
};

struct FleetDiagnosis {
  std::vector<std::vector<std::string>> levels;  // of each factor
  std::vector<FleetEffect> effects;              // in the order found
  std::vector<OutstandingUnit> units;
  std::vector<ComponentSummary> components;
  std::size_t tests = 0;
  double lack_of_fit_log10_p = 0.0;  // of what is left: the worst level, times their number
  std::string lack_of_fit_at;        // worst factor and level
  bool explained() const { return lack_of_fit_log10_p > -2.0; }
};

FleetDiagnosis diagnose_fleet(const std::vector<FleetMember>& members, const FleetOptions& options);

// Returns what in a table, a site or a fixture gives every unit there this effect; empty: nothing known.
std::string cause_at_station(const std::string& component);

}  // namespace turncal
