// The rig's table and unit with what a draw makes of them, and what is true meanwhile. Everything here is used with the mutex of the
// table's server held.
#pragma once

#include <deque>

#include "orchestrator/station/station_config.h"
#include "tests/faults/drawn_fault.h"
#include "tests/test.h"
#include "turntable_drivers/rig/rig_group.h"

namespace turncal {

// The bits of a status by the number that a fault has for them.
inline bool& status_bit(AxisStatus& status, int which) {
  switch (which) {
    case 0: return status.in_position;
    case 1: return status.moving;
    case 2: return status.enabled;
    case 3: return status.homed;
    case 4: return status.fault;
    case 5: return status.limit;
    default: return status.emergency_stop;
  }
}
inline constexpr std::array<std::string_view, 5> table_orders = {"move", "stop", "abort", "enable", "home"};

// The true motion, by which a run is judged.
struct TrueMotion {
  struct Moment {
    double time_s;
    std::array<double, 3> position_deg, rate_degps;
    TableStatus status;
  };
  std::vector<Moment> moments;

  // A stretch of time in which an axis was beyond its limits.
  struct Excess {
    double began_s = 0.0, until_s = 0.0;
    int axis = 0;
    double rate_degps = 0.0, position_deg = 0.0;  // the farthest
    std::optional<double> answered_s;             // the first order to stop since
    bool told = false;                            // by position or rate, as the table gives them
  };
  std::array<std::optional<Excess>, 3> now;
  std::vector<Excess> over;

  // The first moment at or after a time.
  std::size_t place(double time_s) const {
    const auto at = std::lower_bound(moments.begin(), moments.end(), time_s,
                                     [](const Moment& moment, double t) { return moment.time_s < t; });
    return std::size_t(at - moments.begin());
  }
  const Moment& at(double time_s) const { return moments[std::min(place(time_s), moments.size() - 1)]; }
};

// A table as the driver's twin sees it: the rig's, misbehaving.
class MisbehavingTable : public Turntable {
 public:
  MisbehavingTable(RigGroup& group, const std::vector<Fault>& faults, const std::array<AxisLimits, 3>& limits)
      : group_(group), table_(group.table()), faults_(faults), limits_(limits) {}

  // To be called after every batch of samples.
  void pass() {
    TrueMotion::Moment moment{now_s(), {}, {}, {}};
    for (const Axis axis : all_axes) {
      const std::size_t i = index(axis);
      moment.position_deg[i] = group_.rig(0).axis(axis).position_deg;
      moment.rate_degps[i] = group_.rig(0).axis(axis).rate_degps;
      if (const Result<AxisStatus> status = table_.status(axis)) moment.status[i] = *status;
    }
    motion.moments.push_back(moment);
    judge(moment);
    for (const Fault& fault : faults_) {
      if (fault.manner != "runaway" || !fault.active(now_s())) continue;
      bool& begun = runaways_begun_[std::size_t(&fault - faults_.data())];
      const auto axis = static_cast<Axis>(fault.axis);
      if (!begun)
        group_.rig(0).command_move(axis, group_.rig(0).axis(axis).position_deg + fault.size, fault.other_size, 20.0);
      begun = true;
    }
    for (std::size_t i = 0; i < late_.size();) {
      if (late_[i].first > now_s()) {
        ++i;
        continue;
      }
      (void)late_[i].second().ok();
      late_.erase(late_.begin() + std::ptrdiff_t(i));
    }
  }

