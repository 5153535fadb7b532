#include "calib/statistics/allan.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
#include <numeric>
#include <span>

#include <unsupported/Eigen/FFT>

#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::ArrayXd;
using Eigen::Index;
using Eigen::VectorXd;

using Squares = Eigen::Array4d;  // Q^2 N^2 B^2 K^2
constexpr unsigned ramp_bit = 1U << 4U;

// m = 1 2 3 4 6 8 12 16 24 ...
std::vector<std::size_t> multiples(std::size_t most) {
  std::vector<std::size_t> all;
  for (std::size_t m = 1; m <= most; m *= 2) {
    all.push_back(m);
    if (m > 1 && m + m / 2 <= most) all.push_back(m + m / 2);
  }
  return all;
}

Squares squares_of(const AllanFit& fit) {
  Squares c;
  for (Index k = 0; k < 4; ++k) c[k] = fit.terms[k].value * fit.terms[k].value;
  return c;
}

// ---- one rest of one channel ----

// A gap is filled with the mean over so many times its length on either side.
constexpr std::size_t lengths_around = 5;

struct Rest {
  std::vector<double> rate;  // less its mean, gaps filled
  std::vector<double> theta;
  std::vector<std::pair<std::size_t, std::size_t>> gaps;
  double filled = 0.0;  // share of cells that are filled
};

Rest make_rest(std::span<const double> mean, double cell_s) {
  const auto there = [](double value) { return !std::isnan(value); };
  while (!mean.empty() && !there(mean.back())) mean = mean.first(mean.size() - 1);
  while (!mean.empty() && !there(mean.front())) mean = mean.subspan(1);
  Rest rest;
  rest.rate.assign(mean.begin(), mean.end());
  const std::size_t n = mean.size();
  double sum = 0.0, count = 0.0;
  for (const double value : mean)
    if (there(value)) sum += value, count += 1.0;
  if (n == 0) return rest;
  rest.filled = 1.0 - count / double(n);
  for (double& value : rest.rate) value -= sum / count;
  const auto changes = [&](double value) { return std::abs(value) > 1e-12 * std::abs(sum / count); };
  if (std::ranges::none_of(rest.rate, changes)) return {};
  for (std::size_t k = 0; k < n; ++k) {
    if (there(rest.rate[k])) continue;
    std::size_t end = k;
    while (!there(rest.rate[end])) ++end;
    const std::size_t around = lengths_around * (end - k);
    double near = 0.0, found = 0.0;
    for (std::size_t j = k - std::min(k, around); j < std::min(n, end + around); ++j)
      if (there(rest.rate[j])) near += rest.rate[j], found += 1.0;
    rest.gaps.emplace_back(k, end);
    std::fill(rest.rate.begin() + k, rest.rate.begin() + end, near / found);
    k = end - 1;
  }
  rest.theta.resize(n + 1);
  for (std::size_t k = 0; k < n; ++k) rest.theta[k + 1] = rest.theta[k] + rest.rate[k] * cell_s;
  return rest;
}

// Returns the sum of d_k^2, and adds their number to `count`.
double squares_of(const Rest& rest, std::size_t m, double& count) {
  if (rest.theta.size() < 2 * m + 1) return 0.0;
  const std::size_t end = rest.theta.size() - 2 * m;
  std::size_t from = 0;
  double sum = 0.0;
  const auto add = [&](std::size_t to) {
    if (from >= to) return;
    const auto at = [&](std::size_t k) {
      return Eigen::Map<const VectorXd>(&rest.theta[k], static_cast<Index>(to - from));
    };
    sum += (at(from + 2 * m) - 2.0 * at(from + m) + at(from)).squaredNorm();
    count += double(to - from);
  };
  for (const auto& [begin, past] : rest.gaps) {
    if (10 * (past - begin) <= m) continue;
    add(std::min(end, begin + 1 - std::min(begin + 1, 2 * m)));
    from = std::max(from, past);
  }
  add(end);
  return sum;
}

// ---- degrees of freedom ----

