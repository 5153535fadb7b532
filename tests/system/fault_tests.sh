#!/usr/bin/env bash
# Says what is wrong with the table of faults $1 beside the list of tests $2 (a name a line), a line each; exit code 1 if anything:
#   every row names tests in backquotes, which exist; ".../name" is the test before it with another last word
#   every test of a suite of faults, of exceptions or of stops is named; one line (rtu_, tcp_, text_) of several is enough
#   the table has not lost rows: at least $3 names (430 without)
set -euo pipefail
awk -v doc="${1##*/}" -v least="${3:-430}" '
  function bad(why) { print doc ":" (FNR > 0 ? FNR ": " : " ") why; failed = 1 }
  function any_line(name) { sub(/\/(rtu|tcp|text)_/, "/", name); return name }
  FNR == NR {
    known[$0] = 1
    if (/^(All\/)?((Station|Modbus|Dialect|Line|Imu|Data)[A-Za-z]*Faults|ModbusExceptions|[A-Za-z]*StopStates|StationStop)[.]/) owed[any_line($0)] = 1
    next
  }
  /^## Every fault/ { inside = 1 }
  !inside || !/^\|/ { next }
  {
    cell = $0; sub(/ *\|$/, "", cell); sub(/.*\| /, "", cell)
    if (cell ~ /^(test|see .*)$/ || cell ~ /^[|-]*$/) next
    outside = ""; of_row = 0
    while (match(cell, /`[^`]*`/)) {
      name = substr(cell, RSTART + 1, RLENGTH - 2)
      outside = outside substr(cell, 1, RSTART - 1)
      cell = substr(cell, RSTART + RLENGTH)
      if (name ~ /^\.\.\.\//) { stem = before; sub(/\/[^\/]*$/, "", stem); name = stem substr(name, 4) }
      before = name
      ++named; ++of_row
      delete owed[any_line(name)]
      if (!(name in known)) bad("no test " name)
    }
    outside = outside cell
    if (match(outside, /([.][.][.]|[A-Za-z]+)[.\/][A-Za-z_]+[^ ]*/)) bad("not in backquotes: " substr(outside, RSTART, RLENGTH))
    else if (of_row == 0) bad("a row without a test")
  }
  END {
    FNR = 0
    for (name in owed) bad("no row names " name)
    if (named < least) bad("only " named + 0 " tests are named, expected " least " or more")
    if (failed) exit 1
    print named " tests named, all there"
  }' "$2" "$1"
