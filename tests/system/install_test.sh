#!/usr/bin/env bash
# `cmake --install` into a folder gives a program that works from there: its stations find their maps, its sequences can be checked.
set -euo pipefail
prefix=$(mktemp -d)
trap 'rm -rf "$prefix"' EXIT
cmake --install "$TURNCAL_BUILD" --prefix "$prefix" > "$prefix/install.log" || { cat "$prefix/install.log"; exit 1; }
failed=0
need() { [ -e "$prefix/$1" ] || { echo "not installed: $1"; failed=1; }; }
data=share/turncal
need bin/turncal
need share/bash-completion/completions/turncal
need share/doc/turncal/README.md
need share/doc/turncal/docs/tables.md
root=$(cd "$(dirname "$0")/../.." && pwd)
# Every file that describes something is there, at its place in the tree.
while read -r file; do need "$data/$file"; done < <(cd "$root" && find orchestrator/stations sequences imu_io/frames turntable_drivers docs/maps \
  -name '*.station' -o -name '*.seq' -o -name '*.frame' -o -name '*.map' -o -name '*.dialect')
cd "$prefix"
bin/turncal --version
for station in mock modbus serial twin; do
  bin/turncal check --station "$data/orchestrator/stations/$station.station" --sequence "$data/sequences/fourteen_step.seq" \
    > said 2>&1 || grep -q "SET-ME" said || { echo "$station.station:"; tail -n 3 said; failed=1; }
done
exit $failed
