#include "orchestrator/run/frozen_watch.h"

#include <algorithm>
#include <cstdio>

namespace turncal {

namespace {

constexpr double least_s = 2.0;
constexpr double most_s = 30.0;  // is not waited for any longer
constexpr std::int64_t times = 20;
constexpr std::int64_t share = 4;  // a unit with a stretch of this part of a dwell repeats itself

}  // namespace

void FrozenWatch::start() {
  samples_ = second_ = 0;
  now_ = longest_ = {};
}

std::string FrozenWatch::add(const ImuSample& sample) {
  const bool same = samples_ > 0 && sample.gyro == last_.gyro && sample.accel == last_.accel;
  if (!same) {
    close();
    now_ = {sample.counter, 0};
  }
  last_ = sample;
  ++samples_;
  ++now_.samples;
  if (frozen(longest_, std::max(second_, now_.samples))) return text(longest_);
  const bool too_long = static_cast<double>(now_.samples) * period_s_ >= most_s;
  return too_long && frozen(now_, longest_.samples) ? text(now_) : "";
}

std::string FrozenWatch::finish() {
  close();
  now_ = {};
  if (frozen(longest_, second_)) return text(longest_);
  repeats_itself_ = repeats_itself_ || longest_.samples > samples_ / share;
  usual_ = std::max(usual_, longest_.samples);
  return {};
}

void FrozenWatch::close() {
  second_ = std::max(second_, std::min(now_.samples, longest_.samples));
  if (now_.samples > longest_.samples) longest_ = now_;
}

bool FrozenWatch::unusual(const Stretch& stretch, std::int64_t longest_other) const {
  // What it is used to is known from the dwells before, or from enough of this one.
  const bool known = usual_ > 0 || samples_ - stretch.samples >= stretch.samples / 2;
  return !repeats_itself_ && known && stretch.samples > times * std::max({usual_, longest_other, std::int64_t{1}});
}

bool FrozenWatch::frozen(const Stretch& stretch, std::int64_t longest_other) const {
  return static_cast<double>(stretch.samples) * period_s_ >= least_s && unusual(stretch, longest_other);
}

std::string FrozenWatch::text(const Stretch& stretch) const {
  char line[160];
  std::snprintf(line, sizeof line, "all six channels gave the same in %lld samples, %lld to %lld (%.3f s)",
                static_cast<long long>(stretch.samples), static_cast<long long>(stretch.first),
                static_cast<long long>(stretch.first + stretch.samples - 1),
                static_cast<double>(stretch.samples) * period_s_);
  return line;
}

}  // namespace turncal
