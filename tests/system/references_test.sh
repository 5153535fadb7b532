#!/usr/bin/env bash
# The project's own references are alive, and each dead one of a tree made of them is found.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
check=$here/references.sh
program=${TURNCAL_BINARY:-$here/../../build/release/turncal}
bash "$check" "$here/../.." "$program"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work"/{calib/types,docs,scripts,orchestrator}
printf '%s\n' '// An axis.' 'struct Axis { int moves; };  // of a table' 'read("axis.sign");' > "$work/calib/types/axis.h"
echo 'quick=${TURNCAL_QUICK:---quick}' > "$work/scripts/study"
printf '%s\n' '# Tables' '## What `axis.sign` is, in words' '## Twice' '## Twice' > "$work/docs/tables.md"
expected=()
# expect RESULT FILE LINE: this line of the tree must (fail) or must not (pass) be named.
expect() {
  printf '%s\n' "$3" >> "$work/$2"
  expected+=("$1" "$2:$(wc -l < "$work/$2")" "$3")
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
expect pass docs/a.md 'With my.station; imu.frame is a key.'
expect fail docs/a.md 'With none.station.'
expect fail docs/a.md 'In none.seq, too.'
expect fail calib/a.h '// As in none.dialect.'
# Variables.
expect pass docs/a.md '`TURNCAL_QUICK=1 scripts/study`'
expect fail docs/a.md '`TURNCAL_SLOW=1 scripts/study`'
expect fail scripts/a '# With TURNCAL_SLOW set.'
# Links.
expect pass docs/a.md '[here](tables.md), [there](../calib/types/axis.h), [up](../docs/), [far](https://example.com/x.md#none)'
expect pass docs/a.md '[section](tables.md#tables), [code](../calib/types/axis.h#L1), [words](tables.md#what-axissign-is-in-words)'
expect pass docs/a.md '## Below, this'
expect pass docs/a.md '[below](#below-this), [second](tables.md#twice-1)'
expect fail docs/a.md '[section](tables.md#chairs)'
expect fail docs/a.md '[third](tables.md#twice-2)'
expect fail docs/a.md '[below](#above)'
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
expect fail orchestrator/README.md '`turncal walk`'
expect fail CHANGELOG.md '- `turncal run --slow-run` is new.'

bash "$check" "$work" "$program" > "$work/said" || true
failures=0
for ((i = 0; i < ${#expected[@]}; i += 3)); do
  result=pass
  if grep -q "^${expected[i + 1]}: \(no \|link to \)" "$work/said"; then result=fail; fi
  [ "$result" = "${expected[i]}" ] && continue
  echo "expected ${expected[i]}, got $result: ${expected[i + 2]} in ${expected[i + 1]}"
  failures=$((failures + 1))
done
[ "$failures" -eq 0 ]
