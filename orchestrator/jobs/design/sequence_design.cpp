#include "orchestrator/jobs/design/sequence_design.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>

#include "calib/prediction/design_bound.h"
#include "imu_io/base/text.h"
#include "orchestrator/jobs/preflight.h"
#include "orchestrator/station/number_text.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

constexpr double judged_period_s = 0.05;
constexpr double excess_weight = 60.0;
constexpr double undetermined_cost = 10.0;
constexpr double first_threshold = 0.02;  // increase of cost accepted at the beginning of the search
constexpr int most_share = 12;
constexpr double pose_step_deg = 30.0;  // between the poses of the bound
constexpr std::array<double, 7> turns_deg{90.0, 180.0, 360.0, 45.0, 135.0, 270.0, 30.0};

std::vector<Axis> axes_of(const DesignTask& task) {
  std::vector<Axis> axes;
  for (const Axis axis : all_axes)
    if (task.turns[index(axis)] && travel_of(task.limits[axis]).longest_turn_deg > 0.0) axes.push_back(axis);
  return axes;
}

double rate_on(const DesignTask& task, Axis axis, double rate_degps) {
  return std::min(rate_degps, task.limits[axis].max_rate_degps);
}

// Changes walks whose rests are not times but shares of the time that the turns leave. timed() gives them samples.
class Search {
 public:
  explicit Search(const DesignTask& task) : task_(task), random_(task.seed), axes_(axes_of(task)) {}

  Result<Design> run(const std::function<bool(const DesignProgress&)>& progress) {
    if (axes_.empty()) return input_error("no axis may turn by a degree: expected at least one that may");
    Walk now = begin();
    std::optional<double> cost = judge(now);
    while (!cost && !now.legs.empty()) {  // too long: drops legs
      now.legs.pop_back();
      cost = judge(now);
    }
    const double least_deg = *std::ranges::min_element(turns_deg);
    for (std::size_t k = 0; !cost && k < axes_.size(); ++k) {
      now.legs = {leg_of(axes_[k], least_deg, *std::ranges::max_element(task_.rates_degps), 1)};
      now.first_rest_samples = 1;
      if (now.start_deg[axes_[k]] + now.legs[0].turn_deg > travel_of(task_.limits[axes_[k]]).high_deg)
        now.legs[0].turn_deg *= -1.0;
      cost = judge(now);
    }
    if (!cost)
      return input_error("not even one turn of " + format_number(least_deg) + " deg with rests of " +
                         format_number(task_.least_rest_s) + " s before and after it fits into " +
                         format_number(task_.time_s) + " s");
    Design design;
    design.start_cost = *cost;
    Walk best = now;
    double best_cost = *cost;
    for (int i = 0; i < task_.tries && !(task_.judged_by && best_cost <= 0.0); ++i) {
      Walk other = changed(now);
      const std::optional<double> other_cost = judge(other);
      if (!other_cost) continue;
      const double left = 1.0 - double(i) / (0.7 * task_.tries);
      if (*other_cost < *cost + first_threshold * std::max(0.0, left)) {
        now = std::move(other);
        cost = other_cost;
      }
      if (*cost < best_cost) {
        best = now;
        best_cost = *cost;
      }
      if (!progress({i + 1, task_.tries, best_cost, best.legs.size()})) break;
    }
    design.walk = *timed(best, task_.info.sample_period_s);
    design.cost = best_cost;
    return design;
  }

 private:
  std::size_t below(std::size_t n) { return std::size_t(random_() % n); }

  // Returns the first walk: rests in units of its shortest, rates among the choices.
  Walk begin() const {
    std::int64_t shortest = std::max<std::int64_t>(1, task_.start.first_rest_samples);
    for (const Leg& leg : task_.start.legs)
      if (leg.rest_samples > 0) shortest = std::min(shortest, leg.rest_samples);
    const auto share = [&](std::int64_t samples) {
      return std::min<std::int64_t>((samples + shortest / 2) / shortest, most_share);
    };
    Walk walk;
    walk.start_deg = task_.start.start_deg;
    walk.first_rest_samples = share(task_.start.first_rest_samples);
    for (const Leg& leg : task_.start.legs) {
      if (std::ranges::find(axes_, leg.axis) == axes_.end()) continue;
      const bool offered = std::ranges::find(task_.rates_degps, leg.rate_degps) != task_.rates_degps.end();
      const std::int64_t least = !walk.legs.empty() && walk.legs.back().rest_samples == 0 ? 1 : 0;
      walk.legs.push_back({leg.axis, leg.turn_deg,
                           offered ? leg.rate_degps : rate_on(task_, leg.axis, task_.rates_degps.front()),
                           std::max(least, share(leg.rest_samples))});
    }
    return walk;
  }

