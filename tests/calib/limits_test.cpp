// Every limit that docs/diagnosis.md names in its table is the one in force, and none of those below is missing there.
#include "calib/evidence/diagnosis.h"
#include "tests/test.h"

namespace turncal {
namespace {

TEST(LimitsOfTheDocument, AreThoseOfTheProgram) {
  const DiagnosisOptions options;
  constexpr LackOfFitLimits fit;
  constexpr SelectionLimits selection;
  constexpr GateLimits gate;
  const NoiseLimits& noise = noise_limits;
  const std::map<std::string, double> in_force = {
      {"options.false_alarm", options.false_alarm},   {"fit.family_wise", fit.family_wise},
      {"fit.near_lags_s", fit.near_lags_s},           {"fit.lags_s", fit.lags_s},
      {"selection.bic_margin", selection.bic_margin}, {"selection.alias_correlation", selection.alias_correlation},
      {"gate.contradiction", gate.contradiction},     {"gate.highest_error", gate.highest_error},
      {"noise.correlation", noise.correlation},       {"noise.lowest_level", noise.lowest_level},
      {"noise.highest_level", noise.highest_level},   {"noise.highest_of_pulses", noise.highest_of_pulses}};
  std::ifstream document(std::string(TURNCAL_SOURCE_DIR) + "/docs/diagnosis.md");
  std::map<std::string, double> printed;
  for (std::string line; std::getline(document, line);)
    if (const auto end = line.find("` | "); line.starts_with("| `") && end != std::string::npos)
      printed[line.substr(3, end - 3)] = std::stod(line.substr(end + 4));
  EXPECT_EQ(printed, in_force);
}

}  // namespace
}  // namespace turncal
