#!/usr/bin/env bash
# run_with_table.sh FILE.map|FILE.dialect LINE: a run over a real line with a shipped map or dialect gives the parameters of the run
# in process (scripts/over-the-wire). A real line loses nothing, and the run's log says so at its end.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
sed '/^step 5/,$d' "$here/sequences/short_demo.seq" > "$work/four.seq"  # the steps that determine everything
"$here/scripts/over-the-wire" --table "$1" --line "$2" --sequence "$work/four.seq" --out "$work/out"
grep -q '^\[simulated\] unit TWIN: [0-9]* samples, 0 lost, 0 duplicates, 0 strays, 0 flagged, 0 bad frames, 0 resyncs; .* +- [0-9.]* ppm, largest arrival delay' \
  "$work/out/wire/run.log" || { echo "FAILED: the log says of the unit's line:" >&2; grep '^.simulated. unit ' "$work/out/wire/run.log" >&2; exit 1; }