  Leg any_leg() {
    const double size_deg = turns_deg[below(turns_deg.size())];
    const Axis axis = axes_[below(axes_.size())];
    const double turn_deg = below(2) == 0 ? size_deg : -size_deg;
    const double rate_degps = task_.rates_degps[below(task_.rates_degps.size())];
    return leg_of(axis, turn_deg, rate_degps, 1 + int(below(3)));
  }

  // Limits turn and rate to those of the axis.
  Leg leg_of(Axis axis, double turn_deg, double rate_degps, int share) const {
    const double most_deg = travel_of(task_.limits[axis]).longest_turn_deg;
    return {axis, std::clamp(turn_deg, -most_deg, most_deg), rate_on(task_, axis, rate_degps), share};
  }

  Walk changed(Walk walk) {
    std::vector<Leg>& legs = walk.legs;
    const std::size_t n = legs.size();
    const auto at = [&](std::size_t k) { return legs.begin() + std::ptrdiff_t(k); };
    switch (n == 0 ? 1 : below(8)) {
      case 0: legs[below(n)] = any_leg(); break;
      case 1: legs.insert(at(below(n + 1)), any_leg()); break;
      case 2: legs.erase(at(below(n))); break;
      case 3: std::swap(legs[below(n)], legs[below(n)]); break;
      case 4: legs[below(n)].turn_deg *= -1.0; break;
      case 5: {  // there and back
        const Leg leg = any_leg();
        Leg back = leg;
        back.turn_deg *= -1.0;
        const std::size_t k = below(n + 1);
        legs.insert(at(k), {leg, back});
        break;
      }
      case 6: {  // reverses the order of a run of legs
        const std::size_t first = below(n), last = first + below(std::min<std::size_t>(n - first, 6));
        std::reverse(at(first), at(last + 1));
        break;
      }
      default: {
        std::int64_t& share = below(n + 1) == 0 ? walk.first_rest_samples : legs[below(n)].rest_samples;
        const std::int64_t other = below(2) == 0 ? share + 1 + int(below(4)) : share - 1 - int(below(2));
        share = std::clamp<std::int64_t>(other, 0, most_share);
      }
    }
    return walk;
  }

  // Returns the walk with rests in samples of this period; nothing when the turns leave too little time.
  std::optional<Walk> timed(Walk walk, double period_s) const {
    // Rejects three turns without a rest between them; the bound assumes at most two.
    for (std::size_t k = 1; k < walk.legs.size(); ++k)
      if (walk.legs[k - 1].rest_samples == 0 && walk.legs[k].rest_samples == 0) return std::nullopt;
    double left_s = task_.time_s;
    walk.first_rest_samples = std::max<std::int64_t>(1, walk.first_rest_samples);
    std::int64_t shares = walk.first_rest_samples;
    const double tick_s = std::max(period_s, task_.info.sample_period_s);
    for (const Leg& leg : walk.legs) {
      const double turn_s = move_duration_s(leg.turn_deg, leg.rate_degps, task_.acceleration_degps2);
      left_s -= std::ceil((turn_s + task_.limits.settle_s) / tick_s) * tick_s;
      shares += leg.rest_samples;
    }
    const double unit_s = left_s / double(shares);
    if (!(unit_s >= task_.least_rest_s)) return std::nullopt;
    const auto into_samples = [&](std::int64_t& share) {
      share = std::llround(std::floor(unit_s * double(share)) / period_s);
    };
    into_samples(walk.first_rest_samples);
    for (Leg& leg : walk.legs) into_samples(leg.rest_samples);
    return walk;
  }

  std::optional<double> judge(const Walk& shared) {
    const std::optional<Walk> walk = timed(shared, judged_period_s);
    if (!walk) return std::nullopt;
    const WalkHeader header{"walk", {}, task_.rates_degps.front(), task_.acceleration_degps2};
    const Result<Sequence> sequence = parse_sequence(sequence_text(*walk, header), "walk");
    if (!sequence) return std::nullopt;  // cumulative angles beyond the grammar's limits
    PlanLimits limits = task_.limits;
    limits.sample_period_s = judged_period_s;
    const Plan plan = make_plan(*sequence, limits);
    if (!plan.ok()) return std::nullopt;
    if (task_.judged_by) return task_.judged_by(planned_motion(*sequence, plan), judged_period_s);
    RecordingInfo info = task_.info;
    info.sample_period_s = judged_period_s;
    PredictOptions options = task_.predict;
    options.effects = !task_.effects.empty();
    return cost_of(predict(info, planned_motion(*sequence, plan), options));
  }

