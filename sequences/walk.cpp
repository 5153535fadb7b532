#include "sequences/walk.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace turncal {
namespace {

constexpr std::size_t legs_a_step = 8;
constexpr std::array<const char*, 3> letters{"H", "P", "R"};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

std::string turn(const Leg& leg, double usual_rate_degps) {
  std::string text = std::string("  rotate ") + letters[static_cast<std::size_t>(leg.axis)] +
                     (leg.turn_deg > 0.0 ? " +" : " ") + number(leg.turn_deg);
  if (leg.rate_degps != usual_rate_degps) text += " rate " + number(leg.rate_degps);
  return text + "\n";
}

}  // namespace

std::string sequence_text(const Walk& walk, const WalkHeader& header) {
  std::string text;
  for (const std::string& comment : header.comments) text += "# " + comment + "\n";
  text += "format = 1\nname = " + header.name + "\nrate_degps = " + number(header.rate_degps) +
          "\nacceleration_degps2 = " + number(header.acceleration_degps2) + "\n";
  AxisTriple at = walk.start_deg;
  for (std::size_t first = 0; first == 0 || first < walk.legs.size(); first += legs_a_step) {
    const std::size_t end = std::min(first + legs_a_step, walk.legs.size());
    text += "\nstep " + std::to_string(first / legs_a_step + 1) + " \"legs " + std::to_string(first + 1) + " to " +
            std::to_string(end) + "\"\n  initial";
    for (const Axis axis : {Axis::heading, Axis::pitch, Axis::roll})
      text += std::string(" ") + letters[static_cast<std::size_t>(axis)] + " " + number(at[axis]);
    text += "\n";
    if (first == 0) text += "  align " + std::to_string(walk.first_rest_samples) + "\n";
    for (std::size_t k = first; k < end; ++k) {
      const Leg& leg = walk.legs[k];
      text += turn(leg, header.rate_degps);
      if (leg.rest_samples > 0) text += "  dwell " + std::to_string(leg.rest_samples) + "\n";
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

}  // namespace turncal
