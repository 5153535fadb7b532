// The numbers of a move as the program has them: what a register map or a dialect makes registers or a sentence of.
#pragma once

#include <array>

namespace turncal {

struct MoveNumbers {
  double position_deg = 0.0, distance_deg = 0.0, rate_degps = 1.0, acceleration_degps2 = 1.0;
};
using Moves = std::array<MoveNumbers, 3>;  // by Axis

}  // namespace turncal