  double cost_of(const Prediction& prediction) const {
    double sum = 0.0, worst = -undetermined_cost;
    int n = 0;
    const auto add = [&](double over_aim) {
      sum += over_aim + excess_weight * std::max(0.0, over_aim);
      worst = std::max(worst, over_aim);
      ++n;
    };
    for (int k = 0; k < parameter_count; ++k) {
      if (task_.aim[k] <= 0.0) continue;
      const bool known = prediction.valid && prediction.determined[std::size_t(k)] && prediction.sigma[k] > 0.0;
      add(known ? std::log(prediction.sigma[k] / task_.aim[k]) : undetermined_cost);
    }
    for (std::size_t k = 0; k < prediction.effects.size() && k < task_.effect_aims.size(); ++k) {
      const PredictedEffect& effect = prediction.effects[k];
      if (std::ranges::find(task_.effects, effect.column.entry->name) == task_.effects.end()) continue;
      if (!task_.effect_aims[k].visible && !effect.visible) continue;
      add(effect.visible ? std::log(effect.detectable / task_.effect_aims[k].detectable) : undetermined_cost);
    }
    return task_.criterion == AimAt::worst ? worst : sum / std::max(1, n);
  }

  const DesignTask& task_;
  std::mt19937_64 random_;
  std::vector<Axis> axes_;
};

constexpr double shorter = 0.8;

double cost_of(const std::vector<AliasPair>& pairs) {
  double cost = 0.0;
  for (const AliasPair& pair : pairs) cost += std::max(0.0, std::log(separating_gain / std::max(pair.gain, 1e-9)));
  return cost;
}

constexpr int settling_tries = 1500;
constexpr double from_pose_to_pose_s = 60.0;  // first guess of the time to the start of the legs

// Returns the limits that the cable leaves, given what the plan has turned.
PlanLimits within_cable(PlanLimits limits, const Plan& plan) {
  for (const Axis axis : all_axes) {
    AxisLimits& of = limits.axis[std::size_t(axis)];
    if (of.wrap_deg <= 0.0) continue;
    of.soft_min_deg = std::max(of.soft_min_deg, plan.travel_max_deg[axis] - of.wrap_deg);
    of.soft_max_deg = std::min(of.soft_max_deg, plan.travel_min_deg[axis] + of.wrap_deg);
  }
  return limits;
}

// Returns the time that the legs add to the plan; nothing when the table may not run both.
std::optional<double> added_s(const SettlingTask& task, const std::string& text) {
  const Result<Sequence> legs = parse_sequence(text, "settling");
  if (!legs) return std::nullopt;
  Sequence both = task.sequence;
  append_steps(*legs, both);
  const Plan plan = make_plan(both, task.limits);
  return plan.ok() ? std::optional(plan.station_s - task.plan.station_s) : std::nullopt;
}

}  // namespace

std::optional<double> design_bound(const DesignTask& task) {
  BoundTask bound;
  bound.info = task.info;
  bound.noise = task.predict.noise;
  bound.time_s = task.time_s;
  bound.settle_s = task.limits.settle_s;
  bound.least_rest_s = task.least_rest_s;
  bound.acceleration_degps2 = task.acceleration_degps2;
  bound.aim = task.aim;
  bound.worst = task.criterion == AimAt::worst;
  std::set<double> turns, rates;
  for (const Axis axis : all_axes) bound.poses_deg[index(axis)] = {task.start.start_deg[axis]};
  for (const Axis axis : axes_of(task)) {
    const Travel travel = travel_of(task.limits[axis]);
    std::vector<double>& poses = bound.poses_deg[index(axis)];
    const double start_deg = poses.front();
    const auto add = [&](double deg) {
      const double lowest = deg - 360.0 * std::floor((deg - travel.low_deg) / 360.0);
      if (lowest <= travel.high_deg) poses.push_back(deg);
    };
    for (double deg = start_deg + pose_step_deg; deg < start_deg + 360.0; deg += pose_step_deg) add(deg);
    if (travel.longest_turn_deg < pose_step_deg)
      for (const double deg : {start_deg - travel.longest_turn_deg, start_deg + travel.longest_turn_deg}) add(deg);
    for (const double size_deg : turns_deg) turns.insert(std::min(size_deg, travel.longest_turn_deg));
    for (const double rate : task.rates_degps) rates.insert(rate_on(task, axis, rate));
  }
  for (const Leg& leg : task.start.legs)
    if (leg.turn_deg != 0.0) turns.insert(std::abs(leg.turn_deg));
  bound.turns_deg.assign(turns.begin(), turns.end());
  bound.rates_degps.assign(rates.begin(), rates.end());
  return least_log_sigma(bound);
}