// Returns the covariance of d_k with that `lag` s later, without the part of Q: the fourth difference of the generalised autocovariance of theta.
double covariance_of_differences(const Squares& c, double tau, double lag) {
  const auto s = [&](double t) {
    const double a = std::abs(t);
    if (a == 0.0) return 0.0;
    return a * (-0.5 * c[1] + a * (c[2] / (2.0 * pi) * std::log(a / tau) + a * c[3] / 12.0));
  };
  return 6.0 * s(lag) - 4.0 * (s(lag + tau) + s(lag - tau)) + s(lag + 2.0 * tau) + s(lag - 2.0 * tau);
}

// ---- the fit ----

// Power in eighths of an octave, as spectral density.
struct Spectrum {
  ArrayXd hz, n, xx, xg, gg;  // n coefficients; sums of their squares, products with a unit ramp's, squares of those
  Eigen::Array<double, Eigen::Dynamic, 4> unit;  // of each term with a coefficient of 1
  ArrayXd weight;                                // of its likelihood: a spectrum is trusted no further
  Index bins(double below_hz) const { return (hz <= below_hz).count(); }
};

struct Bin {
  double n = 0.0, hz = 0.0, xx = 0.0, xg = 0.0, gg = 0.0;
  Squares unit = Squares::Zero();
};
using Bins = std::map<int, Bin>;

// Returns the orthonormal DCT-II.
std::vector<double> cosine_transform(std::span<const double> y) {
  const std::size_t n = y.size();
  std::vector<double> order(n), x(n);
  for (std::size_t k = 0; k < n; ++k) order[k % 2 == 0 ? k / 2 : n - 1 - k / 2] = y[k];
  std::vector<std::complex<double>> half;
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  fft.fwd(half, order);
  for (std::size_t k = 1; k < n; ++k) {
    const std::complex<double> value = k < half.size() ? half[k] : std::conj(half[n - k]);
    const double phase = -pi * double(k) / (2.0 * double(n));
    x[k] = std::sqrt(2.0 / double(n)) * (std::polar(1.0, phase) * value).real();
  }
  return x;
}

// Returns the longest length up to n that is a product of 2, 3 and 5.
std::size_t quick_length(std::size_t n) {
  for (; n > 1; --n) {
    std::size_t left = n;
    for (const std::size_t p : {2U, 3U, 5U})
      while (left % p == 0) left /= p;
    if (left == 1) break;
  }
  return n;
}

// Returns the power of white noise in a rest whose gaps of g cells hold the mean of 5 g on either side, over that of
// one without gaps. A measured cell x_j enters with exp(i j a), and in each gap near it with a tenth of D(g) exp(i c
// a), c the gap's middle, D(n) the mean of exp(i k a) over n cells. Over randomly placed gaps (Poisson) the mean of
// these is share D(g) (11 D(11 g) - D(g)) / 10, their variance share D(g)^2 / 10 a cell. `angle`: a of one cell.
double white_power(const Rest& rest, double angle) {
  if (rest.gaps.empty()) return 1.0;
  constexpr double around = 2.0 * lengths_around;
  const double there = 1.0 - rest.filled, share = rest.filled / there;
  const double gap = rest.filled * double(rest.rate.size()) / double(rest.gaps.size());
  const auto mean_over = [&](double cells) { return std::sin(0.5 * cells * angle) / (0.5 * cells * angle); };
  const double inside = mean_over(gap), both = mean_over((around + 1.0) * gap);
  const double repeated = 1.0 + share * inside * ((around + 1.0) * both - inside) / around;
  return there * repeated * repeated + share * inside * inside / around;
}

void add_power(const Rest& rest, double cell_s, double above_hz, double up_to_hz, Bins& bins) {
  const std::size_t n = quick_length(rest.rate.size());
  if (n < 4) return;
  const double count = double(n), T = cell_s;
  const std::vector<double> x = cosine_transform(std::span(rest.rate).first(n));
  for (std::size_t j = 1; j < n; ++j) {
    const double angle = pi * double(j) / count;  // per cell
    const double hz = angle / (2.0 * pi * T);
    if (hz <= above_hz || hz > up_to_hz) continue;
    Bin& bin = bins[int(std::floor(8.0 * std::log2(hz)))];
    const double c = std::cos(angle / 2.0), s = std::sin(angle / 2.0);
    const double g = j % 2 == 1 ? -std::sqrt(2.0 / count) * T * std::sqrt(T) * c / (2.0 * s * s) : 0.0;
    const double power = x[j] * x[j] * T;
    bin.n += 1.0;
    bin.hz += hz;
    bin.xx += power;
    bin.xg += x[j] * std::sqrt(T) * g;
    bin.gg += g * g;
    // Q: includes the quantisation at the two ends of a rest.
    bin.unit += Squares((4.0 * s * s + 4.0 / count * c * c) / T, white_power(rest, angle), 1.0 / (2.0 * pi * hz),
                        T * T * (1.0 / (4.0 * s * s) - 1.0 / 6.0));
  }
}

