#!/usr/bin/env bash
# Every test that docs/fault-tests.md names exists. ".../name" stands for the test before it with another last word.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
build=${TURNCAL_BUILD:-$here/build/release}
list=$(mktemp)
trap 'rm -f "$list"' EXIT
ctest --test-dir "$build" -N | sed -n 's/^ *Test *#[0-9]*: //p' | sed -E -e 's/ *[(]Disabled[)]$//' -e 's/  # GetParam.*//' -e 's/<.*//' > "$list"
awk -v doc="$here/docs/fault-tests.md" '
  FNR == NR { known[$0] = 1; next }
  /^\|/ {
    cell = $0; sub(/ *\|$/, "", cell); sub(/.*\| /, "", cell)
    while (match(cell, /`[^`]*`/)) {
      name = substr(cell, RSTART + 1, RLENGTH - 2)
      cell = substr(cell, RSTART + RLENGTH)
      if (name ~ /^\.\.\.\//) { stem = before; sub(/\/[^\/]*$/, "", stem); name = stem substr(name, 4) }
      before = name
      ++named
      if (!(name in known)) { print "docs/fault-tests.md:" FNR ": no test " name; ++missing }
    }
  }
  END {
    if (named < 100) { print "only " named " tests are named"; exit 1 }
    if (missing > 0) exit 1
    print named " tests named, all there"
  }' "$list" "$here/docs/fault-tests.md"
