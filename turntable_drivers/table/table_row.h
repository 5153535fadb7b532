// What a described table is sent and answers, as rows that somebody holds against its manual. explain() of a register map
// (turntable_drivers/modbus/explain_map.h) and of a dialect (turntable_drivers/ascii/explain_dialect.h) makes them: what the drivers send,
// in the order in which it is sent.
#pragma once

#include <string>
#include <vector>

#include "turntable_drivers/table/move_numbers.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

struct TableRow {
  std::string operation;  // connect, enable, home, move, stop, abort, status, fault reset, heartbeat
  std::string axis;       // or table
  std::string sent;       // registers, or a sentence; of a status what is read
  std::string says;       // numbers with their scale, bits with mask and polarity
  std::string answer;     // what is expected
  std::string source;     // line and mark
};

// The move that the rows show: an axis from 0 to 90 deg at 10 deg/s and 20 deg/s^2.
inline constexpr MoveNumbers shown_move{90.0, 90.0, 10.0, 20.0};

// "line 12 [manual]"; empty: the file has no such line.
std::string source_of(const TableDescription& table, const std::string& key);
// In columns, a line each, under one line of headings.
std::string format_rows(const std::vector<TableRow>& rows);

}  // namespace turncal