Spectrum spectrum_of(const Bins& bins) {
  constexpr double believed = 0.003;
  Spectrum p;
  const Index count = bins.size();
  for (ArrayXd* array : {&p.hz, &p.n, &p.xx, &p.xg, &p.gg}) array->resize(count);
  p.unit.resize(count, 4);
  Index k = 0;
  for (const auto& [key, bin] : bins) {
    p.hz[k] = bin.hz / bin.n;
    p.n[k] = bin.n;
    p.xx[k] = bin.xx;
    p.xg[k] = bin.xg;
    p.gg[k] = bin.gg;
    p.unit.row(k++) = (bin.unit / bin.n).transpose();
  }
  p.weight = 1.0 / (1.0 + 0.5 * believed * believed * p.n);
  return p;
}

struct Fitted {
  double value = std::numeric_limits<double>::infinity();  // -2 ln L
  double criterion = std::numeric_limits<double>::infinity();
  unsigned set = 0;
  Squares squares = Squares::Zero();
  Squares relative_variance = Squares::Zero();  // of a square
  double ramp = 0.0, ramp_sigma = 0.0;
};

// Maximises the likelihood of the terms in `set` over the first `bins`. `held`: power of a term that stays fixed,
// beside which the others may vanish.
Fitted maximise(const Spectrum& p, Index bins, unsigned set, const Squares& from = Squares::Zero(),
                const ArrayXd& held = {}) {
  constexpr double negligible = 1e-4;  // of the power, everywhere
  const bool ramp = (set & ramp_bit) != 0;
  Fitted result;
  result.set = set;
  std::vector<Index> active;
  for (Index k = 0; k < 4; ++k)
    if ((set >> unsigned(k) & 1U) != 0) active.push_back(k);
  const Index terms = active.size();
  if (bins < terms + 2) return result;
  const Eigen::MatrixXd A = p.unit.topRows(bins).matrix()(Eigen::all, active);
  const ArrayXd w = p.weight.head(bins), n = p.n.head(bins), gg = p.gg.head(bins);
  VectorXd c(terms);
  for (Index k = 0; k < terms; ++k) {
    c[k] = from[active[k]];
    if (c[k] > 0.0) continue;
    c[k] = std::numeric_limits<double>::infinity();
    for (Index b = 0; b < bins; ++b)
      if (p.n[b] > 2.0 || bins < 12) c[k] = std::min(c[k], p.xx[b] / p.n[b] / A(b, k));
    c[k] = std::max(c[k] / double(terms), std::numeric_limits<double>::min());
  }
  ArrayXd lambda, S;
  double h = 0.0;
  const auto evaluate = [&](const VectorXd& at) {
    lambda = (A * at).array();
    if (held.size() > 0) lambda += held.head(bins);
    S = p.xx.head(bins);
    h = (w * gg / lambda).sum();
    result.ramp = ramp ? (w * p.xg.head(bins) / lambda).sum() / h : 0.0;
    S += result.ramp * (result.ramp * gg - 2.0 * p.xg.head(bins));
    result.value = (w * (n * lambda.log() + S / lambda)).sum();
    return result.value + (ramp ? std::log(h) : 0.0);
  };
  const auto nothing_of = [&](Index k) { return ((A.col(k) * c[k]).array() / lambda).maxCoeff() < negligible; };
  double now = evaluate(c);
  bool vanishes = false;
  Eigen::MatrixXd information;
  for (int iteration = 0; iteration < 60; ++iteration) {
    const ArrayXd square = lambda.square();
    const Eigen::MatrixXd share = A * c.asDiagonal();
    VectorXd gradient = 0.5 * (share.transpose() * (w * (n * lambda - S) / square).matrix());
    if (ramp) gradient -= 0.5 / h * (share.transpose() * (w * gg / square).matrix());
    information = 0.5 * share.transpose() * (w * n / square).matrix().asDiagonal() * share;
    for (Index k = 0; k < terms; ++k) vanishes = vanishes || (gradient[k] > 0.0 && nothing_of(k));
    if (vanishes) break;
    VectorXd step = -solve_symmetric(information, gradient);
    if (const double most = step.cwiseAbs().maxCoeff(); most > 1.5) step *= 1.5 / most;
    if (!step.allFinite() || std::abs(gradient.dot(step)) < 1e-5) break;
    VectorXd next;
    double then = now;
    for (int shrink = 0; shrink < 12; ++shrink, step *= 0.5) {
      next = c.array() * step.array().exp();
      then = evaluate(next);
      if (then < now) break;
    }
    if (!(then < now)) {
      now = evaluate(c);
      break;
    }
    c = next;
    now = then;
  }
  for (Index k = 0; k < terms; ++k) vanishes = vanishes || nothing_of(k);
  if (vanishes && held.size() == 0) result.value = std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd covariance = inverse(information);
  for (Index k = 0; k < terms; ++k) {
    result.squares[active[k]] = c[k];
    result.relative_variance[active[k]] = covariance(k, k);
  }
  result.ramp_sigma = ramp ? 1.0 / std::sqrt(h) : 0.0;
  return result;
}

