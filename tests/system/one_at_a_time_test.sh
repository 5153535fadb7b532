#!/usr/bin/env bash
# Two of us at once: of runs started together into one folder one works and the other is refused, nothing of either is lost; one process
# at a time on a TCP table, a queue and a store; what somebody else put into a folder stays.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo /tmp)")
children=()
trap 'for p in "${children[@]}"; do kill -TERM "$p" 2> /dev/null || true; done; rm -rf "$work"' EXIT
fail() { echo "FAILED: $*" >&2; exit 1; }
cd "$work"

cat > short.seq <<'SEQ'
format = 1
name = pair
rate_degps = 30
acceleration_degps2 = 60
step 1 "one"
  initial H 0 P 0 R 0
  align 400
  dwell 400
SEQ

# 60 pairs started together, into a folder that is there and one that is not.
both=0
for i in $(seq 60); do
  [ $((i % 2)) = 0 ] || mkdir "out$i"
  codes=()
  for unit in A B; do
    "$binary" run --dry-run --capture-only --unit "$unit" --sequence short.seq --out "out$i" > "$unit.out" 2> "$unit.err" &
    codes+=($!)
  done
  good=0
  for k in 0 1; do
    code=0; wait "${codes[$k]}" || code=$?
    # The other finds the folder taken (50), or full already (1).
    [ "$code" = 0 ] && good=$((good + 1)) || [ "$code" = 1 ] || [ "$code" = 50 ] || fail "pair $i: code $code: $(cat ./*.err)"
  done
  [ "$good" = 1 ] || fail "pair $i: $good of two have run: $(cat ./*.err)"
  grep -qE "in use by another process|already contains" A.err B.err || fail "pair $i: $(cat ./*.err)"
  ! grep -q "in use by" A.err B.err || both=$((both + 1))
  for name in recording.tcr journal.tcj run.log; do [ -s "out$i/$name" ] || fail "pair $i: $name is lost"; done
  [ ! -e "out$i/.lock" ] || fail "pair $i: the lock is left"
  rm -rf "out$i"
done
[ "$both" -ge 1 ] || fail "no two of 120 runs have met"

# What another program put there stays when a run fails.
mkdir mine; echo mine > mine/notes.txt; echo theirs > mine/recording.tcr
! "$binary" run --dry-run --unit A --sequence short.seq --capture-only --out mine 2> mine.err || fail "a folder with a recording was taken"
[ "$(cat mine/recording.tcr mine/notes.txt)" = "$(printf 'theirs\nmine')" ] || fail "somebody's file is gone"

# One process at a time at a station: the second names the first.
cp "$here/orchestrator/stations/twin.map" .
sed -e "s|^imu.device = .*|imu.device = $work/imu|" "$here/orchestrator/stations/twin.station" > twin.station
"$binary" twin --station twin.station --table tcp:0 > twin.out 2>&1 &
children+=($!)
for _ in $(seq 200); do grep -qs ready twin.out && break; sleep 0.1; done
address=$(sed -n 's/.* at \(127\.0\.0\.1:[0-9]*\),.*/\1/p' twin.out)
sed -i "s|^table.address = .*|table.address = $address|" twin.station
sed "s|^imu.device = .*|imu.device = $work/none|" twin.station > other.station  # the same table alone
"$binary" monitor --station twin.station > first.out 2>&1 &
first=$!
children+=("$first")
for _ in $(seq 200); do grep -qs 'samples/s' first.out && break; sleep 0.1; done
sed "s|^table.address = 127.0.0.1:|table.address = 127.1:|" other.station > short.station  # and under another name
"$binary" monitor --station short.station > said.out 2> said.err && fail "a table under another name is open to two"
grep -q "in use by another process ($first)" said.err || fail "under another name: $(cat said.err)"
lan=$(hostname -I 2> /dev/null | cut -d' ' -f1)
if [ -n "$lan" ]; then  # an address of a network card of this machine is this machine
  sed "s|^table.address = 127.0.0.1:|table.address = $lan:|" other.station > lan.station
  "$binary" monitor --station lan.station > said.out 2> said.err && fail "a table under the address of a card is open to two"
  grep -q "in use by another process ($first)" said.err || fail "under $lan: $(cat said.err)"
