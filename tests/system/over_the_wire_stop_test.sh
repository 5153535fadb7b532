#!/usr/bin/env bash
# Over real lines: the operator's stop in mid-move ends a run with code 30 and the table at rest, `turncal resume` finishes it, a twin
# that goes away is a device error, and nothing that a twin had a part in passes for real.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d)
twin=
trap '[ -z "$twin" ] || kill -TERM "$twin" 2> /dev/null || true; rm -rf "$work"' EXIT
fail() { echo "FAILED: $*" >&2; tail -n 5 "$work"/*.out "$work"/*.err >&2; exit 1; }

cp "$here/orchestrator/stations/twin.map" "$work"
{ sed -e "s|^imu.device = .*|imu.device = $work/imu|" -e "s|^clock.speed_up = .*|clock.speed_up = 20|" \
      -e "s|^motion.deadline_margin_s = .*|motion.deadline_margin_s = 100|" "$here/orchestrator/stations/twin.station"
  echo "resume.rest_s = 20"; } > "$work/twin.station"
cat > "$work/short.seq" << 'SEQUENCE'
format = 1
name = two_turns
rate_degps = 10
acceleration_degps2 = 20
step 1 "there and back"
  initial H 0 P 0 R 0
  align 1000
  rotate P +90
  dwell 1000
  rotate P -90
  dwell 1000
SEQUENCE
"$binary" twin --station "$work/twin.station" --table tcp:0 > "$work/twin.out" 2> "$work/twin.err" &
twin=$!
for _ in $(seq 100); do grep -qs ready "$work/twin.out" && break; sleep 0.1; done
address=$(sed -n 's/.* at \(127\.0\.0\.1:[0-9]*\),.*/\1/p' "$work/twin.out")
sed "s|^table.address = .*|table.address = $address|" "$work/twin.station" > "$work/run.station"

"$binary" run --station "$work/run.station" --unit TWIN --capture-only --sequence "$work/short.seq" --out "$work/run" > "$work/run.out" 2> "$work/run.err" &
run=$!
for _ in $(seq 200); do grep -q 'move_next: pitch from 0 to 90' "$work/run/run.log" 2> /dev/null && break; sleep 0.02; done
kill -INT "$run"
for _ in $(seq 200); do grep -q 'pause_wanted' "$work/run/run.log" 2> /dev/null && break; sleep 0.02; done
kill -INT "$run"
code=0; wait "$run" || code=$?
[ "$code" = 30 ] || fail "a stop by the operator gave code $code, expected 30"
grep -q 'stopped by the operator' "$work/run.err" || fail "the stop is not named"
grep -q 'stopping -> aborted  stopped_verified' "$work/run/run.log" || fail "the stop was not verified"

"$binary" resume "$work/run" > "$work/resume.out" 2> "$work/resume.err" || fail "resume gave code $?"
grep -q 'Run complete' "$work/resume.out" || fail "the resumed run is not complete"
[ -e "$work/run/recording.tcr" ] || fail "there is no recording"
[ -z "$(grep -v '^\[simulated\]' "$work/resume.out" "$work/run/run.log" -h)" ] || fail "a line passes for a real one"
"$binary" journal "$work/run" > "$work/journal.out"
grep -q 'simulated = true' "$work/journal.out" || fail "the journal does not say simulated"
[ ! -e "$work/run/truth.conf" ] || fail "a live run knows no truth"

"$binary" run --station "$work/run.station" --unit TWIN --capture-only --sequence "$work/short.seq" --out "$work/lost" > "$work/lost.out" 2> "$work/lost.err" &
run=$!
for _ in $(seq 200); do grep -q 'move_next: pitch from 0 to 90' "$work/lost/run.log" 2> /dev/null && break; sleep 0.02; done
kill -TERM "$twin"; wait "$twin" || fail "the twin ended with code $?"
twin=
code=0; wait "$run" || code=$?
[ "$code" = 50 ] || fail "a lost twin gave code $code, expected 50"
[ "$(wc -l < "$work/lost.err")" = 1 ] || fail "not one line of error"
[ ! -e "$work/imu" ] || fail "the twin left its link behind"
echo "stop, resume and loss over real lines: good"