// Gain of -2 ln L by a term that is absent, exceeded once in a hundred cases: half chi-square, since a variance is not
// negative; chi-square for R.
constexpr double cost_of_variance = 5.41, cost_of_ramp = 6.63;

std::vector<Fitted> all_choices(const Spectrum& p, Index bins) {
  std::vector<Fitted> all;
  for (unsigned set = 1; set < 2 * ramp_bit; ++set) {
    if ((set & ~ramp_bit) == 0) continue;
    Fitted one = maximise(p, bins, set);
    one.criterion = one.value;
    for (unsigned k = 0; k < allan_terms; ++k)
      if ((set >> k & 1U) != 0) one.criterion += k < 4 ? cost_of_variance : cost_of_ramp;
    all.push_back(one);
  }
  return all;
}

const Fitted& best_of(const std::vector<Fitted>& all, unsigned without = 0) {
  const Fitted* best = nullptr;
  for (const Fitted& one : all)
    if ((one.set & without) == 0 && (best == nullptr || one.criterion < best->criterion)) best = &one;
  return *best;
}

// Mean square residual over that of chance, and the value that chance exceeds in one of a thousand records.
struct Misfit {
  double mean = std::numeric_limits<double>::infinity(), limit = 1.0;
};
Misfit misfit_of(const Spectrum& p, Index bins, const Fitted& fit) {
  if (!std::isfinite(fit.value)) return {};
  const ArrayXd lambda = (p.unit.topRows(bins).matrix() * fit.squares.matrix()).array();
  double sum = 0.0, count = 0.0, power = 0.0, n = 0.0;  // the lowest bins are pooled up to 8 coefficients
  for (Index b = 0; b < bins; ++b) {
    power += (p.xx[b] + fit.ramp * (fit.ramp * p.gg[b] - 2.0 * p.xg[b])) / lambda[b];
    n += p.n[b];
    if (n < 8.0) continue;
    const double spread = 2.0 / (9.0 * n);  // the cube root of chi-square over n is nearly normal (Wilson and Hilferty)
    sum += p.weight[b] * std::pow(std::cbrt(power / n) - 1.0 + spread, 2) / spread;
    count += 1.0;
    power = n = 0.0;
  }
  if (count == 0.0) return {.mean = 1.0, .limit = 1.0};
  return {.mean = sum / count, .limit = chi_square_limit(1e-3, count) / count};
}

