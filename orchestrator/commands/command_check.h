// `turncal check`: validates station and sequence before anything moves, and prints the plan.
//
// Exit code 0 and the plan on `out` when the station may run the sequence; 1 and one line for each problem on `err`
// otherwise (the plan is printed too when both files could be read). Nothing is written, opened or moved.
#pragma once

#include <ostream>
#include <string>

#include "orchestrator/station/station_config.h"
#include "sequences/plan.h"

namespace turncal {

struct CheckOptions {
  std::string station;   // file; empty: the built-in rig station
  std::string sequence;  // file
  std::string overdue_reason = {};
  std::string out = {};  // folder of a run; empty: not looked at
  std::vector<std::string> units = {};
  bool verify = false;
  bool explain = false;  // the table, too; without a sequence it alone
};

int run_check(const CheckOptions& options, std::ostream& out, std::ostream& err);

// The table that run_check prints.
void print_plan(const Sequence& sequence, const StationConfig& station, const Plan& plan, std::ostream& out);

// What check and commission warn of in the table's map or dialect; else empty.
std::string caution_of(const TableConfig& table);
// Whether its map or dialect, where it has one, says so.
bool is_commissioned(const TableConfig& table);
// "FILE:LINE: KEY is a guess" of each line of the table's file, and of the unit's frame, that is one; moving: of those alone that
// decide what moves.
std::vector<std::string> guesses_of(const StationConfig& station, bool moving);

}  // namespace turncal
