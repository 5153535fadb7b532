#!/bin/sh
# What the diagnosis finds is the unit's outcome everywhere; several recordings of one unit; units that came before as a prior.
name=diagnosed
. ./begin.sh
rig delay 'seed = 7\neffect.accel_delay.tau = 0.3\n'
hooks='hook.done = echo done $TURNCAL_OUTCOME >> told\nhook.fail = echo fail $TURNCAL_OUTCOME >> told\n'
station found "${hooks}record.database = rows.db\nrecord.store = kept\n"
echo SN1 > queue
try batch queue --dry-run --out units --rig delay.rig --station found.station
try resume units/SN1
try history rows.db --format csv
cat queue.state told units/SN1/parameters.conf
# The station may pass it, and load the base file.
station passed "${hooks}record.store = kept\ndiagnosis.extended = pass\ndiagnosis.parameters = base\nlimit.N01.sigma_max = 1\n"
try run --unit SN1 --dry-run --out passed --rig delay.rig --station passed.station
cat told
made units passed kept

record() {
  rig "$1" "seed = 7\n$2"
  turncal run --quiet --dry-run --capture-only --unit SN1 --rig "$1.rig" --out "$1" --sequence "$source/sequences/$3"
}
for k in 1 2; do record one$k "noise.seed = $k\n" forty_minutes.seq; done
for k in 3 4; do record held$k "noise.seed = $k\n" holdout.seq; done
for k in 1 2; do record short$k "noise.seed = $k\n" short_demo.seq; done
record north 'site.latitude_deg = 60\n' short_demo.seq
try diagnose one1 one2 --holdout held3 --holdout held4 --out together --verbose
cat together/diagnosis.conf together/parameters.conf
try diagnose one1 one1 --out out
try diagnose one1 one2 --holdout one2 --out out
try diagnose one1 north --out out
# A unit is not recorded twice at a time.
for k in 1 2; do turncal export short$k --out text$k > said; done
began() { sed -i '/^started_utc/,$d' text"$1"/recording.conf; [ -z "$2" ] || echo "started_utc = $2" >> text"$1"/recording.conf; }
began 1 2026-01-31T12:00:00Z
began 2 2026-01-31T12:05:00Z
try calibrate text1 text2 --out out
try calibrate text2 text1 --out out
began 2 2026-01-31T13:00:00Z
try calibrate text1 text2 --out apart
grep -E 'measured_utc|started_utc' apart/parameters.conf
began 2 ''
try calibrate text1 text2 --out unknown

# Ten other units and the unit itself: what comes of them, and is no history for the next.
station line 'record.database = earlier.db\n'
for k in $(seq 20 30); do
  rig unit "seed = $k\n"
  turncal run --quiet --dry-run --no-diagnosis --unit SN$k --rig unit.rig --out earlier/$k --station line.station --sequence "$demo"
done
try calibrate earlier/23 --prior earlier --out earlier/with --verbose
grep prior earlier/with/parameters.conf
try calibrate earlier/23 --prior earlier.db --out of-rows --verbose
try calibrate earlier/24 --prior earlier --out again --verbose
made together apart unknown earlier/with of-rows again