// Returns the largest square at which -2 ln L is still within 2.71 of its minimum (95 %, one-sided).
double limit_of(const Spectrum& p, Index bins, const Fitted& best, Index term) {
  const ArrayXd unit = p.unit.col(term);
  const auto beyond = [&](double square) {
    return maximise(p, bins, best.set, best.squares, ArrayXd(square * unit)).value > best.value + 2.71;
  };
  const ArrayXd lambda = (p.unit.topRows(bins).matrix() * best.squares.matrix()).array();
  double high = 1e-3 * (lambda / unit.head(bins)).minCoeff();
  for (int k = 0; k < 40 && !beyond(high); ++k) high *= 4.0;
  double low = high / 4.0;
  for (int k = 0; k < 7; ++k) {
    const double middle = std::sqrt(low * high);
    (beyond(middle) ? high : low) = middle;
  }
  return high;
}

AllanFit fit_of(const Spectrum& p) {
  AllanFit fit;
  if (p.hz.size() < 4) return fit;
  Index bins = p.hz.size();
  std::vector<Fitted> all = all_choices(p, bins);
  Misfit misfit = misfit_of(p, bins, best_of(all));
  // At least four octaves remain: counting in pulses may give lines down to a hertz.
  for (double top = 0.5 * p.hz[bins - 1]; misfit.mean > misfit.limit && top > 16.0 * p.hz[0]; top *= 0.5) {
    std::vector<Fitted> tried = all_choices(p, p.bins(top));
    const Misfit left = misfit_of(p, p.bins(top), best_of(tried));
    if (!(left.mean < misfit.mean)) continue;
    all = std::move(tried);
    bins = p.bins(top);
    misfit = left;
  }
  fit.misfit = misfit.mean;
  fit.fits = misfit.mean <= misfit.limit;
  const Fitted& best = best_of(all);
  fit.made = std::isfinite(best.value);
  if (!fit.made) return fit;
  fit.highest_hz = p.hz[bins - 1];
  fit.cut = bins < p.hz.size();
  const double wider = std::sqrt(std::max(1.0, fit.misfit));
  for (unsigned k = 0; k < allan_terms; ++k) {
    AllanCoefficient& term = fit.terms[k];
    const bool of_ramp = k == 4;
    if ((best.set >> k & 1U) != 0) {
      term.value = of_ramp ? best.ramp : std::sqrt(best.squares[k]);
      term.sigma = wider * (of_ramp ? best.ramp_sigma : 0.5 * term.value * std::sqrt(best.relative_variance[k]));
      const Fitted& without = best_of(all, 1U << k);
      term.gain = without.criterion - best.criterion;
      term.instead = without.set & ~best.set;
    } else if (of_ramp) {
      const Fitted with = maximise(p, bins, best.set | ramp_bit, best.squares);
      term.limit = std::abs(with.ramp) + 1.645 * wider * with.ramp_sigma;
    } else {
      term.limit = std::sqrt(limit_of(p, bins, best, k));
    }
  }
  return fit;
}

// ---- cells ----

AllanAxis analyse(const RestCells& cells, std::size_t axis) {
  AllanAxis result;
  const bool fine = !cells.first_ends.empty();
  const double highest = 1e300, split = fine ? 0.4 / cells.cell_s : highest;
  Bins bins;
  const auto rests_of = [&](const std::vector<std::size_t>& ends, const std::vector<double>& mean, double cell_s,
                            double above_hz, double up_to_hz) {
    std::vector<Rest> rests;
    std::size_t from = 0;
    for (const std::size_t end : ends) {
      rests.push_back(make_rest(std::span(mean).subspan(from, end - from), cell_s));
      add_power(rests.back(), cell_s, above_hz, up_to_hz, bins);
      from = end;
    }
    return rests;
  };
  const std::vector<Rest> rests = rests_of(cells.ends, cells.mean[axis], cells.cell_s, 0.0, split);
  const std::vector<Rest> first = rests_of(cells.first_ends, cells.first[axis], cells.sample_s, split, highest);
  result.fit = fit_of(spectrum_of(bins));

  const auto add = [&](const std::vector<Rest>& of, double cell_s, double from_s, double to_s) {
    std::size_t longest = 0;
    for (const Rest& rest : of) longest = std::max(longest, rest.rate.size());
    for (const std::size_t m : multiples(longest / 3)) {
      AllanPoint point{double(m) * cell_s};
      if (point.tau_s < from_s || point.tau_s >= to_s) continue;
      double sum = 0.0, count = 0.0;
      std::vector<double> spans;
      for (const Rest& rest : of) {
        const double before = count;
        sum += squares_of(rest, m, count);
        if (count > before) spans.push_back((count - before) * cell_s);
      }
      if (!(count > 0.0) || !(sum > 0.0)) continue;
      point.deviation = std::sqrt(sum / (2.0 * count)) / point.tau_s;
      if (result.fit.made) {
        constexpr double tail = 0.158655;
        point.degrees = equivalent_degrees(result.fit, point.tau_s, cell_s, spans);
        point.low = point.deviation * std::sqrt(point.degrees / chi_square_limit(tail, point.degrees));
        point.high = point.deviation * std::sqrt(point.degrees / chi_square_limit(1.0 - tail, point.degrees));
      }
      result.points.push_back(point);
    }
  };
  const double whole = fine ? 7.9 * cells.cell_s : 0.0;  // from 8 cells on
  if (fine) add(first, cells.sample_s, 0.0, whole);
  add(rests, cells.cell_s, whole, highest);
  return result;
}

}  // namespace

