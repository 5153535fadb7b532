// What a fleet's history is worth (docs/fleet.md): 100 rigs of one part, each calibrated twice in `forty_minutes`, whose biases change from one
// turn-on to the next and whose noise is not the same; then units of that fleet in a sequence of 20 minutes, with and without the prior.
// And again those units with one parameter changed, drawn at random, by 6 to 20 of its sigmas from what the history says.
//
//   study_prior SEED COUNT SEQUENCE [UNITS]      COUNT units that have been calibrated twice before, and as many that are new
// By how much the rms error falls by kind of parameter, error^2 / sigma^2, sigma with the noise of the part to sigma without; changes named.
#include <algorithm>
#include <array>
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

constexpr double turn_on_gyro_degph = 0.002, turn_on_accel_g = 20e-6, noise_scatter = 0.1;

struct Made {
  ParameterVector truth;
  double angle_random_walk = 0.0;
  CompressedRecording recording;
  JointResult estimate;
};

Made made(const Sequence& sequence, std::uint64_t unit, std::uint64_t time, int changed = 0, double change = 0.0) {
  RigConfig config = default_rig_config();
  config.seed = 77000 + 10 * unit + time;  // of the table
  config.unit_seed = 55000 + unit;
  config.noise_seed = 990000 + 10 * unit + time;
  std::mt19937_64 of_unit(config.unit_seed.value_or(0));
  std::normal_distribution<double> differs;
  config.noise.gyro_random_walk_deg_per_rt_h *= std::exp(noise_scatter * differs(of_unit));
  config.noise.accel_random_walk_ug_per_rt_hz *= std::exp(noise_scatter * differs(of_unit));
  const std::array<double, 24> whole = rig_model::draw_truth(config);
  std::mt19937_64 random(config.seed);
  std::normal_distribution<double> normal;
  for (std::size_t k = 0; k < 6; ++k)
    config.truth[k] = whole[k] + normal(random) * (k < 3 ? turn_on_gyro_degph : turn_on_accel_g);
  if (change != 0.0)
    config.truth[std::size_t(changed)] =
        config.truth[std::size_t(changed)].value_or(whole[std::size_t(changed)]) + change;
  Made result;
  result.angle_random_walk = config.noise.gyro_random_walk_deg_per_rt_h * radprs_per_degprh;
  result.recording = record_on_rig(sequence, config).recording;
  const std::array<double, 24> truth = rig_model::draw_truth(config);
  for (int k = 0; k < parameter_count; ++k) result.truth[k] = truth[std::size_t(k)];
  result.estimate = joint_estimate(result.recording);
  return result;
}

EarlierCalibration earlier(const Sequence& sequence, std::uint64_t unit, std::uint64_t time) {
  const JointResult e = made(sequence, unit, time).estimate;
  EarlierCalibration c{"U" + std::to_string(10000 + unit), std::to_string(time), to_vector(e.parameters),
                       Eigen::MatrixXd::Zero(parameter_count, parameter_count), e.noise};
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
  const auto first = std::uint64_t(std::strtoll(argv[1], nullptr, 10)),
             count = std::uint64_t(std::strtoll(argv[2], nullptr, 10));
  const std::uint64_t units = argc > 4 ? std::uint64_t(std::strtoll(argv[4], nullptr, 10)) : 100;
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
  // Of each kind of parameter: squared errors of the data alone, with the part's noise, of a new unit, of one with a history; how often the
  // prior was not used, and of changed units how often what has changed was named, and nothing else.
  const auto kind = [](int k) { return k < 3 ? "N" : k < 6 ? "A" : k < 15 ? "n" : "a"; };
  std::map<std::string, std::array<double, 4>> squares;
  std::array<double, 4> nees = {};
  double smaller = 0.0, noise_error[2] = {0.0, 0.0};
  int not_used[2] = {0, 0}, named = 0, alone_named = 0, noise_changed = 0;
  std::mt19937_64 random(first);
  for (std::uint64_t u = 0; u < count; ++u) {
    const Made now = made(*brief, first * 1000 + u, 2);
    const std::string unit = "U" + std::to_string(10000 + first * 1000 + u);
    std::vector<EarlierCalibration> others = history;
    std::erase_if(others, [&](const EarlierCalibration& c) { return c.unit == unit; });
    const std::optional<FleetPrior> of_fleet = fleet_prior(others, unit), of_unit = fleet_prior(history, unit);
    const auto with_noise = [](const Made& m, const FleetPrior& prior) {
      return estimate_with_noise(m.recording, m.estimate, noise_of_class(*prior.noise, *m.estimate.noise_fit).noise);
    };
    noise_changed += !noise_of_class(*of_fleet->noise, *now.estimate.noise_fit).changed.empty();
    std::array<JointResult, 4> e = {now.estimate, with_noise(now, *of_fleet), {}, {}};
    e[2] = e[3] = e[1];
    not_used[0] += !use_prior(*of_fleet, e[2]).changed.empty();
    not_used[1] += !use_prior(*of_unit, e[3]).changed.empty();
    for (const int k : now.estimate.free) {
      smaller += e[1].sigma[k] / e[0].sigma[k];
      for (std::size_t how = 0; how < 4; ++how) {
        const double error = to_vector(e[how].parameters)[k] - now.truth[k];
        squares[kind(k)][how] += std::pow(error / now.estimate.sigma[k], 2);
        nees[how] += std::pow(error / e[how].sigma[k], 2);
      }
    }
    for (const std::size_t how : {0, 1})
      noise_error[how] += std::pow(std::log(e[how].noise.angle_random_walk[0] / now.angle_random_walk), 2);

    const int at = now.estimate.free[std::uniform_int_distribution<std::size_t>(0, 20)(random)];
    const auto row = std::ranges::find(now.estimate.free, at) - now.estimate.free.begin();
    const double size = std::uniform_real_distribution<>(6.0, 20.0)(random) * (random() % 2 == 0 ? 1.0 : -1.0) *
                        std::sqrt(now.estimate.covariance(row, row) + of_unit->covariance(at, at));
    const Made later = made(*brief, first * 1000 + u, 2, at, size);
    JointResult changed = with_noise(later, *of_unit);
    const std::vector<int> found = use_prior(*of_unit, changed).changed;
    named += std::ranges::find(found, at) != found.end();
    alone_named += found == std::vector<int>{at};
  }
  for (const auto& [name, s] : squares)
    std::printf("%s: error falls by %.2f (noise of the part), %.2f (new unit), %.2f (calibrated twice before)\n",
                name.c_str(), std::sqrt(s[0] / s[1]), std::sqrt(s[0] / s[2]), std::sqrt(s[0] / s[3]));
  const double all = 21.0 * double(count);
  const auto of = static_cast<unsigned long long>(count);
  std::printf("error^2 / sigma^2: %.2f alone, %.2f with the part's noise, %.2f new, %.2f with history\n", nees[0] / all,
              nees[1] / all, nees[2] / all, nees[3] / all);
  std::printf(
      "sigma with the part's noise / without: %.3f; angle random walk, rms error: %.1f %% and %.1f %% without\n",
      smaller / all, 100.0 * std::sqrt(noise_error[1] / double(count)),
      100.0 * std::sqrt(noise_error[0] / double(count)));
  std::printf(
      "not used %d (new) and %d (history) of %llu, noise not used %d; changed units: named %d, it alone %d of %llu\n",
      not_used[0], not_used[1], of, noise_changed, named, alone_named, of);
  return 0;
}
