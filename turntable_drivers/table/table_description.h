// What a register map and a dialect alike say of a table.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/key_value.h"
#include "imu_io/base/line_source.h"

namespace turncal {

struct TableDescription {
  std::string file;
  std::string name;
  bool verified_on_hardware = false;
  bool simulated = false;               // a twin answers; not a key of the file: the station says it
  bool commissioned = false;            // scale, sign and order were checked against a known angle; else no motion
  bool can_switch_off = true;           // abort does
  double moving_rate_degps = 0.01;      // of an axis that does not tell: faster than this is moving
  double plausible_deg = 7200.0;        // a position beyond this is not believed
  double plausible_rate_degps = 400.0;  // nor is one that the axis cannot have reached since the last
  std::vector<LineSource> lines;        // of the file: where each comes from
};

// Whether a line says what moves an axis, stops it, or tells that it is on, has arrived or is at fault.
bool decides_motion(std::string_view key);

// Beyond these no table is: a number outside is a slip of the pen.
inline constexpr NumberRange scale_range{1e-6, 1e9};        // counts or units for a degree, a deg/s, a deg/s^2
inline constexpr NumberRange link_wait_range{0.001, 60.0};  // seconds

void read_table_description(KeyValueFile& file, TableDescription& description);

// A circle of the device's positions; 0: it counts turns.
double circle_deg(KeyValueFile& file, const std::string& key);

}  // namespace turncal