double allan_variance(const AllanFit& fit, double tau_s) {
  const Squares c = squares_of(fit);
  return 3.0 * c[0] / (tau_s * tau_s) + c[1] / tau_s + 2.0 * std::log(2.0) / pi * c[2] + c[3] * tau_s / 3.0 +
         0.5 * std::pow(fit.rate_ramp().value * tau_s, 2);
}

double equivalent_degrees(const AllanFit& fit, double tau, double cell_s, const std::vector<double>& spans) {
  const Squares c = squares_of(fit);
  const double total = std::accumulate(spans.begin(), spans.end(), 0.0);
  const double longest = *std::ranges::max_element(spans);
  const auto pairs = [&](double lag) {
    double sum = 0.0;
    for (const double span : spans) sum += std::max(0.0, span - lag);
    return lag > 0.0 ? 2.0 * sum : sum;
  };
  const double step = std::max(cell_s, tau / 32.0);
  double squares = 0.0, sum = 0.0;
  for (double lag = 0.0; lag < std::min(8.0 * tau, longest); lag += step) {
    const double r = covariance_of_differences(c, tau, lag), weight = step * pairs(lag);
    squares += weight * r * r;
    sum += weight * r;
  }
  constexpr std::array of_q = {6.0, -4.0, 1.0};
  for (std::size_t k = 0; k < of_q.size() && c[0] > 0.0; ++k) {
    const double lag = double(k) * tau, q = c[0] * of_q[k], weight = cell_s * pairs(lag);
    squares += weight * q * (2.0 * covariance_of_differences(c, tau, lag) + q);
    sum += weight * q;
  }
  const double mean = fit.rate_ramp().value * tau * tau;
  const double expected = covariance_of_differences(c, tau, 0.0) + 6.0 * c[0] + mean * mean;
  const double variance = 2.0 * squares + 4.0 * mean * mean * std::max(sum, 0.0);
  return std::max(1.0, 2.0 * std::pow(expected * total, 2) / variance);
}

const AllanPoint* AllanAxis::lowest() const {
  const auto at = std::ranges::min_element(points, {}, &AllanPoint::deviation);
  return at == points.end() ? nullptr : &*at;
}

RestCellMaker::RestCellMaker(double sample_period_s) { cells_.sample_s = sample_period_s; }

void RestCellMaker::begin_rest() {
  if (!first_) return;
  close_cell();
  cells_.ends.push_back(cells_.mean[0].size());
  first_.reset();
}

void RestCellMaker::add(std::int64_t counter, const Channels& increments) {
  if (first_ && counter <= *last_) return;
  // After a gap of a tenth of the rest the reading may be another: a new rest begins.
  if (first_ && 10 * (counter - *last_ - 1) > *last_ - *first_ + 1) begin_rest();
  if (!first_) {
    first_ = counter;
    cell_ = 0;
    last_ = counter - 1;
  }
  last_ = counter;
  const std::int64_t cell = (counter - *first_) / std::int64_t(a_cell_);
  while (cell_ < cell) close_cell();
  sum_ += increments;
  ++count_;
  if (cells_.mean[0].size() >= most_cells) halve();
}