  Status connect() override { return table_.connect(); }
  Result<TableIdentity> identify() override { return table_.identify(); }
  Status clear_fault() override { return table_.clear_fault(); }
  Status enable() override {
    return carry_out(3, all_axes_, [this] { return table_.enable(); });
  }
  Status home() override {
    return carry_out(4, all_axes_, [this] {
      if (Status status = table_.home(); !status) return status;
      const RigTableBehaviour& rig = group_.rig(0).config().table;
      for (const Axis axis : all_axes) turn(axis, 0.0, rig.home_rate_degps, rig.home_acceleration_degps2);
      return Status();
    });
  }
  Status stop_all() override {
    note_stop();
    return carry_out(1, all_axes_, [this] { return table_.stop_all(); });
  }
  Status abort_all() override {
    note_stop();
    return carry_out(2, all_axes_, [this] { return table_.abort_all(); });
  }
  Status move_absolute(Axis axis, double position_deg, double rate_degps, double acceleration_degps2) override {
    return carry_out(0, int(axis), [=, this] {
      const double target_deg = by_drive(axis, position_deg);
      if (Status status = table_.move_absolute(axis, target_deg, rate_degps, acceleration_degps2); !status)
        return status;
      turn(axis, target_deg, rate_degps, acceleration_degps2);
      return Status();
    });
  }
  Result<AxisStatus> status(Axis axis) override {
    Result<AxisStatus> status = table_.status(axis);
    if (!status) return status;
    const std::size_t i = index(axis);
    for (const Fault& fault : faults_) {
      if (!fault.of_axis(i) || !fault.active(now_s())) continue;
      if (fault.of == FaultClass::position) lie(fault, i, *status);
      if (fault.of == FaultClass::status) lie_of_state(fault, axis, *status);
    }
    status->drive_on = status->enabled;
    remember_told(i, *status);
    return status;
  }

  double now_s() const { return group_.now_s(); }
  // What it told last of an axis.
  const std::optional<AxisStatus>& told(std::size_t i) const { return told_[i]; }
  AxisStatus truth(Axis axis) {
    const Result<AxisStatus> status = table_.status(axis);
    return status ? *status : AxisStatus{};
  }
  bool takes_orders = true;  // false: one was ignored, refused or put off
  TrueMotion motion;

 private:
  static constexpr int all_axes_ = 3;

  Status carry_out(int order, int axis, const std::function<Status()>& what) {
    for (const Fault& fault : faults_) {
      if (fault.of != FaultClass::orders || fault.which != order || !fault.active(now_s())) continue;
      if (axis != all_axes_ && !fault.of_axis(std::size_t(axis))) continue;
      takes_orders = false;
      if (fault.manner == "refused") return device_error("refused, as drawn");
      if (fault.manner == "late") late_.emplace_back(now_s() + fault.size, what);
      return {};
    }
    return what();
  }

  // What was commanded is made with the rate and acceleration that were drawn.
  void turn(Axis axis, double target_deg, double rate_degps, double acceleration_degps2) {
    bool other = false;
    for (const Fault& fault : faults_) {
      if (fault.manner != "factors" || !fault.of_axis(index(axis)) || !fault.active(now_s())) continue;
      rate_degps *= fault.size;
      acceleration_degps2 *= fault.other_size;
      other = true;
    }
    if (other) group_.rig(0).command_move(axis, target_deg, rate_degps, acceleration_degps2);
  }

  double false_position(const Fault& fault, std::size_t i, double true_deg) const {
    if (fault.manner == "alias" || fault.manner == "offset") return true_deg + fault.size;
    if (fault.manner == "scaled") return true_deg * fault.size;
    if (fault.manner == "quantised") return fault.size * std::round(true_deg / fault.size);
    if (fault.manner == "drift") return true_deg + fault.size * (now_s() - fault.begin_s);
    if (motion.moments.empty()) return true_deg;
    return motion.at(fault.manner == "frozen" ? fault.begin_s : now_s() - fault.size).position_deg[i];
  }
  // Where a drive goes that believes its encoder.
  double by_drive(Axis axis, double position_deg) const {
    for (const Fault& fault : faults_) {
      if (fault.of != FaultClass::position || !fault.by_drive || !fault.of_axis(index(axis)) || !fault.active(now_s()))
        continue;
      if (fault.manner == "alias" || fault.manner == "offset") position_deg -= fault.size;
      if (fault.manner == "scaled") position_deg /= fault.size;
    }
    return position_deg;
  }
  void lie(const Fault& fault, std::size_t i, AxisStatus& status) const {
    status.position_deg = false_position(fault, i, status.position_deg);
    if (fault.manner == "scaled") status.rate_degps *= fault.size;
    if (fault.manner == "frozen" && fault.which == 1) status.rate_degps = 0.0;
    if (fault.manner == "latency" && !motion.moments.empty())
      status.rate_degps = motion.at(now_s() - fault.size).rate_degps[i];
  }
  void lie_of_state(const Fault& fault, Axis axis, AxisStatus& status) const {
    bool& bit = status_bit(status, fault.which);
    if (fault.manner == "stuck on") bit = true;
    if (fault.manner == "stuck off") bit = false;
    if (fault.manner == "late" && !motion.moments.empty()) {
      TableStatus then = motion.at(now_s() - fault.size).status;
      bit = status_bit(then[index(axis)], fault.which);
    }
    if (fault.manner == "flickering") {
      const double cycle = now_s() / fault.size;
      if (cycle - std::floor(cycle) < fault.other_size) bit = !bit;
    }
    if (fault.manner == "early") {
      const Rig::AxisState state = group_.rig(0).axis(axis);
      const double left_deg = std::abs(state.target_deg - state.position_deg);
      if (left_deg < std::abs(state.rate_degps) * fault.size) bit = fault.which == 0;
    }
  }

