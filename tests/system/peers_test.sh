#!/usr/bin/env bash
# scripts/peers without any other program: it ends with 0, names in one line each what is missing, and judges turncal against the truth of a dry run.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
program=${TURNCAL_BINARY:-$here/build/release/turncal}
python=
for p in python3 /usr/bin/python3; do "$p" -c 'import numpy' 2> /dev/null && { python=$p; break; }; done
[ -n "$python" ] || { echo "skipped: python3 has no numpy"; exit 0; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
peers() { env -u IMU_TK -u PSINS "$here/scripts/peers" --turncal "$program" "$@"; }

peers --data "$work/none" --imu-tk "$work/none" --format json > "$work/out" 2> "$work/said" || { cat "$work/said"; exit 1; }
for line in 'imu_tk skipped: no clone' 'PSINS skipped: no clone' 'Kalibr skipped: ' 'recordings skipped: no folder'; do
  [ "$(grep -c "^scripts/peers: $line" "$work/said")" = 1 ] || { echo "not one line: $line"; cat "$work/said"; exit 1; }
done
[ "$(wc -l < "$work/said")" = 4 ] || { cat "$work/said"; exit 1; }
"$python" - "$work/out" << 'PYTHON'
import json, sys
rows = json.load(open(sys.argv[1]))
assert [r["program"] for r in rows["truth"]] == 2 * ["turncal calibrate", "turncal diagnose"] and rows["hand"] == [], rows
for r in rows["truth"]:  # five times what the two dry runs have, or more
    for key, bound in dict(accel_ug=2, accel_ppm=5, accel_arcsec=2, gyro_degph=0.1, gyro_ppm=5, gyro_arcsec=2).items():
        assert 0 < r[key] < bound, (key, r)
PYTHON

refused() {
  local code=0
  peers "$@" > "$work/out" 2> "$work/said" || code=$?
  [ $code = 1 ] && [ "$(wc -l < "$work/said")" = 1 ] && [ ! -s "$work/out" ] || { echo "$*: code $code"; cat "$work/said"; exit 1; }
}
refused --nonsense
refused --data
refused --format xml
refused --turncal "$work/none"