void RestCellMaker::close_cell() {
  const bool there = 2 * count_ >= a_cell_;
  for (std::size_t axis = 0; axis < 6; ++axis)
    cells_.mean[axis].push_back(there ? sum_[axis] / double(count_) : std::numeric_limits<double>::quiet_NaN());
  sum_.setZero();
  count_ = 0;
  ++cell_;
}

// Merges cells in pairs. An odd one at the end of a rest is dropped; in the open rest its partner is awaited.
void RestCellMaker::halve() {
  const std::size_t begin = cells_.ends.empty() ? 0 : cells_.ends.back();
  if ((cells_.mean[0].size() - begin) % 2 != 0) return;
  std::vector<std::size_t> ends = cells_.ends;
  ends.push_back(cells_.mean[0].size());
  if (a_cell_ == 1) {
    constexpr std::size_t first = std::size_t{1} << 18;
    for (const std::size_t end : ends) cells_.first_ends.push_back(std::min(first, end));
    for (std::size_t axis = 0; axis < 6; ++axis)
      cells_.first[axis].assign(cells_.mean[axis].begin(), cells_.mean[axis].begin() + first);
  }
  std::size_t to = 0;
  for (std::size_t r = 0, from = 0; r < ends.size(); from = ends[r++]) {
    for (std::size_t k = from; k + 1 < ends[r]; k += 2, ++to)
      for (auto& mean : cells_.mean)
        mean[to] = std::isnan(mean[k])       ? mean[k + 1]
                   : std::isnan(mean[k + 1]) ? mean[k]
                                             : 0.5 * (mean[k] + mean[k + 1]);
    if (r < cells_.ends.size()) cells_.ends[r] = to;
  }
  for (auto& mean : cells_.mean) mean.resize(to);
  // The open cell keeps its beginning.
  a_cell_ *= 2;
  cell_ /= 2;
}

RestCells RestCellMaker::take(const Channels& si) {
  begin_rest();
  cells_.cell_s = double(a_cell_) * cells_.sample_s;
  for (std::size_t axis = 0; axis < 6; ++axis) {
    const double scale = si[axis];
    for (auto* mean : {&cells_.mean[axis], &cells_.first[axis]})
      for (double& value : *mean) value *= scale / cells_.sample_s;
  }
  return std::move(cells_);
}

AllanResult allan_deviation(const RestCells& cells) {
  AllanResult result;
  std::size_t from = 0;
  for (const std::size_t end : cells.ends) {
    const double length = double(end - from) * cells.cell_s;
    result.total_s += length;
    result.longest_s = std::max(result.longest_s, length);
    from = end;
  }
  for (std::size_t axis = 0; axis < 6; ++axis) result.axes[axis] = analyse(cells, axis);
  return result;
}

AllanResult allan_deviation(const CompressedRecording& recording, const Parameters& parameters, double min_dwell_s) {
  const SensorModel model = sensor_model(parameters, recording.info);
  RestCells cells;
  const auto close = [&] {
    const std::size_t from = cells.ends.empty() ? 0 : cells.ends.back(), end = cells.mean[0].size();
    const bool long_enough = double(end - from + 1) * cells.cell_s > min_dwell_s;
    if (long_enough && end > from) cells.ends.push_back(end);
    if (!long_enough)
      for (auto& mean : cells.mean) mean.resize(from);
  };
  int segment = -1;
  for (const Block& block : recording.blocks) {
    const bool joins = block.whole_second && (block.segment == segment || segment < 0 || !recording.rotates(block));
    if (!joins) {
      close();
      segment = -1;
      continue;
    }
    if (segment < 0) cells.cell_s = block.duration_s;
    segment = block.segment;
    for (std::size_t axis = 0; axis < 6; ++axis) {
      const Index k = static_cast<Index>(axis % 3);
      const double sum = axis < 3 ? model.gyro_scale(k, k) * block.gyro[k] : model.accel_scale(k, k) * block.accel[k];
      cells.mean[axis].push_back(block.missing > 0 ? std::numeric_limits<double>::quiet_NaN() : sum / block.duration_s);
    }
  }
  close();
  return allan_deviation(cells);
}

}  // namespace turncal
