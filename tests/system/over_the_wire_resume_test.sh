#!/usr/bin/env bash
# A live run over real lines, broken off in three ways and taken up each time against the same twin:
#   kill -9 in mid-move   nobody is left to stop the table: the drives' watchdog does, and they show a fault
#   Ctrl-C in mid-move    a pause: the move comes to its end, drives off, code 75
#   SIGSTOP in mid-move   the watchdog trips; the station, when it goes on, sees the fault and ends with code 50
# A run that is not taken up is refused as long as the fault stands. In the end the parameters are those of the unit.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d)
twin= run=
finish() {
  [ -z "$run" ] || { kill -CONT "$run"; kill -KILL "$run"; } 2> /dev/null || true
  [ -z "$twin" ] || kill -TERM "$twin" 2> /dev/null || true
  rm -rf "$work"
}
trap finish EXIT
fail() { echo "FAILED: $*" >&2; tail -n 5 "$work"/*.out "$work"/*.err >&2; exit 1; }
# Until a pattern is in a file, the Nth time; generously: everything here is over within seconds.
await() {
  local count
  for _ in $(seq 1500); do
    count=$(grep -c -e "$1" "$2" 2> /dev/null || true)
    [ "${count:-0}" -ge "${3:-1}" ] && return
    sleep 0.02
  done
  fail "never came: $1"
}
# The four steps that determine everything; the turns that a test breaks into take one or two minutes of the rig.
speed_up=20
sed -e '/^step 5/,$d' -e '0,/rotate P -180/s//rotate P -180 rate 1.5/' -e '0,/rotate R -180/s//rotate R -180 rate 3/' \
    -e '0,/rotate R +360/s//rotate R +360 rate 3/' "$here/sequences/short_demo.seq" > "$work/four.seq"
sed -e "s|^heartbeat.period_s = .*|heartbeat.period_s = 0.8|" -e "s|^heartbeat.watchdog_s = .*|heartbeat.watchdog_s = 2|" \
    "$here/orchestrator/stations/twin.map" > "$work/twin.map"
{ sed -e "s|^imu.device = .*|imu.device = $work/imu|" -e "s|^clock.speed_up = .*|clock.speed_up = $speed_up|" \
      "$here/orchestrator/stations/twin.station"
  echo "resume.rest_s = 10"; } > "$work/twin.station"
"$binary" twin --station "$work/twin.station" --table tcp:0 > "$work/twin.out" 2> "$work/twin.err" &
twin=$!
await ready "$work/twin.out"
address=$(sed -n 's/.* at \(127\.0\.0\.1:[0-9]*\),.*/\1/p' "$work/twin.out")
sed "s|^table.address = .*|table.address = $address|" "$work/twin.station" > "$work/run.station"

start() {  # a command of the program, with a status page
  "$binary" "$@" --no-diagnosis --listen 127.0.0.1:0 > "$work/$name.out" 2> "$work/$name.err" &
  run=$!
}
# Until the status page shows a rate of this axis (heading, pitch, roll: 1, 2, 3) beyond what noise makes.
await_turning() {
  await 'status page' "$work/$name.out"
  local port status rate
  port=$(sed -n 's|.*status page http://127.0.0.1:\([0-9]*\)/.*|\1|p' "$work/$name.out")
  for _ in $(seq 500); do
    exec 3<> "/dev/tcp/127.0.0.1/$port"
    printf 'GET /status.json HTTP/1.0\r\nHost: 127.0.0.1:%s\r\n\r\n' "$port" >&3
    status=$(cat <&3)
    exec 3<&-
    [[ $status == *'"simulated":true'* ]] || fail "the page takes a twin for a real station: $status"
    rate=$(sed -n 's/.*"rate_degps":\[\([^]]*\)\].*/\1/p' <<< "$status" | cut -d, -f"$1")
    awk -v r="${rate:-0}" 'BEGIN { exit (r > 1 || r < -1) ? 0 : 1 }' && return
    sleep 0.02
  done
  fail "never turned"
}
expect_code() {
  local code=0
  wait "$run" || code=$?
  run=
  [ "$code" = "$1" ] || fail "$2 gave code $code, expected $1"
  ! grep -v -e '^\[simulated\] ' -e '^\[simulated\]$' "$work/$name.out" "$work/$name.err" || fail "$2: a line does not say that a twin answers"
}
log=$work/run/run.log
items() { "$binary" journal "$work/run" | sed -n 's/^\[simulated\] *[0-9]* dwell  *item = \([0-9]*\).*/\1/p'; }  # whose dwells are complete
seconds() { awk -v a="$1" -v b="$(date +%s.%N)" 'BEGIN { printf "%.1f", b - a }'; }

# --- kill -9
name=killed
start run --station "$work/run.station" --unit TWIN --sequence "$work/four.seq" --out "$work/run"
await 'move_next: pitch from 90 to -90' "$log"
await_turning 2
at=$(date +%s.%N)
kill -KILL "$run"
expect_code 137 "kill -9"
await 'at rest after that' "$work/twin.out"
echo "kill -9: table at rest $(seconds "$at") s of the host later (watchdog 2 s)"
grep 'watchdog\|at rest' "$work/twin.out"
awk '/watchdog tripped/ { tripped = $5 } /at rest/ { rest = $7; for (i = 1; i < NF; ++i) if ($i == "pitch") pitch = $(i + 1) }
     END { exit (rest >= tripped && rest - tripped < 40 && pitch < 85 && pitch > -85) ? 0 : 1 }' "$work/twin.out" ||
  fail "the watchdog did not stop the table in mid-move"
# Somebody else sees it too: pitch's state has fault, and neither moving nor a rate.
if command -v mbpoll > /dev/null; then
  mbpoll -m tcp -p "${address##*:}" -a 2 -0 -r 0x10 -c 6 -t 4:hex -1 127.0.0.1 > "$work/mbpoll.out"
  state=$(awk '/^\[16\]/ { print $2 }' "$work/mbpoll.out")
  [ $((state & 0x10)) -ne 0 ] && [ $((state & 0x04)) -eq 0 ] || fail "mbpoll sees state $state: expected fault and no motion"
fi
before=$(items)
[ "$(wc -w <<< "$before")" = 3 ] || fail "complete are items $before, expected three"
name=another
start run --station "$work/run.station" --unit TWIN --sequence "$work/four.seq" --out "$work/another"
expect_code 50 "a run that is not taken up, with the fault standing,"
grep -q 'expected it cleared' "$work/another.err" || fail "the fault is not named"

# --- resume, and a pause in mid-move
name=resumed
start resume "$work/run"
await 'clears the fault of axis pitch' "$log"
await 'selecting -> settling  back_in_place' "$log"
await 'move_next: roll from 90 to -90' "$log"
await_turning 3
kill -INT "$run"
await 'pause_wanted: pause asked for: after this move, at ' "$log"
expect_code 75 "a pause"
[ "$(wc -l < "$work/resumed.err")" = 2 ] && grep -q "warning: go to the table before anything else" "$work/resumed.err" || fail "what a killed run left is not said"
grep -q 'paused; the table rests.*; resume with: turncal resume' "$work/resumed.err" || fail "the pause is not named"
tail -n 1 "$log" | grep -q 'paused' || fail "the log does not end with the pause"
grep -q 'settling -> selecting  settled: roll at -[89]' "$log" || fail "the move was cut short"
grep -q 'stopping -> interrupted  stopped_verified' "$log" || fail "the stop was not verified"

# --- resume, and a station that stands still in mid-move
name=stopped
start resume "$work/run"
await 'move_next: roll from 0 to 360' "$log"
await_turning 3
kill -STOP "$run"
await 'watchdog tripped' "$work/twin.out" 2
await 'at rest after that' "$work/twin.out" 2
kill -CONT "$run"
expect_code 50 "a station that stood still for longer than the watchdog waits"
[ "$(wc -l < "$work/stopped.err")" = 1 ] || fail "not one line of error"
grep -q 'moving, roll at .*: fault of axis' "$work/stopped.err" || fail "the drive's fault is not named"
grep -q 'stopping -> failed  stopped_verified' "$log" || fail "the stop was not verified"

# --- resume, to the end
name=done
start resume "$work/run"
expect_code 0 "the last resume"
grep -q 'Run complete' "$work/done.out" || fail "the run is not complete"
[ "$(items | wc -l)" = "$(grep -c '^ *\(dwell\|align\)' "$work/four.seq")" ] || fail "complete are items $(items)"
[ -z "$(items | sort | uniq -d)" ] || fail "a dwell was done twice"
[ "$(items | head -n 3)" = "$before" ] || fail "a complete dwell was taken back"

# The same rig in process knows its truth.
"$binary" run --dry-run --no-diagnosis --station "$here/orchestrator/stations/mock.station" --unit TWIN --sequence "$work/four.seq" --out "$work/dry" > "$work/dry.out" ||
  fail "the dry run"
awk '$2 != "=" { next }
  FNR == NR { truth[$1] = $3; next }
  { wire[$1] = $3 }
  END {
    for (key in truth) {
      if (!(("sigma." key) in wire) || wire["sigma." key] + 0 == 0) continue
      d = (wire[key] - truth[key]) / wire["sigma." key]; d = d < 0 ? -d : d
      ++count; sum += d * d; if (d > worst) { worst = d; which = key }
    }
    printf "%d parameters against the truth: rms %.2f sigma, largest %.2f (%s)\n", count, sqrt(sum / count), worst, which
    exit (count >= 20 && worst < 5) ? 0 : 1
  }' "$work/dry/truth.conf" "$work/run/parameters.conf" || fail "the parameters are not the unit's"
kill -TERM "$twin"; wait "$twin" || fail "the twin ended with code $?"
twin=
echo "killed, paused and stood still over real lines, and taken up each time: good"
