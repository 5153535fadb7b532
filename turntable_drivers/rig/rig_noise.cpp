#include "turntable_drivers/rig/rig_noise.h"

#include <algorithm>
#include <cmath>

#include "turntable_drivers/rig/rig_math.h"

namespace turncal::rig_model {

TriadNoise::TriadNoise(const NoiseSize& size, double period_s, std::uint64_t seed, std::uint64_t triad)
    : period_s_(period_s),
      white_sigma_(size.white * std::sqrt(period_s)),
      drifts_(size.flicker > 0.0 || size.rate_walk > 0.0),
      white_(seed, 3 * triad + 1),
      flicker_(seed, 3 * triad + 2),
      walk_stream_(seed, 3 * triad + 3) {
  constexpr double ratio = 4.0;
  std::vector<double> constants_s;
  for (double tau_s = size.flicker_longest_s; tau_s > 0.125; tau_s /= ratio) constants_s.push_back(tau_s);
  if (size.flicker > 0.0 && !constants_s.empty()) {
    grid_ = std::max<std::int64_t>(1, static_cast<std::int64_t>(constants_s.back() / 16.0 / period_s));
    const double sigma = size.flicker * std::sqrt(log_of(ratio) / pi);
    std::int64_t every = grid_;
    for (std::size_t i = constants_s.size(); i-- > 0;) {  // fastest first
      Markov process;
      process.every = every;
      process.decay = exp_of(-static_cast<double>(every) * period_s / constants_s[i]);
      process.kick = sigma * std::sqrt(1.0 - process.decay * process.decay);
      for (double& value : process.value) value = sigma * flicker_.normal();
      processes_.push_back(process);
      every *= static_cast<std::int64_t>(ratio);
    }
  } else {
    grid_ = std::max<std::int64_t>(1, static_cast<std::int64_t>(0.1 / period_s));
  }
  walk_every_ =
      grid_ * std::max<std::int64_t>(1, static_cast<std::int64_t>(0.1 / (static_cast<double>(grid_) * period_s)));
  walk_kick_ = size.rate_walk * std::sqrt(static_cast<double>(walk_every_) * period_s);
}

void TriadNoise::update_bias() {
  bias_ = {0.0, 0.0, 0.0};
  for (Markov& process : processes_) {
    // Processes start in their stationary state, so sample 0 takes no step.
    if (sample_ > 0 && sample_ % process.every == 0) {
      for (double& value : process.value) value = process.decay * value + process.kick * flicker_.normal();
    }
    for (std::size_t i = 0; i < 3; ++i) bias_[i] += process.value[i];
  }
  if (walk_kick_ > 0.0) {
    if (sample_ > 0 && sample_ % walk_every_ == 0) {
      for (double& value : walk_) value += walk_kick_ * walk_stream_.normal();
    }
    for (std::size_t i = 0; i < 3; ++i) bias_[i] += walk_[i];
  }
}

void TriadNoise::add(std::array<double, 3>& increment) {
  if (drifts_) {
    if (until_update_ == 0) {
      update_bias();
      until_update_ = grid_;
    }
    --until_update_;
    ++sample_;
    for (std::size_t i = 0; i < 3; ++i) increment[i] += bias_[i] * period_s_;
  }
  if (white_sigma_ > 0.0) {
    for (double& value : increment) value += white_sigma_ * white_.normal();
  }
}

}  // namespace turncal::rig_model
