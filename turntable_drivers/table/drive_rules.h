// What the drivers of real tables refuse and say alike. A refusal is the reason, for the error of an axis; none: it may.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>

#include "turntable_drivers/table/turntable.h"

namespace turncal {

inline constexpr double stop_ack_s =
    0.025;  // awaited by a stop; three axes: within 100 ms of the request with all else

std::string degrees(double value);  // "12.5 deg", rounded to 0.0001

// A move's numbers, before anything is asked of the device.
std::optional<std::string> refusal_of_move(double position_deg, double rate_degps, double acceleration_degps2,
                                           double plausible_deg, double plausible_rate_degps);
// An axis that is to be homed or moved: a fault, a motion, a drive that is off.
std::optional<std::string> refusal_of_state(const AxisStatus& now);
// A move that was not acknowledged is never sent again blindly: the error says what the axis was seen to do.
Error with_state(const Error& error, const Result<AxisStatus>& after);

// Angles of devices that know a circle only.
// Which of angle_deg + n turns lies nearest to near_deg: how a cumulative position is kept.
inline double unwrapped_deg(double angle_deg, double near_deg, double turn_deg) {
  return angle_deg + turn_deg * std::round((near_deg - angle_deg) / turn_deg);
}

// The numbers of a move as the program has them: what a register map or a dialect makes registers or a sentence of.
struct MoveNumbers {
  double position_deg = 0.0, distance_deg = 0.0, rate_degps = 1.0, acceleration_degps2 = 1.0;
};
using Moves = std::array<MoveNumbers, 3>;  // by Axis

}  // namespace turncal
