#!/usr/bin/env bash
# The project's own references are alive, and in a tree with one dead one each it is found.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
check=$here/references.sh
program=${TURNCAL_BINARY:-$here/../../build/release/turncal}
bash "$check" "$here/../.." "$program"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0
# expect RESULT FILE LINE: a tree with this one line must (fail) or must not (pass) be refused.
expect() {
  rm -rf "$work/tree"
  mkdir -p "$work"/tree/{calib/types,docs,scripts} "$(dirname "$work/tree/$2")"
  printf '%s\n' '// An axis.' 'struct Axis { int moves; };  // of a table' 'read("axis.sign");' > "$work/tree/calib/types/axis.h"
  echo 'quick=--quick' > "$work/tree/scripts/study"
  echo '# Tables' > "$work/tree/docs/tables.md"
  printf '%s\n' "$3" > "$work/tree/$2"
  local result=pass
  bash "$check" "$work/tree" "$program" > "$work/said" || result=fail
  if [ "$result" != "$1" ]; then
    echo "expected $1, got $result: $3 in $2"
    failures=$((failures + 1))
  elif [ "$1" = fail ] && ! grep -q "^$2:1: no \|^$2:1: link to " "$work/said"; then
    echo "the line does not name $2:1: $(cat "$work/said")"
    failures=$((failures + 1))
  fi
}
# Files and folders.
expect pass calib/a.h '// See calib/types/axis.h, axis.h, calib/types/*.h, calib/types/axis.{h}, <folder>/none.h and docs/tables.md.'
expect pass calib/a.h '#include "calib/types/none.h"  // the compiler finds this one'
expect pass scripts/a '# Into build/release/none.h and /tmp/none.h; time.h is not ours.'
expect fail calib/a.h '// See calib/types/none.h.'
expect fail calib/a.cpp 'int a = 0;  // as in none.h'
expect fail calib/a.h '// In calib/none, the same.'
expect fail calib/a.h '// calib/types/none*.h'
expect fail calib/a.h '// calib/types/axis.{h,cpp}'
expect fail calib/CMakeLists.txt '# docs/none.md'
expect fail scripts/a '# tests/none_test.sh'
expect fail docs/a.md 'The formats are in `formats.md`.'
expect fail docs/a.md 'See `stations/none.station`.'
# Links.
expect pass docs/a.md '[here](tables.md), [there](../calib/types/axis.h), [up](../docs/), [far](https://example.com/x.md), [below](#below)'
expect pass docs/a.md '[section](tables.md#tables)'
expect fail docs/a.md '[here](none.md)'
expect fail docs/a.md '[here](docs/tables.md)'
expect fail docs/a.md '<img src="images/none.png" width="640">'
expect fail calib/README.md '[out](../../none.md#section)'
# Names in code, and keys.
expect pass docs/a.md '`Axis::moves`, `axis.sign`, `axis.NAME.sign`, `axis.sign = 1`, `f_x = 2`'
expect fail docs/a.md '`Axis::rests`'
expect fail docs/a.md '`axis.scale`'
expect fail calib/a.h '// With `random_axis = 0` it is off.'
# The program.
expect pass README.md '`turncal run --dry-run --out DIR`, `--quick` of `scripts/study`, `turncal calibrate R --method=joint`'
expect pass docs/a.md 'An --option of nobody, outside code.'
expect fail README.md '`turncal walk`'
expect fail README.md '`turncal run --slow-run`'
expect fail docs/a.md '`turncal twin --dry-run`'
expect fail docs/a.md '`--no-such-option`'
[ "$failures" -eq 0 ]
