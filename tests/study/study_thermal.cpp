// What parameters as functions of temperature are worth (docs/thermal.md): units drawn as tests/calib/thermal/drawn_legs.h has them.
//
//   study_thermal SEED_FIRST SEED_COUNT [WORDS OF A CASE]
// A row a case: normalised errors squared of values and of coefficients that are said, terms there, said and wrong, error of held-out legs
// over their noise, estimated to true switch-on sigma, campaigns whose lag is said, its error over its sigma, seconds a campaign.
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "calib/evidence/statement.h"
#include "tests/calib/thermal/drawn_legs.h"

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc < 3) return std::fprintf(stderr, "usage: study_thermal SEED_FIRST SEED_COUNT [WORDS OF A CASE]\n"), 1;
  const auto first = std::uint64_t(std::strtoll(argv[1], nullptr, 10)),
             count = std::uint64_t(std::strtoll(argv[2], nullptr, 10));
  struct Case {
    const char* name;
    DrawnThermal drawn;
  };
  const Case cases[] = {
      {"constant, 9 up and 8 down", {}},
      {"constant, switch-on 10 sigma", {.switch_on = 10.0}},
      {"orders 0 to 3, 9 up and 8 down", {.size = 20.0}},
      {"the same, 9 up", {.size = 20.0, .down = false}},
      {"the same, 5 up and 4 down", {.size = 20.0, .temperatures = 5}},
      {"5 up and 4 down, a wave in one of 30",
       {.size = 20.0, .wave = 4.0, .wave_share = 1.0 / 30.0, .temperatures = 5}},
      {"orders, switch-on 10 sigma", {.size = 20.0, .switch_on = 10.0}},
      {"orders, rate and hysteresis, switch-on", {.size = 20.0, .effects = 0.2, .switch_on = 3.0}},
      {"orders, rate and loops that close", {.size = 20.0, .effects = 0.2, .loop = true}},
      {"orders, thermometer lags 0.2 h", {.size = 20.0, .lag_h = 0.2}},
      {"orders, ramps of 15 C/h, lag 0.02 h", {.size = 20.0, .lag_h = 0.02, .ramp = 15.0, .temperatures = 5}},
      {"orders, ramps of 15 C/h, lag 0.1 h", {.size = 20.0, .lag_h = 0.1, .ramp = 15.0, .temperatures = 5}},
      {"orders, ramps of 15 C/h, lag 0.2 h", {.size = 20.0, .lag_h = 0.2, .ramp = 15.0, .temperatures = 5}},
      {"orders, rate and hysteresis, lag", {.size = 20.0, .effects = 0.2, .lag_h = 0.1, .ramp = 15.0}},
      {"a wave that is no polynomial", {.size = 20.0, .wave = 4.0}},
  };
  std::printf("%-40s %6s %6s  %17s %17s %17s %8s %9s %9s %6s\n", "case", "values", "coeff", "orders", "rate",
              "hysteresis", "held out", "switch-on", "lag", "s");
  for (const Case& c : cases) {
    if (argc > 3 && std::string_view(c.name).find(argv[3]) == std::string_view::npos) continue;
    ThermalScore score;
    double seconds = 0.0;
    for (std::uint64_t seed = first; seed < first + count; ++seed) {
      const DrawnCampaign made = drawn_campaign(seed, c.drawn);
      const auto began = std::chrono::steady_clock::now();
      const Result<ThermalModel> model = fit_thermal_model(made.legs, {.reference_c = 10.0, .hold_out = false});
      seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      if (!model) return std::fprintf(stderr, "%s\n", model.error().message.c_str()), 1;
      score.add(made, *model, c.drawn);
    }
    const double n = score.campaigns;
    std::printf("%-40s %6.2f %6.2f", c.name, score.nees / n,
                score.said_coefficients > 0.0 ? score.coefficients / score.said_coefficients : 0.0);
    for (int k = 0; k < 3; ++k) std::printf("  %5d %5d %5d", score.there[k], score.said[k], score.wrong[k]);
    std::printf(" %8.3f %9.2f %4.0f %4.2f %6.2f\n", std::sqrt(score.held_out / score.noise),
                std::sqrt(score.switch_on / n), score.lag_said, std::sqrt(score.lag / n), seconds / n);
    std::fflush(stdout);
  }
  return 0;
}
