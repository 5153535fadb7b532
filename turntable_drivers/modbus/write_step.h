// What is written to a drive, as a register map says it: steps 'ADDRESS TYPE VALUE', 'ADDRESS TYPE VALUE + TYPE VALUE ...' (one request
// of consecutive registers) or 'wait SECONDS'. `table` in front of an address: it is a register of the whole table, to which no
// address_offset of an axis is added.
//
// VALUE is a number, or what a move asks for: position, distance, rate, acceleration; with .heading .pitch .roll that of one axis,
// whichever the list is written for; `axis` is the number by which the table calls the axis (axis.NAME.code).
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "turntable_drivers/modbus/register_words.h"

namespace turncal {

// One number of a write.
struct WriteOperand {
  enum class Kind { constant, axis, position, distance, rate, acceleration };
  Kind kind = Kind::constant;
  WordType type = WordType::u16;
  double constant = 0.0;
  std::optional<Axis> of_axis;  // empty: of the axis that is written to
  bool operator==(const WriteOperand&) const = default;
};

// One request (operands at consecutive addresses), or a pause.
struct WriteStep {
  int address = 0;
  bool of_table = false;  // no axis offset
  std::vector<WriteOperand> operands;
  double wait_s = 0.0;  // a pause when there are no operands
  int length() const;   // registers
  bool operator==(const WriteStep&) const = default;
};
using WriteList = std::vector<WriteStep>;

inline constexpr int longest_block = 120;       // registers of one request; the protocol ends at 125
inline constexpr double longest_pause_s = 1.0;  // a stop cuts it short

// Empty: not a step.
std::optional<WriteStep> parse_write_step(std::string_view text);

// Decimal, or hexadecimal with 0x; empty: neither.
std::optional<long> whole_number(std::string_view text);

}  // namespace turncal