Result<Design> design_walk(const DesignTask& task, const std::function<bool(const DesignProgress&)>& progress) {
  return Search(task).run(progress);
}

Result<ExtraLegs> find_extra_legs(const Separation* separation, DesignTask task,
                                  const std::function<void(double time_s)>& looking) {
  ExtraLegs legs;
  double best = std::numeric_limits<double>::infinity();
  task.judged_by = [&, further = task.judged_by](const PlannedMotion& motion, double period_s) {
    const auto pairs = separation ? separation->pairs(&motion, period_s) : std::vector<AliasPair>{};
    const double left = further ? further(motion, period_s) : 0.0, cost = cost_of(pairs) + left;
    if (cost < best || cost <= 0.0) legs.after = pairs, legs.further = left, best = cost;
    return cost;
  };
  for (; task.time_s >= least_settling_s; task.time_s *= shorter) {
    looking(task.time_s);
    const Result<Design> design = design_walk(task, [](const DesignProgress&) { return true; });
    if (!design && !legs.apart) return design.error();
    const bool apart = design.ok() && design->cost <= 0.0;
    if (apart || !legs.apart) {
      legs.walk = design->walk;
      legs.time_s = task.time_s;
    }
    if (!apart) break;
    legs.apart = true;
    task.start = design->walk;
  }
  return legs;
}

std::string words_of(const NeededSigma& one) {
  return parameter_key(one.parameter) + ", " + significant(one.sigma, 3) + " where " + significant(one.needed, 3) +
         " is enough";
}

std::optional<Settling> find_settling(const SettlingTask& task) {
  Diagnosis diagnosis = diagnose(task.recording, {.estimate = {}, .base = &task.base});
  const std::optional<Doubt> doubt = doubt_of(diagnosis);
  std::vector<NeededSigma> needed = task.needed;
  std::erase_if(needed, [](const NeededSigma& one) { return one.ratio() <= 1.0 || one.needed == 0.0; });
  if (!doubt && needed.empty()) return std::nullopt;
  Settling found;
  found.why_not = "no motion of this table in " + format_duration(task.left_s) + " was found that settles it";
  std::optional<Separation> separation;
  if (doubt) {
    found.doubt = words_of(*doubt);
    diagnosis.aliases[doubt->name] = doubt->others;
    separation.emplace(task.recording, diagnosis, doubt->name, true);
  }
  DesignTask design;
  if (!needed.empty()) {
    found.doubt += (doubt ? ", and " : "") + words_of(*std::ranges::max_element(needed, {}, &NeededSigma::ratio));
    design.judged_by = [&](const PlannedMotion& motion, double period_s) {
      RecordingInfo info = task.recording.info;
      info.sample_period_s = period_s;
      const ParameterVector shrunk = shrunk_by(motion, task.base, info);
      double cost = 0.0;
      for (const NeededSigma& one : needed)
        cost += std::max(0.0, std::log(one.ratio() * shrunk[Eigen::Index(one.parameter)]));
      return cost;
    };
  }
  design.limits = within_cable(task.limits, task.plan);
  design.info = task.recording.info;
  design.rates_degps = {10.0, 20.0, 40.0};
  for (const AxisLimits& axis : design.limits.axis)
    design.acceleration_degps2 = std::min(design.acceleration_degps2, axis.max_acceleration_degps2);
  design.tries = settling_tries;
  design.start = on_table(walk_of(task.sequence), design.limits);
  for (double way_s = from_pose_to_pose_s; way_s < task.left_s; way_s *= 2.0) {
    design.time_s = task.left_s - way_s;
    const Result<ExtraLegs> legs = find_extra_legs(separation ? &*separation : nullptr, design, [](double) {});
    if (!legs) return found;
    const double gain = legs->after.empty() ? 0.0 : std::ranges::min(legs->after, {}, &AliasPair::gain).gain;
    if (chance_to_tell(gain) < worth_a_try && (needed.empty() || legs->further > 0.0)) {
      if (doubt) found.why_not += ": 2 ln L " + significant(gain, 2) + " is expected, and 10 tells";
      return found;
    }
    WalkHeader header{.name = "settling", .comments = {"to settle: " + found.doubt}};
    header.rate_degps =
        std::min(10.0, std::ranges::min(design.limits.axis, {}, &AxisLimits::max_rate_degps).max_rate_degps);
    header.acceleration_degps2 = design.acceleration_degps2;
    const std::string text = sequence_text(legs->walk, header);
    const std::optional<double> s = added_s(task, text);
    if (!s) return found;
    if (*s > task.left_s) continue;
    found.why_not.clear();
    found.sequence = text;
    found.added_s = *s;
    return found;
  }
  return found;
}

}  // namespace turncal