  void note_stop() {
    for (auto& excess : motion.now)
      if (excess && !excess->answered_s) excess->answered_s = now_s();
  }
  // Before an axis knows its zero its angle means nothing.
  bool beyond(std::size_t i, bool homed, double position_deg, double rate_degps) const {
    const AxisLimits& limit = limits_[i];
    const bool outward = homed && ((position_deg > limit.soft_max_deg + 0.5 && rate_degps > 0.0) ||
                                   (position_deg < limit.soft_min_deg - 0.5 && rate_degps < 0.0));
    return std::abs(rate_degps) > 1.02 * limit.max_rate_degps + 0.05 || outward;
  }
  void judge(const TrueMotion::Moment& moment) {
    for (std::size_t i = 0; i < 3; ++i) {
      auto& excess = motion.now[i];
      if (!beyond(i, moment.status[i].homed, moment.position_deg[i], moment.rate_degps[i])) {
        if (excess) motion.over.push_back(*excess);
        excess.reset();
        continue;
      }
      if (!excess) {
        excess.emplace();
        excess->began_s = moment.time_s;
        excess->axis = int(i);
      }
      excess->until_s = moment.time_s;
      if (std::abs(moment.rate_degps[i]) > std::abs(excess->rate_degps)) excess->rate_degps = moment.rate_degps[i];
      excess->position_deg = moment.position_deg[i];
    }
  }
  void remember_told(std::size_t i, const AxisStatus& status) {
    const double passed_s = told_[i] ? now_s() - told_at_s_[i] : 0.0;
    double rate_degps = status.rate_degps;
    if (passed_s > 0.0) {
      const double by_angle = (status.position_deg - told_[i]->position_deg) / passed_s;
      if (std::abs(by_angle) > std::abs(rate_degps)) rate_degps = by_angle;
    }
    if (motion.now[i] && beyond(i, status.homed, status.position_deg, rate_degps)) motion.now[i]->told = true;
    told_[i] = status;
    told_at_s_[i] = now_s();
  }

  RigGroup& group_;
  Turntable& table_;
  const std::vector<Fault>& faults_;
  std::array<AxisLimits, 3> limits_;
  std::array<bool, 2> runaways_begun_{};
  std::deque<std::pair<double, std::function<Status()>>> late_;
  std::array<std::optional<AxisStatus>, 3> told_;
  std::array<double, 3> told_at_s_{};
};

// What a unit sends of what it felt.
class MisbehavingUnit {
 public:
  MisbehavingUnit(const std::vector<Fault>& faults, double period_s) : faults_(faults), period_s_(period_s), draw_(1) {}

  // Of the samples that came until now_s, those that it sends. The rig's own counter is the time.
  std::vector<ImuSample> send(std::span<const ImuSample> felt) {
    std::vector<ImuSample> sent;
    for (const ImuSample& sample : felt) {
      const double time_s = double(sample.counter) * period_s_;
      std::vector<ImuSample> made = {sample};
      for (std::size_t f = 0; f < faults_.size(); ++f) {
        const Fault& fault = faults_[f];
        if (fault.of != FaultClass::unit || !fault.active(time_s)) continue;
        std::vector<ImuSample> changed;
        for (const ImuSample& one : made) change(fault, state_[f], one, changed);
        made = std::move(changed);
      }
      for (ImuSample& one : made) {
        one.counter += counter_shift_;
        sent.push_back(one);
      }
    }
    return sent;
  }

