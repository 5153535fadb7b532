#!/bin/sh
# A batch goes on past a bad unit and stops at a fault; what of it reaches queue, folders and hooks.
name=batches
. ./begin.sh
batch() { try batch queue --dry-run --out units --sequence four.seq "$@"; }
queue() { printf '%s\n' "$@" > queue; }
queue SN1 '# a remark' '  SN2   # with another' '' 'S/N 3'
batch
batch
try queue queue --again SN2
batch --verbose

# The unit on the table tells that it is SN2; units beyond their limits; a unit that flags all it sends; samples lost that no counter shows.
queue SN11 SN2.x
rig serial 'unit_serial = SN11\n'
batch --rig serial.rig
queue SN4 SN5
station strict 'limit.residual_max = 0.1\n'
batch --station strict.station
queue SN6 SN7
fault 1 invalid_sample sample 1000 count 100000000 > flagged.rig
batch --rig flagged.rig
for k in $(seq 40); do fault "$k" lost_sample sample $((3000 + 2500 * k)) count 300 hidden true; done > lost.rig
queue SN8
batch --rig lost.rig
try resume units/SN8

# A fault of the table stops it, and with the next call it goes on, wherever the queue has the unit by then; with the sequence that it began with.
queue SN9 SN10
fault 1 axis_fault axis pitch time_s 60 > fault.rig
batch --rig fault.rig
queue SN10 SN9
cp "$demo" other.seq
try batch queue --dry-run --out units --sequence other.seq

# Hooks: with what happened; their own codes are nobody's.
tell='echo "$TURNCAL_EVENT $TURNCAL_UNIT $TURNCAL_DRY_RUN $TURNCAL_OUTCOME $TURNCAL_MESSAGE" >> told; exit 3'
hooks="hook.done = $tell\nhook.fail = $tell\nhook.needs_operator = $tell\n"
station no-limits "$hooks"
station limits "${hooks}limit.residual_max = 10\n"
station no-pass "${hooks}limit.residual_max = 0.1\n"
station no-database "${hooks}record.database = /proc/nowhere/r.db\n"
station overdue "${hooks}table.id = T7\ntable.calibration_due = 2020-01-31\n"
fault 1 emergency_stop time_s 30 > estop.rig
queue SN12
batch --station no-limits.station
queue SN12 SN13
batch --station limits.station
queue SN14
batch --station no-pass.station
queue SN15 SN16
batch --station no-database.station
batch --station overdue.station
batch --station limits.station --rig estop.rig
grep 'hook' units/SN13/run.log

# Two at once: a group of its own each time; one that drops out stops nobody.
queue SN21 SN22 SN23
batch --at-once 2
try queue queue --again SN21 SN23
batch --at-once 2
queue SN24 SN25 SN26 SN27
fault 1 imu_unplugged time_s 100 unit 2 > gone.rig
batch --at-once 2 --rig gone.rig
batch --at-once 2
queue SN28 SN29 SN30
batch --at-once 2 --rig fault.rig
cat queue.state told
made units
