#!/usr/bin/env bash
# `turncal commission` and `turncal monitor` over real lines: what fits is accepted, what does not is refused in one line, nothing is
# left moving or switched on. Gyros: axis, sign, scale to 0.5 % against the table. Accelerometers: the same against gravity in three poses.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d)
twin=
trap '[ -z "$twin" ] || kill -TERM "$twin" 2> /dev/null || true; rm -rf "$work"' EXIT
fail() { echo "FAILED: $*" >&2; tail -n 5 "$work"/*.out "$work"/*.err >&2; exit 1; }
# expect CODE TEXT ARGUMENTS...: the text stands in the output, or for an error in its one line.
expect() {
  local wanted=$1 text=$2 code=0
  shift 2
  "$binary" "$@" > "$work/said.out" 2> "$work/said.err" || code=$?
  [ "$code" = "$wanted" ] || fail "code $code, expected $wanted: $*"
  [ "$wanted" = 0 ] || [ "$(wc -l < "$work/said.err")" = 1 ] || fail "not one line of error: $*"
  cat "$work/said.out" "$work/said.err" > "$work/said"
  [ -z "$(grep -v '^\[simulated\]' "$work/said")" ] || fail "a line passes for a real one: $*"
  grep -q -- "$text" "$work/said" || fail "'$text' is not said: $*"
}

cp "$here/orchestrator/stations/twin.map" "$work"
sed -e "s|^imu.device = .*|imu.device = $work/imu|" -e "s|^clock.speed_up = .*|clock.speed_up = 20|" \
  "$here/orchestrator/stations/twin.station" > "$work/twin.station"
printf 'table.heading.power_on_deg = 30\ntable.pitch.power_on_deg = 20\ntable.roll.power_on_deg = -10\n' > "$work/known.rig"
"$binary" twin --station "$work/twin.station" --rig "$work/known.rig" --table tcp:0 > "$work/twin.out" 2> "$work/twin.err" &
twin=$!
for _ in $(seq 100); do grep -qs ready "$work/twin.out" && break; sleep 0.1; done
address=$(sed -n 's/.* at \(127\.0\.0\.1:[0-9]*\),.*/\1/p' "$work/twin.out")
sed -i "s|^table.address = .*|table.address = $address|" "$work/twin.station"

# One thing wrong each: the map not commissioned, the unit's z turned over, and x and y of its gyros exchanged.
sed 's/^commissioned = true/commissioned = false/' "$work/twin.map" > "$work/new.map"
sed 's/twin\.map/new.map/' "$work/twin.station" > "$work/new.station"
sed 's/^write.stop = .*/& \x23 [guess]/' "$work/new.map" > "$work/guess.map"
sed 's/twin\.map/guess.map/' "$work/twin.station" > "$work/guess.station"
for axes in '+x, +y, -z' '+y, +x, +z'; do
  { cat "$here/imu_io/frames/laser_gyro.frame"; echo "gyro.axes = $axes"; } > "$work/${axes:1:1}.frame"
  sed "s/^imu.frame = .*/imu.frame = ${axes:1:1}.frame/" "$work/twin.station" > "$work/${axes:1:1}.station"
done

# The accelerometers alone: y and z turned over, z and x exchanged, a pulse that is 20 % too heavy.
accel() {
  { grep -v '^accel.pulse_mps' "$here/imu_io/frames/laser_gyro.frame"; echo "accel.pulse_mps = ${3:-0.0005}"; echo "accel.axes = $2"; } > "$work/$1.frame"
  sed "s/^imu.frame = .*/imu.frame = $1.frame/" "$work/twin.station" > "$work/$1.station"
}
accel up '+x, -y, -z'
accel side '+x, +y, -z'
accel front '-x, +y, +z'
accel heavy '+x, +y, +z' 0.0006

angles=(--heading 30 --pitch 20 --roll -10)
expect 1 'not commissioned' commission --station "$work/new.station"
expect 0 'nothing was moved' commission --station "$work/new.station" "${angles[@]}"
expect 1 'write.stop is a guess.*--accept-guess' commission --station "$work/guess.station" "${angles[@]}"
expect 0 'nothing was moved' commission --station "$work/guess.station" --accept-guess "${angles[@]}"
expect 1 'heading: reads 30 deg, stands at 31 deg' commission --station "$work/twin.station" --heading 31 --pitch 20 --roll -10
expect 0 'nothing was moved' commission --station "$work/twin.station" "${angles[@]}"
expect 0 'every axis turns the unit as it should' commission --station "$work/twin.station" --gyro-pulse-arcsec 0.93292
grep -q 'heading +5 deg: sensed about -y' "$work/said" || fail "heading is not shown"
# The twin's accelerometers have scale factors of some per cent, as the unit's before its first calibration.
g='\(9\|10\)\.'
for pose in "gravity, level 0 deg: [^,]*, +$g" "gravity, pitch 90 deg: +$g" "gravity, roll 90 deg: [^,]*, [^,]*, -$g"; do
  grep -q "$pose" "$work/said" || fail "$pose is not shown: $(cat "$work/said")"
done
expect 1 "the unit's -y is up instead of its +y" commission --station "$work/up.station"
expect 1 "the unit's +z is up instead of its -z" commission --station "$work/side.station"
expect 1 "the unit's -x is up instead of its +x" commission --station "$work/front.station"
expect 1 'level.*scale of the accelerometers\|scale of the accelerometers' commission --station "$work/heavy.station"
expect 1 'heading turned by +5 deg.*scale of the gyros.*0.5 %' commission --station "$work/twin.station" --gyro-pulse-arcsec 0.9393
expect 1 'pitch turned by +5 deg.*expected plus about z' commission --station "$work/x.station"
expect 1 'heading turned by +5 deg.*expected minus about y' commission --station "$work/y.station"
expect 1 'heading turned by +5 deg.*-5.000000 deg about y' commission --station "$work/twin.station" --gyro-pulse-arcsec 1.1
# A rate_scale that is ten times too large, the rate read back by it as well; and one that is ten times too small.
counts=$(sed -n 's/^axis.heading.counts_per_degree = //p' "$work/twin.map")
for way in fast:10 slow:0.1; do
  name=${way%:*} factor=${way#*:}
  { cat "$work/twin.map"
    for axis in heading pitch roll; do
      for key in rate_scale measured_rate_scale; do echo "axis.$axis.$key = $(awk "BEGIN { print $counts * $factor }")"; done
    done; } > "$work/$name.map"
  sed "s/twin\.map/$name.map/" "$work/twin.station" > "$work/$name.station"
done
# rates KIND FAST SLOW: the scales in the files. One that is too fast is stopped at the first poll that shows it, long before its 5 deg are
# over; what is said of one that is too slow is right to a tenth.
expect_rates() {
  local kind=$1 said
  expect 1 "heading turns at .* times the 0.5 deg/s that were sent.*axis.heading.rate_scale in .*fast.$kind is $2, expected less" \
    commission --accept-guess --station "$work/fast.station"
  expect 1 "heading turned by .* times the 0.5 deg/s that were sent.*axis.heading.rate_scale in .*slow.$kind is $3, expected about" \
    commission --accept-guess --station "$work/slow.station"
  said=$(sed -n 's/.* at \([0-9.]*\) times the 0.5 deg.*/\1/p' "$work/said")
  awk "BEGIN { exit !($said > 0.09 && $said < 0.11) }" || fail "slow: $said times, and not 0.1"
}
expect_rates map "$(awk "BEGIN { print $counts * 10 }")" "$(awk "BEGIN { print $counts * 0.1 }")"
# A bit that is not the one of in_position; a stop that the table takes for something else.
for line in 'bit.in_position.mask = 0x4000' 'write.stop = 0x34 u16 1'; do
  sed "s/^${line%% =*} = .*/$line/" "$work/twin.map" > "$work/wrong.map"
  sed -e 's/twin\.map/wrong.map/' -e 's/^motion.deadline_margin_s = .*/motion.deadline_margin_s = 40/' "$work/twin.station" > "$work/wrong.station"
  expect 1 'has stood at its target for .* in_position was never set: expected bit.in_position\|heading was told to stop on its way and went on' \
    commission --accept-guess --station "$work/wrong.station"
done
expect 0 '0 gaps (0 lost)' monitor --station "$work/twin.station" --for 3s
[ "$(grep -c 'deg/s not ready (off).*samples/s, .*|f| ' "$work/said")" -ge 1 ] || fail "no line with the drives off"
grep -q 'unit: [0-9]* samples, 0 lost, .* 0 bad frames, .*line errors not counted by the port' "$work/said" || fail "no summary of the unit's line"

# The same of an ASCII table.
kill -TERM "$twin"; wait "$twin" || true
{ grep -Ev '^(commissioned|link\.(kind|baud)|plausible\.rate_degps) *=' "$here/turntable_drivers/ascii/dialects/newport_esp30x.dialect"
  printf 'commissioned = true\nlink.kind = tcp\nplausible.rate_degps = 20000\n'; } > "$work/right.dialect"
for way in right:1 fast:10 slow:0.1; do
  name=${way%:*}
  [ "$name" = right ] || { cat "$work/right.dialect"
    for axis in heading pitch roll; do
      for key in rate_scale measured_rate_scale; do echo "axis.$axis.$key = ${way#*:}"; done
    done; } > "$work/$name.dialect"
  sed -e 's/^table.driver = .*/table.driver = serial/' -e "s/^table.map = .*/table.dialect = $name.dialect/" "$work/twin.station" > "$work/$name.station"
done
"$binary" twin --station "$work/right.station" --table "tcp:${address##*:}" > "$work/twin.out" 2> "$work/twin.err" &
twin=$!
for _ in $(seq 100); do grep -qs ready "$work/twin.out" && break; sleep 0.1; done
expect 0 'every axis turns the unit as it should' commission --accept-guess --station "$work/right.station"
expect_rates dialect 10 0.1

# Every shipped frame, of units that count and of units that send rad and m/s, beside a table that knows its zero.
kill -TERM "$twin"; wait "$twin" || true
sed '/^write.home/d' "$work/twin.map" > "$work/encoder.map"
echo 'home.kind = encoder' >> "$work/encoder.map"
for frame in "$here"/imu_io/frames/*.frame; do
  name=$(basename "$frame" .frame)
  sed -e "s/^imu.frame = .*/imu.frame = $name/" -e 's/twin\.map/encoder.map/' "$work/twin.station" > "$work/$name.station"
  "$binary" twin --station "$work/$name.station" --table "tcp:${address##*:}" > "$work/twin.out" 2> "$work/twin.err" &
  twin=$!
  for _ in $(seq 100); do grep -qs ready "$work/twin.out" && break; sleep 0.1; done
  expect 0 'samples/s, .*|f| \(9\|10\)\.' monitor --station "$work/$name.station" --for 20s
  [ "$name" != f32_bddb0a ] || expect 0 'every axis turns the unit as it should' commission --station "$work/$name.station"
  kill -TERM "$twin"; wait "$twin" || true
done
twin=
echo "commissioning over real lines: good"
