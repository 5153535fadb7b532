#!/usr/bin/env bash
# What somebody wrote or typed wrong is refused before anything is opened, in one line that says what was expected.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo /tmp)")
trap 'rm -rf "$work"' EXIT
fail() { echo "FAILED: $*" >&2; exit 1; }
# refused TEXT ARGUMENTS...: code 1, one line of error, the text in it.
refused() {
  local text=$1 code=0
  shift
  "$binary" "$@" > said.out 2> said.err || code=$?
  [ "$code" = 1 ] || fail "code $code, expected 1: $*: $(cat said.out said.err)"
  [ "$(wc -l < said.err)" = 1 ] || fail "not one line: $*: $(cat said.err)"
  grep -qF -- "$text" said.err || fail "'$text' is not said: $*: $(cat said.err)"
}
good() { "$binary" "$@" > said.out 2> said.err || fail "code $?: $*: $(cat said.err)"; }
cd "$work"
stations=$here/orchestrator/stations
steps=$here/sequences/fourteen_step.seq demo=$here/sequences/short_demo.seq
# station NAME SED...: the twin's station with changes.
station() { local name=$1; shift; sed "$@" "$stations/twin.station" > "$name"; }
check() { refused "$2" check --station "$1" --sequence "${3:-$steps}"; }

# A station.
cp "$stations/twin.map" .
station plain -e ''
good check --station plain --sequence "$steps"
station half -e 's/^table.driver.*/table.driver = mock/' -e '/^table.map/d' -e '/^table.address/d' -e '/^table.simulated/d' -e '/^clock.speed_up/d'
check half 'a mock table (table.driver = mock)'
for day in 2027-02-30 2027-02-29 2027-04-31 2027-13-01 2027-00-10 2027-01-00; do
  { cat plain; echo "table.calibration_due = $day"; } > day
  check day "table.calibration_due' = '$day': expected a day of the calendar"
done
{ cat plain; echo 'table.calibration_due = 2096-02-29'; } > day
good check --station day --sequence "$steps"
for hook in "echo 'unclosed" 'if true; then echo' 'echo "$(date"' 'for x in 1 2' 'echo )'; do
  { cat plain; printf 'hook.done = %s\n' "$hook"; } > hook
  check hook 'expected a command of /bin/sh, which says: '
done
{ cat plain; echo "hook.done = if true; then echo \"it's done\" > hooked; fi"; } > hook
good check --station hook --sequence "$steps"
[ ! -e hooked ] || fail "the hook was run"

# Its table: what the table's own file calls plausible, against what is to be done.
station near -e 's/^table.map.*/table.map = near.map/'
{ grep -v '^plausible' twin.map; echo 'plausible.angle_deg = 100'; } > near.map
check near 'near.map: plausible.angle_deg = 100: expected at least 360, as far as the sequence turns roll'
{ grep -v '^plausible' twin.map; echo 'plausible.rate_degps = 1'; } > near.map
sed -i '/max_rate_degps/d' near
check near "table.map' = 'near.map': expected a file whose plausible.rate_degps (1) is not below axis.heading.max_rate_degps"
echo 'axis.heading.max_rate_degps = 30' >> near
check near "axis.heading.max_rate_degps' = '30': expected at most plausible.rate_degps"

sed 's/^link.kind = tcp/&\nlink.baud = 9600/' twin.map > near.map
grep -q '^link.baud' near.map || fail "the twin's map is not of a TCP link"
check near "near.map:$(grep -n '^link.baud' near.map | cut -d: -f1): key 'link.baud' = '9600': expected no such key unless the device is a serial line"

# A rig: what no unit of this station sends, and what no recording holds.
echo 'sample_period_s = 0.01' > slow.rig
refused 'slow.rig: sample_period_s = 0.01: expected 0.005, as frame laser_gyro of the station has it' run --dry-run --unit A --station plain --rig slow.rig --out b
refused 'slow.rig: sample_period_s = 0.01: expected 0.005' twin --station plain --rig slow.rig
echo 'quantisation = off' > real.rig
refused 'real.rig: quantisation = off: expected floor or round' run --dry-run --unit A --rig real.rig --out b

# What is typed.
long=$(printf 'A%.0s' $(seq 300))
refused "'..., 300 bytes: expected a serial number of 1 to 200 bytes" run --dry-run --unit "$long" --out b
printf 'A\n%s\n' "$long" > queue
refused "queue:2: 'AAAA" queue queue --add B
good run --dry-run --no-diagnosis --unit A --sequence "$demo" --out a
refused "'1e300s': expected a time from 0.1s to 3600s" segment a --out s --min-rest 1e300s
refused "'1e-9': expected a number from 1 to 1000000000000" segment a --out s --threshold 1e-9
refused 'no stretch of 100 s stays below the threshold 2' segment a --out s --threshold 2 --min-rest 100s
refused "--unit 'B': expected 'A', whose run this is" resume a --unit B
refused 'nowhere/x.csv: cannot create' apply a --parameters a/parameters.conf --out nowhere/x.csv
! grep -q 'tmp:' said.err || fail "a temporary name: $(cat said.err)"
printf 'A\n' > queue
printf ' \n' > empty.csv
refused 'empty.csv: empty file: expected a header and rows of numbers' import --map "$here/docs/maps/xsens_mti_imutk.map" empty.csv --out b
samples=$here/tests/imu_io/map_samples
refused 'this is a parameter file, expected a recording of turncal; turncal convert and --parameters' calibrate a/parameters.conf --out b
refused 'this is a table of numbers (CSV), expected a recording of turncal; turncal import ' navigate "$samples/euroc.csv" --out b
refused 'this is the journal of a run, expected a sequence; turncal journal and resume take its folder' predict --sequence a/journal.tcj
refused 'expected a recording of turncal; --station of run' journal "$stations/mock.station"
refused 'the unit does not turn enough to tell; in s it is 100 Hz; gyro.unit: the header does not say it' import "$samples/kf_gins.txt" --out b --map-out proposed.map
sed -i 's/^gyro.unit.*/gyro.unit = rad/' proposed.map
good import "$samples/kf_gins.txt" --map proposed.map --out known
grep -q 'imported into known: 60 samples .*; time.increments = period: ' said.out || fail "what was imported is not said: $(cat said.out)"
refused 'empty file: expected a table or a recording' import said.out --out b  # which what is said goes to
echo 'no table and no recording' > letter.txt
refused 'unknown kind of file' import letter.txt --out b
refused 'this is a recording already' import known --out b
refused "topic '/imu': expected a ROS bag" import "$samples/euroc.csv" --topic /imu --out b
good apply a --parameters a/parameters.conf --as rates --out a.mcap
sed 's/^time.column.*/time.column = t\ntopic = \/nope/' proposed.map > topic.map
refused "no topic '/nope'" import a.mcap --map topic.map --out b
refused 'no sample in it by the frame description stim300' import "$samples/imu.h5" --frame stim300 --out b
printf 'format = 1\nname = one\nrate_degps = 30\nacceleration_degps2 = 60\nstep 1\n  initial H 0 P 0 R 0\n  align 2000\n  rotate P +10\n  dwell 2000\n' > one.seq
refused 'expected steps that do (turncal predict)' batch queue --dry-run --sequence one.seq --out b
! grep -q -- --partial said.err || fail "an option that batch does not have: $(cat said.err)"
refused '--partial to estimate what can be of the others' run --dry-run --unit A --sequence one.seq --out b
[ ! -e b ] && [ ! -e s ] || fail "something was made"
echo "refusals: good"
