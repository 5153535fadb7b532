// What a fleet's history is worth (docs/fleet.md): 100 rigs of one part, each calibrated twice in `forty_minutes`, whose biases change from one
// turn-on to the next; then units of that fleet in a sequence of 20 minutes, with and without the prior.
//
//   study_prior SEED COUNT SEQUENCE [UNITS]      COUNT units that have been calibrated twice before, and as many that are new
// A line each: rms of error / sigma of the data alone, rms over the parameters of the ratio of errors, by kind of parameter; then the sum.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>

#include "calib/fleet/fleet_prior.h"
#include "tests/rig_recorder.h"
#include "turntable_drivers/rig/rig_truth.h"

namespace turncal {
namespace {

constexpr double turn_on_gyro_degph = 0.002, turn_on_accel_g = 20e-6;

struct Made {
  ParameterVector truth;
  JointResult estimate;
};

Made made(const Sequence& sequence, std::uint64_t unit, std::uint64_t time) {
  RigConfig config = default_rig_config();
  config.seed = 77000 + 10 * unit + time;  // of the table
  config.unit_seed = 55000 + unit;
  config.noise_seed = 990000 + 10 * unit + time;
  const std::array<double, 24> whole = rig_model::draw_truth(config);
  std::mt19937_64 random(config.seed);
  std::normal_distribution<double> normal;
  for (std::size_t k = 0; k < 6; ++k)
    config.truth[k] = whole[k] + normal(random) * (k < 3 ? turn_on_gyro_degph : turn_on_accel_g);
  const RigRecording recorded = record_on_rig(sequence, config);
  Made result;
  const std::array<double, 24> truth = rig_model::draw_truth(config);
  for (int k = 0; k < parameter_count; ++k) result.truth[k] = truth[static_cast<std::size_t>(k)];
  result.estimate = joint_estimate(recorded.recording);
  return result;
}

EarlierCalibration earlier(const Sequence& sequence, std::uint64_t unit, std::uint64_t time) {
  const JointResult e = made(sequence, unit, time).estimate;
  EarlierCalibration c{"U" + std::to_string(10000 + unit), std::to_string(time), to_vector(e.parameters),
                       Eigen::MatrixXd::Zero(parameter_count, parameter_count)};
  c.covariance(e.free, e.free) = e.covariance;
  return c;
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  using namespace turncal;
  if (argc < 4) {
    std::fprintf(stderr, "usage: study_prior SEED COUNT SEQUENCE [UNITS]\n");
    return 1;
  }
  const auto first = static_cast<std::uint64_t>(std::strtoll(argv[1], nullptr, 10)),
             count = static_cast<std::uint64_t>(std::strtoll(argv[2], nullptr, 10));
  const std::uint64_t units = argc > 4 ? static_cast<std::uint64_t>(std::strtoll(argv[4], nullptr, 10)) : 100;
  const Sequence whole = must_read_sequence("forty_minutes.seq");
  const Result<Sequence> brief = read_sequence(argv[3]);
  if (!brief) {
    std::fprintf(stderr, "%s\n", brief.error().message.c_str());
    return 1;
  }
  std::vector<EarlierCalibration> history;
  for (std::uint64_t u = 0; u < units; ++u)
    for (std::uint64_t t = 0; t < 2; ++t) history.push_back(earlier(whole, first * 1000 + u, t));
  std::fprintf(stderr, "history of %zu\n", history.size());
  // Of each kind of parameter: sums of squares, data alone, new unit, unit with a history; and how often it was not used.
  const auto kind = [](int k) { return k < 3 ? "N" : k < 6 ? "A" : k < 15 ? "n" : "a"; };
  std::map<std::string, std::array<double, 3>> squares;
  double nees[3] = {0.0, 0.0, 0.0};
  int not_used[2] = {0, 0};
  for (std::uint64_t u = 0; u < count; ++u) {
    const Made now = made(*brief, first * 1000 + u, 2);
    for (int own = 0; own < 2; ++own) {
      std::vector<EarlierCalibration> known = history;
      const std::string unit = "U" + std::to_string(10000 + first * 1000 + u);
      if (own == 0) std::erase_if(known, [&](const EarlierCalibration& c) { return c.unit == unit; });
      const std::optional<FleetPrior> prior = fleet_prior(known, unit);
      JointResult e = now.estimate;
      not_used[own] += !use_prior(*prior, e).changed.empty();
      for (const int k : e.free) {
        const double error = to_vector(e.parameters)[k] - now.truth[k],
                     alone = to_vector(now.estimate.parameters)[k] - now.truth[k];
        const double unit_size = now.estimate.sigma[k];
        squares[kind(k)][static_cast<std::size_t>(1 + own)] += error * error / (unit_size * unit_size);
        nees[1 + own] += error * error / (e.sigma[k] * e.sigma[k]);
        if (own == 0) {
          squares[kind(k)][0] += alone * alone / (unit_size * unit_size);
          nees[0] += alone * alone / (unit_size * unit_size);
        }
      }
    }
  }
  for (const auto& [name, s] : squares)
    std::printf("%s: error falls by %.2f (new unit), %.2f (calibrated twice before)\n", name.c_str(),
                std::sqrt(s[0] / s[1]), std::sqrt(s[0] / s[2]));
  const double all = 21.0 * static_cast<double>(count);
  std::printf("error^2 / sigma^2: %.2f alone, %.2f new, %.2f with history; not used %d and %d of %llu\n", nees[0] / all,
              nees[1] / all, nees[2] / all, not_used[0], not_used[1], static_cast<unsigned long long>(count));
  return 0;
}
