#include "orchestrator/jobs/design/settling.h"

#include <algorithm>

#include "calib/model/limits.h"
#include "orchestrator/jobs/design/sequence_design.h"
#include "orchestrator/watch/progress.h"
#include "sequences/walk.h"

namespace turncal {

namespace {

constexpr int settling_tries = 300;
constexpr double usual_acceleration_degps2 = 20.0;
constexpr double from_pose_to_pose_s = 60.0;  // the way to the start of the legs, at most, as a first guess

// Where the cable still lets every axis go: it counts what the plan has turned.
PlanLimits within_cable(PlanLimits limits, const Plan& plan) {
  for (const Axis axis : all_axes) {
    AxisLimits& of = limits.axis[static_cast<std::size_t>(axis)];
    if (of.wrap_deg <= 0.0) continue;
    of.soft_min_deg = std::max(of.soft_min_deg, plan.travel_max_deg[axis] - of.wrap_deg);
    of.soft_max_deg = std::min(of.soft_max_deg, plan.travel_min_deg[axis] + of.wrap_deg);
  }
  return limits;
}

// What the legs add to the plan. Nothing: the table may not run both.
std::optional<double> added_s(const SettlingTask& task, const std::string& text) {
  const Result<Sequence> legs = parse_sequence(text, "settling");
  if (!legs) return std::nullopt;
  Sequence both = task.sequence;
  append_steps(*legs, both);
  const Plan plan = make_plan(both, task.limits);
  return plan.ok() ? std::optional(plan.station_s - task.plan.station_s) : std::nullopt;
}

}  // namespace

std::optional<Settling> find_settling(const SettlingTask& task) {
  DiagnosisOptions options;
  options.base = &task.base;
  Diagnosis diagnosis = diagnose(task.recording, options);
  const std::optional<Doubt> doubt = doubt_of(diagnosis);
  if (!doubt) return std::nullopt;
  diagnosis.aliases[doubt->name] = doubt->others;
  Settling found;
  found.doubt = words_of(*doubt);
  found.why_not = "no motion of this table in " + format_duration(task.left_s) + " was found that tells them apart";
  const Separation separation(task.recording, diagnosis, doubt->name);
  DesignTask design;
  design.limits = within_cable(task.limits, task.plan);
  design.info = task.recording.info;
  design.rates_degps = {10.0, 20.0, 40.0};
  design.acceleration_degps2 = usual_acceleration_degps2;
  for (const AxisLimits& axis : design.limits.axis)
    design.acceleration_degps2 = std::min(design.acceleration_degps2, axis.max_acceleration_degps2);
  design.tries = settling_tries;
  design.start = on_table(walk_of(task.sequence), design.limits);
  for (double way_s = from_pose_to_pose_s; way_s < task.left_s; way_s *= 2.0) {
    design.time_s = task.left_s - way_s;
    const Result<ExtraLegs> legs = find_extra_legs(separation, design, [](double) {});
    if (!legs || legs->after.empty()) return found;
    const double least = std::ranges::min(legs->after, {}, &AliasPair::gain).gain;
    if (least < SelectionLimits{}.bic_margin) return found;
    WalkHeader header;
    header.name = "settling";
    header.comments = {"to tell apart: " + found.doubt};
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
