#include "sequences/walk.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr std::size_t legs_a_step = 8;
constexpr std::array<const char*, 3> letters{"H", "P", "R"};

std::string turn(const Leg& leg, double usual_rate_degps) {
  return fmt::format("  rotate {} {}{:.9g}{}\n", letters[index(leg.axis)], leg.turn_deg > 0.0 ? "+" : "", leg.turn_deg,
                     leg.rate_degps != usual_rate_degps ? fmt::format(" rate {:.9g}", leg.rate_degps) : "");
}

}  // namespace

std::string sequence_text(const Walk& walk, const WalkHeader& header) {
  std::string text;
  for (const std::string& comment : header.comments) text += "# " + comment + "\n";
  text += fmt::format("format = 1\nname = {}\nrate_degps = {:.9g}\nacceleration_degps2 = {:.9g}\n", header.name,
                      header.rate_degps, header.acceleration_degps2);
  AxisTriple at = walk.start_deg;
  for (std::size_t first = 0; first == 0 || first < walk.legs.size(); first += legs_a_step) {
    const std::size_t end = std::min(first + legs_a_step, walk.legs.size());
    text += fmt::format("\nstep {} \"legs {} to {}\"\n  initial", first / legs_a_step + 1, first + 1, end);
    for (const Axis axis : all_axes) text += fmt::format(" {} {:.9g}", letters[index(axis)], at[axis]);
    text += "\n";
    if (first == 0) text += fmt::format("  align {}\n", walk.first_rest_samples);
    for (std::size_t k = first; k < end; ++k) {
      const Leg& leg = walk.legs[k];
      text += turn(leg, header.rate_degps);
      if (leg.rest_samples > 0) text += fmt::format("  dwell {}\n", leg.rest_samples);
      at[leg.axis] += leg.turn_deg;
    }
  }
  return text;
}

Walk walk_of(const Sequence& sequence) {
  Walk walk;
  walk.start_deg = sequence.start_deg;
  AxisTriple at = sequence.start_deg;
  for (const Step& step : sequence.steps)
    for (const SequenceItem& item : step.items) {
      if (item.kind == SequenceItem::Kind::dwell) {
        (walk.legs.empty() ? walk.first_rest_samples : walk.legs.back().rest_samples) += item.dwell.samples;
        continue;
      }
      const Move& move = item.move;
      walk.legs.push_back({move.axis, move.target_deg - at[move.axis], move.rate_degps, 0});
      at[move.axis] = move.target_deg;
    }
  return walk;
}

Travel travel_of(const AxisLimits& limits) {
  Travel travel{std::ceil(limits.soft_min_deg), std::floor(limits.soft_max_deg), 0.0};
  if (travel.low_deg > travel.high_deg) travel.low_deg = travel.high_deg = limits.soft_min_deg;
  travel.longest_turn_deg = travel.high_deg - travel.low_deg;
  if (limits.wrap_deg > 0.0) travel.longest_turn_deg = std::min(travel.longest_turn_deg, std::floor(limits.wrap_deg));
  return travel;
}

Walk on_table(const Walk& walk, const PlanLimits& limits) {
  Walk fitted;
  fitted.first_rest_samples = walk.first_rest_samples;
  std::array<Travel, 3> free{};  // the range left by the travel and, after the turns so far, by the cable
  const auto stands = [&](Axis axis, double deg) {
    const double wrap_deg = limits[axis].wrap_deg;
    Travel& travel = free[index(axis)];
    if (wrap_deg <= 0.0) return;
    travel.low_deg = std::max(travel.low_deg, deg - wrap_deg);
    travel.high_deg = std::min(travel.high_deg, deg + wrap_deg);
  };
  for (const Axis axis : all_axes) {
    const Travel travel = free[index(axis)] = travel_of(limits[axis]);
    double deg = walk.start_deg[axis];
    if (deg > travel.high_deg) deg -= 360.0 * std::ceil((deg - travel.high_deg) / 360.0);
    if (deg < travel.low_deg) deg += 360.0 * std::ceil((travel.low_deg - deg) / 360.0);
    if (deg > travel.high_deg)  // between two turns of the travel: the nearer end
      deg = deg - travel.high_deg < travel.low_deg - (deg - 360.0) ? travel.high_deg : travel.low_deg;
    fitted.start_deg[axis] = deg;
    stands(axis, fitted.start_deg[axis]);
  }
  AxisTriple at = fitted.start_deg;
  for (Leg leg : walk.legs) {
    const Travel& travel = free[index(leg.axis)];
    double& deg = at[leg.axis];
    const double up = std::floor(travel.high_deg - deg), down = std::floor(deg - travel.low_deg);
    const double size = std::abs(leg.turn_deg);
    if (leg.turn_deg > 0.0 ? size > up : size > down) {
      const bool other_way = leg.turn_deg > 0.0 ? size <= down : size <= up;
      leg.turn_deg = other_way ? -leg.turn_deg : up >= down ? up : -down;
    }
    if (leg.turn_deg == 0.0) continue;
    leg.rate_degps = std::min(leg.rate_degps, limits[leg.axis].max_rate_degps);
    deg += leg.turn_deg;
    stands(leg.axis, deg);
    fitted.legs.push_back(leg);
  }
  return fitted;
}

}  // namespace turncal