fi
for command in "monitor --station other.station" "run --station other.station --unit A --out a --sequence short.seq --capture-only" "commission --station other.station"; do
  code=0; "$binary" $command > said.out 2> said.err || code=$?
  [ "$code" = 50 ] && grep -q "$address: .*in use by another process ($first)" said.err || fail "code $code: $command: $(cat said.err)"
done
[ ! -e a ] || fail "the refused run left a folder"
kill -TERM "$first"; wait "$first" || true

# A killed holder leaves no lock behind.
"$binary" monitor --station twin.station > second.out 2>&1 &
second=$!
children+=("$second")
for _ in $(seq 200); do grep -qs 'samples/s' second.out && break; sleep 0.1; done
kill -KILL "$second"; wait "$second" 2> /dev/null || true
"$binary" monitor --station twin.station --for 2s > third.out 2>&1 || fail "after a kill: $(cat third.out)"

# Whoever goes on with a run holds its folder, as who begins one does.
"$binary" run --dry-run --unit A --sequence short.seq --capture-only --out held > /dev/null
exec 9> held/.lock; flock -n 9
code=0; "$binary" resume held > said.out 2> said.err || code=$?
[ "$code" = 50 ] && grep -q 'held/.lock: in use by another process' said.err || fail "resume beside another writer: code $code: $(cat said.out said.err)"
exec 9>&-
"$binary" resume held > said.out || fail "resume of a folder that is free: $(cat said.out)"

# A queue.
printf 'A\nB\n' > queue
demo=$here/sequences/short_demo.seq
"$binary" batch queue --dry-run --out batch --sequence "$demo" --pace 200 > batch.out 2>&1 &
batch=$!
children+=("$batch")
for _ in $(seq 100); do grep -qs 'unit A in' batch.out && break; sleep 0.05; done
code=0; "$binary" batch queue --dry-run --out batch2 --sequence "$demo" > said.out 2> said.err || code=$?
[ "$code" = 50 ] && grep -q "queue.batch.lock: in use by another process ($batch)" said.err || fail "two batches on one queue: $(cat said.err)"
"$binary" queue queue --add D > /dev/null || fail "the queue cannot be changed while a batch works on it"
wait "$batch" || fail "batch: $(cat batch.out)"
[ "$(grep -c '^not_judged' queue.state)" = 3 ] || fail "queue.state: $(cat queue.state)"

# The store of parameter files: of two that come together both are kept; what is in hand is waited for, then refused.
printf '%s\n' 'format = 1' 'table.driver = mock' 'imu.driver = rig' 'site.latitude_deg = 29.53' 'site.gravity_mps2 = 9.7914' \
  'motion.settle_s = 0.5' 'record.store = store' > store.station
stored=(run --dry-run --no-diagnosis --station store.station --sequence "$here/sequences/short_demo.seq" --unit S)
for seed in 1 2; do
  echo "seed = $seed" > "$seed.rig"
  "$binary" "${stored[@]}" --rig "$seed.rig" --out "stored$seed" > "stored$seed.out" 2>&1 &
  children+=($!)
done
wait "${children[@]: -2}" || fail "two runs into one store: $(tail -n 3 stored?.out)"
[ "$(find store/simulated/S/versions -type f | wc -l)" = 2 ] || fail "one of two versions is lost: $(find store)"
exec 9> store/simulated/S/.lock; flock -n 9
code=0; "$binary" records restore store --unit S --simulated --version 1 > said.out 2> said.err || code=$?
[ "$code" = 50 ] && grep -q 'store/simulated/S/.lock: in use by another process' said.err || fail "a store in use: code $code: $(cat said.out said.err)"
exec 9>&-
"$binary" records restore store --unit S --simulated --version 1 > said.out || fail "a store that is free: $(cat said.out)"
echo "60 pairs, $both met; a table, a queue, a store: one at a time"
