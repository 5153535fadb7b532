// Noise coefficients against what was laid, over seeds (docs/allan.md): one line a coefficient.
//
//   study_allan SAMPLES PERIOD_S Q N B K R CHANNELS [RESTS]
// N, B, K from the rig's noise (flicker down to 1/65536 s), Q as white noise of the angle, R as a straight line; six channels a seed.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "calib/statistics/allan.h"
#include "turntable_drivers/rig/rig_sensors.h"

namespace turncal {
namespace {

struct Tally {
  double seen = 0.0, sum = 0.0, squares = 0.0, sigma = 0.0, inside = 0.0, below = 0.0, limit = 0.0;
};

int run(char** words, int count) {
  const auto samples = std::int64_t(std::atof(words[1]));
  const double period_s = std::atof(words[2]);
  AllanFit laid;
  for (std::size_t k = 0; k < allan_terms; ++k) laid.terms[k].value = std::atof(words[3 + k]);
  const int seeds = (std::atoi(words[8]) + 5) / 6, rests = count > 9 ? std::atoi(words[9]) : 1;
  std::array<Tally, allan_terms> tallies;
  double points = 0.0, held = 0.0, channels = 0.0, misfit = 0.0, cut = 0.0;
  const rig_model::NoiseSize size{laid.terms[1].value, laid.terms[2].value, 65536.0, laid.terms[3].value};
  for (int seed = 0; seed < seeds; ++seed) {
    RestCellMaker maker(period_s);
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    std::normal_distribution<double> normal;
    for (int rest = 0; rest < rests; ++rest) {
      const auto stream = std::uint64_t(seed * rests + rest);
      std::array<rig_model::TriadNoise, 2> noise = {rig_model::TriadNoise(size, period_s, stream, 0),
                                                    rig_model::TriadNoise(size, period_s, stream, 1)};
      Channels before = Channels::Zero();
      for (std::int64_t k = 0; k < samples; ++k) {
        Channels increments, now;
        for (Eigen::Index triad = 0; triad < 2; ++triad) {
          std::array<double, 3> three{};
          noise[std::size_t(triad)].add(three);
          increments.segment<3>(3 * triad) = Eigen::Vector3d::Map(three.data());
        }
        for (double& value : now) value = laid.terms[0].value * normal(random);
        increments += now - before;
        increments.array() += laid.terms[4].value * double(k) * period_s * period_s;
        before = now;
        maker.add(k, increments);
      }
      maker.begin_rest();
    }
    const AllanResult result = allan_deviation(maker.take(Channels::Ones()));
    for (const AllanAxis& axis : result.axes) {
      channels += 1.0;
      misfit += axis.fit.misfit;
      cut += axis.fit.cut ? 1.0 : 0.0;
      for (const AllanPoint& p : axis.points) {
        const double deviation = std::sqrt(allan_variance(laid, p.tau_s));
        points += 1.0;
        held += p.low < deviation && deviation < p.high ? 1.0 : 0.0;
      }
      for (std::size_t k = 0; k < allan_terms; ++k) {
        const AllanCoefficient& c = axis.fit.terms[k];
        const double truth = laid.terms[k].value;
        Tally& t = tallies[k];
        if (c.value == 0.0) {
          t.limit += c.limit;
          t.below += std::abs(truth) <= c.limit ? 1.0 : 0.0;
          continue;
        }
        t.seen += 1.0;
        t.sum += c.value;
        t.squares += c.value * c.value;
        t.sigma += c.sigma;
        t.inside += std::abs(c.value - truth) < c.sigma ? 1.0 : 0.0;
      }
    }
  }
  std::printf("%lld samples of %g s, %d rests, %.0f channels: misfit %.2f, cut %.0f, points inside %.1f %%\n",
              static_cast<long long>(samples), period_s, rests, channels, misfit / channels, cut,
              100.0 * held / points);
  for (std::size_t k = 0; k < allan_terms; ++k) {
    const Tally& t = tallies[k];
    const double truth = laid.terms[k].value, n = std::max(1.0, t.seen), mean = t.sum / n, not_seen = channels - t.seen;
    std::printf("  %s %-8.3g seen %5.1f %% mean %.4g ratio %.3f scatter %.3g sigma %.3g inside %.0f %%",
                allan_letters[k], truth, 100.0 * t.seen / channels, mean, truth != 0.0 ? mean / truth : 0.0,
                std::sqrt(std::max(0.0, t.squares / n - mean * mean)), t.sigma / n, 100.0 * t.inside / n);
    if (not_seen > 0.0) std::printf("; limit %.3g holds %.0f %%", t.limit / not_seen, 100.0 * t.below / not_seen);
    std::printf("\n");
  }
  return 0;
}

}  // namespace
}  // namespace turncal

int main(int argc, char** argv) {
  if (argc < 9) {
    std::fprintf(stderr, "study_allan SAMPLES PERIOD_S Q N B K R CHANNELS [RESTS]\n");
    return 1;
  }
  return turncal::run(argv, argc);
}
