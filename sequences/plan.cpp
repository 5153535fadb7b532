#include "sequences/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {

namespace {

// Rounding must not make a duration of whole samples one sample longer.
constexpr double sample_slack = 1e-6;

constexpr double shortest_dwell_s = 1.0;

std::int64_t whole_samples(double duration_s, double period_s) {
  return std::int64_t(std::ceil(duration_s / period_s - sample_slack));
}

// Formats a number for messages, with at most six decimals.
std::string text_of(double value) { return format_number(std::round(value * 1e6) / 1e6 + 0.0); }

// Walks through the items with the commanded angles and the sample counter.
class Planner {
 public:
  Planner(const Sequence& sequence, const PlanLimits& limits)
      : sequence_(sequence), limits_(limits), commanded_deg_(sequence.start_deg) {}

  Plan run() {
    plan_.travel_min_deg = plan_.travel_max_deg = commanded_deg_;
    if (!sequence_.steps.empty()) {
      const Step& first = sequence_.steps.front();
      for (const Axis axis : all_axes) check_position(first.line, first, axis, commanded_deg_[axis]);
    }
    for (std::size_t s = 0; s < sequence_.steps.size(); ++s)
      for (std::size_t i = 0; i < sequence_.steps[s].items.size(); ++i) add_item(s, i);
    for (const Axis axis : all_axes)
      plan_.wrap_used_deg[axis] = plan_.travel_max_deg[axis] - plan_.travel_min_deg[axis];
    plan_.station_s = seconds(plan_.samples);
    plan_.moving_s = seconds(moving_samples_);
    for (const Cause& cause : causes_)
      plan_.violations.push_back(cause.where + cause.what +
                                 (cause.further > 0 ? fmt::format(" (and {} more)", cause.further) : ""));
    return std::move(plan_);
  }

 private:
  struct Cause {
    std::string where, what;
    int further = 0;
  };

  // One line per cause: the same axis going to the same place in forty moves is one.
  void refuse(int line, const Step& step, const std::string& what) {
    const auto known = std::ranges::find_if(causes_, [&](const Cause& c) { return c.what == what; });
    const std::string& file = step.file.empty() ? sequence_.file : step.file;
    if (known != causes_.end())
      ++known->further;
    else
      causes_.push_back({fmt::format("{}:{}: step {}: ", file, line, step.number), what});
  }

  double seconds(std::int64_t samples) const { return double(samples) * limits_.sample_period_s; }

  void add_item(std::size_t step_index, std::size_t item_index) {
    const Step& step = sequence_.steps[step_index];
    const SequenceItem& item = step.items[item_index];
    PlannedItem planned;
    planned.kind = item.kind;
    planned.step_index = step_index;
    planned.item_index = item_index;
    planned.step = step.number;
    planned.line = item.line;
    planned.start_sample = plan_.samples;
    if (item.kind == SequenceItem::Kind::move)
      plan_move(step, item, planned);
    else
      plan_dwell(step, item, planned);
    planned.commanded_deg = commanded_deg_;
    planned.start_s = seconds(planned.start_sample);
    planned.duration_s = seconds(planned.samples);
    plan_.samples += planned.samples;
    plan_.items.push_back(planned);
  }

  void plan_move(const Step& step, const SequenceItem& item, PlannedItem& planned) {
    const Move& move = item.move;
    const Axis axis = move.axis;
    planned.axis = axis;
    planned.from_deg = commanded_deg_[axis];
    planned.to_deg = move.target_deg;
    planned.rate_degps = move.rate_degps;
    planned.acceleration_degps2 = move.acceleration_degps2;
    planned.positioning = item.positioning;
    const double angle_deg = planned.to_deg - planned.from_deg;
    planned.samples =
        whole_samples(move_duration_s(angle_deg, move.rate_degps, move.acceleration_degps2) + limits_.settle_s,
                      limits_.sample_period_s);
    moving_samples_ += planned.samples;
    ++plan_.moves;
    commanded_deg_[axis] = planned.to_deg;
    plan_.travel_min_deg[axis] = std::min(plan_.travel_min_deg[axis], planned.to_deg);
    plan_.travel_max_deg[axis] = std::max(plan_.travel_max_deg[axis], planned.to_deg);
    plan_.turned_deg[axis] += std::abs(angle_deg);
    check_position(planned.line, step, axis, planned.to_deg);
    check_dynamics(step, planned);
    check_wrap(step, planned);
  }

