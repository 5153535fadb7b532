#!/usr/bin/env bash
# docs/safety.md names the tests of this build, and a table with one thing wrong each is refused.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
check=$here/fault_tests.sh
doc=$here/../../docs/safety.md
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
build=${TURNCAL_BUILD:-$here/../../build/release}
{
  ctest --test-dir "$build" -N | sed -n 's/^ *Test *#[0-9]*: //p'
  for tests in "$build"/tests/test_*; do [ ! -f "$tests" ] || [ ! -x "$tests" ] || "$tests" --gtest_list_tests; done |
    awk '/^[^ ]/ { suite = $1; sub(/\/TableContract\/[0-9]+/, "", suite); next } { print suite $1 }'
} > "$work/tests"
bash "$check" "$doc" "$work/tests"

failures=0
# expect WORDS DOC TESTS [LEAST]: this table must be refused in these words.
expect() {
  if bash "$check" "$2" "$3" "${4:-430}" > "$work/said" || ! grep -qF "$1" "$work/said"; then
    echo "expected '$1', got: $(cat "$work/said")"
    failures=$((failures + 1))
  fi
}
# A test of every row renamed, and one disabled.
sed 's/`\([A-Z]\)/`No\1/' "$doc" > "$work/renamed.md"
expect 'no test No' "$work/renamed.md" "$work/tests"
sed 's/^ModbusFaults.Write/ModbusFaults.DISABLED_Write/' "$work/tests" > "$work/disabled"
expect 'no test ModbusFaults.WriteAcknowledgements' "$doc" "$work/disabled"
# Every second row away; one row away; one cell empty.
awk '!/^\|.*`/ || ++n % 2' "$doc" > "$work/half.md"
expect 'tests are named, expected' "$work/half.md" "$work/tests"
grep -v 'FiveSecondsOfSilence' "$doc" > "$work/short.md"
expect 'no row names DialectFaults.FiveSecondsOfSilence' "$work/short.md" "$work/tests" 1
sed 's/| `DialectFaults.FiveSecondsOfSilence` |/| |/' "$doc" > "$work/empty.md"
expect 'a row without a test' "$work/empty.md" "$work/tests" 1
# Without backquotes.
sed 's/`DialectFaults.FiveSecondsOfSilence`/DialectFaults.FiveSecondsOfSilence/' "$doc" > "$work/bare.md"
expect 'not in backquotes: DialectFaults.FiveSecondsOfSilence' "$work/bare.md" "$work/tests" 1
sed 's/`\.\.\.\/tcp_slow_bytes`/...\/tcp_slow_bytes/' "$doc" > "$work/bare.md"
expect 'not in backquotes' "$work/bare.md" "$work/tests" 1
[ "$failures" -eq 0 ]