 private:
  struct State {
    std::optional<ImuSample> before;         // what it was frozen at
    std::array<double, 6> exact{}, given{};  // sums: of real numbers, of pulses sent
    double phase = 0.0;
    bool begun = false;
  };
  static double& channel(ImuSample& sample, std::size_t i) { return i < 3 ? sample.gyro[i] : sample.accel[i - 3]; }
  // Pulses are whole, and none is lost.
  static void count(State& state, ImuSample& sample, const std::array<double, 6>& exact) {
    for (std::size_t i = 0; i < 6; ++i) {
      state.exact[i] += exact[i];
      channel(sample, i) = std::floor(state.exact[i]) - state.given[i];
      state.given[i] += channel(sample, i);
    }
  }

  void change(const Fault& fault, State& state, ImuSample sample, std::vector<ImuSample>& out) {
    const auto which = std::size_t(fault.which);
    const std::size_t triad = which < 3 ? 0 : 3;
    const std::string_view how = fault.manner;
    const bool first = !state.begun;
    state.begun = true;
    if (first) state.before = sample;
    if (how == "silence" || how == "hang-up") return;
    if (how == "invalid") sample.flags |= sample_flag_invalid;
    if (how == "counter reset" && first) {
      counter_shift_ = std::int64_t(fault.size) - sample.counter;
    }
    for (std::size_t i = 0; i < 6; ++i) {
      if (how == "frozen" || (how == "one frozen" && i == which)) channel(sample, i) = channel(*state.before, i);
    }
    if (how == "axes swapped") std::swap(channel(sample, triad + which % 3), channel(sample, triad + (which + 1) % 3));
    if (how == "sign reversed") channel(sample, which) = -channel(sample, which);
    if (how == "saturated") {
      // A gravity, or 10 deg/s, of the laser_gyro frame in pulses of a sample.
      const double most = std::floor(fault.size * (which < 3 ? 36000.0 / 0.93292 : 9.8 / 0.0005) * period_s_);
      channel(sample, which) = std::clamp(channel(sample, which), -most, most);
    }
    if (how == "glitches" && draw_.chance(fault.other_size)) channel(sample, which) += std::round(fault.size);
    if (how == "lost samples" && draw_.chance(fault.other_size)) return;
    if (how == "lost, hidden" && draw_.chance(fault.other_size)) {
      --counter_shift_;
      return;
    }
    if (how == "another unit") {
      Draw other(std::uint64_t(fault.size));
      std::array<double, 6> exact;
      for (std::size_t i = 0; i < 6; ++i) {
        const double scale = other.uniform(-1.0, 1.0) * (i < 3 ? 3e-4 : 0.03), bias = other.uniform(-1.0, 1.0);
        exact[i] = channel(sample, i) * (1.0 + scale) + bias * (i < 3 ? 4e-4 : 0.4);
      }
      count(state, sample, exact);
    }
    if (how == "sample rate") {
      // Of each sample's time so many of its own.
      const double from = state.phase;
      state.phase += fault.size;
      const std::size_t before = out.size();
      double left = 1.0;
      for (double next = std::floor(from) + 1.0; next <= state.phase; next += 1.0) {
        const double share = (next - std::max(from, next - 1.0)) / fault.size;
        left -= share;
        ImuSample part = sample;
        std::array<double, 6> exact;
        for (std::size_t i = 0; i < 6; ++i) exact[i] = share * channel(sample, i);
        count(state, part, exact);
        out.push_back(part);
      }
      for (std::size_t i = 0; i < 6; ++i) state.exact[i] += left * channel(sample, i);
      const auto made = std::int64_t(out.size() - before);
      counter_shift_ += made - 1;
      for (std::int64_t k = 0; k < made; ++k) out[before + std::size_t(k)].counter += k - (made - 1);
      return;
    }
    out.push_back(sample);
  }

  const std::vector<Fault>& faults_;
  double period_s_;
  Draw draw_;
  std::array<State, 2> state_;
  std::int64_t counter_shift_ = 0;
};

}  // namespace turncal