  void plan_dwell(const Step& step, const SequenceItem& item, PlannedItem& planned) {
    planned.dwell_kind = item.dwell.kind;
    planned.samples = item.dwell.samples;
    ++(item.dwell.kind == SegmentKind::align ? plan_.align_dwells : plan_.still_dwells);
    if (seconds(item.dwell.samples) < shortest_dwell_s - sample_slack)
      refuse(planned.line, step,
             fmt::format("a dwell of {} samples takes {} s, the shortest that counts is 1 s", item.dwell.samples,
                         text_of(seconds(item.dwell.samples))));
  }

  void check_position(int line, const Step& step, Axis axis, double position_deg) {
    const AxisLimits& limit = limits_[axis];
    if (position_deg < limit.soft_min_deg || position_deg > limit.soft_max_deg)
      refuse(line, step,
             fmt::format("{} goes to {} deg, soft travel is {} to {} deg", to_string(axis), text_of(position_deg),
                         text_of(limit.soft_min_deg), text_of(limit.soft_max_deg)));
  }

  void check_dynamics(const Step& step, const PlannedItem& move) {
    const AxisLimits& limit = limits_[move.axis];
    const auto check = [&](const char* how, double value, double most, const char* unit) {
      if (value > most)
        refuse(move.line, step,
               fmt::format("{} {} {} {}, the most allowed is {} {}", to_string(move.axis), how, text_of(value), unit,
                           text_of(most), unit));
    };
    check("turns at", move.rate_degps, limit.max_rate_degps, "deg/s");
    check("accelerates with", move.acceleration_degps2, limit.max_acceleration_degps2, "deg/s^2");
  }

  void check_wrap(const Step& step, const PlannedItem& move) {
    const double allowed_deg = limits_[move.axis].wrap_deg;
    const double wound_deg = plan_.travel_max_deg[move.axis] - plan_.travel_min_deg[move.axis];
    bool& warned = wrap_warned_[index(move.axis)];
    if (allowed_deg <= 0.0 || wound_deg <= allowed_deg || warned) return;
    warned = true;
    refuse(move.line, step,
           fmt::format("{} has wound its cable by {} deg, the most allowed is {} deg", to_string(move.axis),
                       text_of(wound_deg), text_of(allowed_deg)));
  }

  const Sequence& sequence_;
  const PlanLimits& limits_;
  Plan plan_;
  std::vector<Cause> causes_;
  AxisTriple commanded_deg_;
  std::int64_t moving_samples_ = 0;
  std::array<bool, 3> wrap_warned_{};
};

}  // namespace

double move_duration_s(double angle_deg, double rate_degps, double acceleration_degps2) {
  assert(rate_degps > 0.0 && acceleration_degps2 > 0.0);
  const double angle = std::abs(angle_deg);
  if (angle < rate_degps * rate_degps / acceleration_degps2) return 2.0 * std::sqrt(angle / acceleration_degps2);
  return angle / rate_degps + rate_degps / acceleration_degps2;
}

Plan make_plan(const Sequence& sequence, const PlanLimits& limits) {
  assert(limits.sample_period_s > 0.0);
  return Planner(sequence, limits).run();
}

Segments planned_segments(const Plan& plan) {
  Segments segments;
  segments.reserve(plan.items.size());
  for (const PlannedItem& item : plan.items)
    segments.push_back({item.step, item.kind == SequenceItem::Kind::move ? SegmentKind::rotate : item.dwell_kind,
                        item.start_sample, item.start_sample + item.samples, item.commanded_deg[Axis::heading],
                        item.commanded_deg[Axis::pitch], item.commanded_deg[Axis::roll]});
  return segments;
}

}  // namespace turncal
