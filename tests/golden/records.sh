#!/bin/sh
# What a run leaves behind: a row for every attempt, recordings that are removed when they are old, the temperature of a chamber, angles
# that are read from a file.
name=records
. ./begin.sh
station kept 'station.name = east\nrecord.database = rows.db\nlimit.residual_max = 2\n'
sed 's/residual_max = 2/residual_max = 0.1/' kept.station > failing.station
{ cat kept.station; echo 'table.calibration_due = 2020-01-01'; } > overdue.station
fault 1 imu_unplugged time_s 100 > gone.rig
run --unit SN1 --out SN1 --station kept.station --part RLG --operator 'A. Turner' --revision C
run --unit SN2 --out SN2 --station failing.station
run --unit SN3 --out SN3 --station kept.station --rig gone.rig
run --unit SN4 --out SN4 --station overdue.station
run --unit SN5 --out SN5 --station kept.station --capture-only
for filter in '' '--part RLG' '--verdict fail' '--verdict hold' '--to 2026-01-01T00:00:00Z' '--from 2026-01-01 --to 2026-01-01' '--from 2026-01-02'; do
  try history rows.db --attempts --format csv $filter
done
# The same recording is the same row; a station whose server is away keeps its rows beside it.
run --unit SN1 --out SN1-again --station kept.station
try history rows.db --unit SN1
try history rows.db --attempts --unit SN1
sed 's,rows.db,postgresql://east@127.0.0.1:1/turncal,' kept.station > away.station
for unit in SN1 SN2; do run --unit $unit --out away-$unit --station away.station; done
grep outbox away-SN2/run.log
for again in 1 2; do try records copy away.station.outbox.db whole.db; done
try records check whole.db
try history rows.db --control
try history rows.db --station west
try shift rows.db
try shift rows.db --simulated
try records backup rows.db --out backup.db
try records backup rows.db --out backup.db
try records check backup.db

# One of another schema, and one that somebody has changed.
sql() { cp rows.db changed.db && python3 -c 'import sqlite3, sys; c = sqlite3.connect("changed.db"); c.execute(sys.argv[1]); c.commit()' "$1"; }
for version in 3 5; do
  sql "UPDATE schema_version SET version = $version"
  try history changed.db
  try records check changed.db
  sed 's/rows.db/changed.db/' kept.station > changed.station
  run --unit SN6 --out SN6 --station changed.station
done
for change in "value SET value = value + 1 WHERE key = 'N02'" "calibration SET sequence_hash = 'another'" \
              'attempt_note SET calibration = 77 WHERE calibration IS NOT NULL'; do
  sql "UPDATE $change"
  try records check changed.db
  try records backup changed.db --out copy.db
done
{ head -c 4096 rows.db; printf '%0200d' 5; tail -c +4297 rows.db; } > torn.db
try records check torn.db
: > none.db
try history none.db
sed 's/rows.db/none.db/' kept.station > none.station
run --unit SN1 --out of-none --station none.station

# Old recordings of units that are finished, and never the last. Three days of one unit, one of another, one on hold that was done again.
measure() {
  rig "$1" "start_utc_s = $((1767225600 + 86400 * $3))\n${5:-}"
  station "$1" "${4:-}"
  turncal run --dry-run --quiet --sequence "$demo" --unit "$2" --out "all/$1" --station "$1.station" --rig "$1.rig" 2> said
}
measure first A 0
measure failed A 1 'limit.N01.max = -1\nlimit.N01.min = -2\n'
measure last A 2
measure other B 0
measure held C 0 '' 'effect.accel_second_order.x = 30\n'
measure again C 1
prune() { try records prune all --older-than "$@"; find all -name '*.tcr' | LC_ALL=C sort; }
prune 36500d
prune 1d --list
# A journal that cannot be read, and one without a verdict.
cp all/first/journal.tcj whole
head -c 100 whole > all/first/journal.tcj
prune 1d
head -c "$(grep -abo 'result = ' whole | tail -1 | cut -d: -f1)" whole > all/first/journal.tcj
prune 1d
cp whole all/first/journal.tcj
prune 1d
try resume all/first
prune 1d

# A journal that is damaged, or empty.
TURNCAL_FAULT_POINT=150 TURNCAL_FAULT_MODE=kill turncal run --dry-run --sequence four.seq --unit SN1 --out part
cp part/journal.tcj whole
{ head -c 500 whole; printf '\377'; tail -c +502 whole; } > part/journal.tcj
try resume part
: > part/journal.tcj
try resume part
cp whole part/journal.tcj
try resume part
try resume part

# A recording that was changed is not continued.
run --unit SN1 --out first --no-diagnosis
rig noise 'noise.seed = 4711\n'
run --unit SN1 --out other --rig noise.rig --no-diagnosis
cp first/recording.tcr whole
for changed in "$(printf 'head -c 20000 whole; printf x; tail -c +20002 whole')" 'cat other/recording.tcr'; do
  eval "{ $changed; }" > first/recording.tcr
  try run --continue first --sequence four.seq
done
cp whole first/recording.tcr
try run --continue first --sequence four.seq
try journal first/continued
try resume first
try run --continue first/continued --sequence four.seq

# A chamber: the temperature first, its door.
station warm 'chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\n'
fault 1 chamber_door_open time_s 600 > door.rig
chamber() { run --unit SN1 --capture-only --station warm.station "$@"; }
chamber --out cold
chamber --out warm --temperature 30 --verbose
try journal warm --format csv
try check --explain --station warm.station
chamber --out door --temperature 30 --rig door.rig
try resume door
try journal door --format csv

# By hand, the angles from a file.
sequence up <<'SEQ'
  initial H 0 P 0 R 0
  align 1000
  rotate P +90
  dwell 1000
  rotate R -90
  dwell 1000
SEQ
hand() { try run --manual --dry-run --unit SN1 --capture-only --sequence up.seq "$@" < answers; }
printf '0\n0\n0\n90.01\n-90.02\n' > answers
hand --out by-hand
station german 'operator.language = de\n'
printf '0\n0\n0\n90,01\n0\nhilfe\nüberspringen Klemme sitzt fest\n' > answers
hand --out von-hand --station german.station
made SN* cold warm door by-hand von-hand

# A fault of the table says where; one before the first sample leaves a folder only where the table moved.
fault 1 stuck_axis axis pitch time_s 14 > stuck.rig
fault 1 link_lost time_s 0 > link.rig
fault 1 emergency_stop time_s 1 > estop.rig
rig k2 'effect.accel_second_order.x = 40\n'
for name in stuck link estop; do run --unit SN1 --out fault-$name --rig $name.rig; done
run --unit SN1 --out fault-stuck
try run --dry-run --sequence "$demo" --unit SN1 --out fault-k2 --rig k2.rig
(ulimit -f 200; run --unit SN1 --out fault-size --capture-only)
made fault-*
grep -h effect fault-k2/truth.conf
