#!/bin/sh
# Several units on one table: results of their own, a unit that drops out, limits of one.
name=groups
. ./begin.sh
group() { out=$1; shift; run --unit SN1 --unit SN2 --unit SN3 --out "$out" "$@"; }
# The units of a run that are those of another.
same() { for unit in SN1 SN2 SN3; do cmp -s "$1/$unit/$3" "$2/$unit/$3" && echo "$unit of $1 and $2: the same $3"; done; }
run --unit SN1 --out alone
group good
cmp alone/parameters.conf good/SN1/parameters.conf && cmp alone/recording.tcr good/SN1/recording.tcr && echo "the first as alone"
for gone in 1 2 3; do
  fault 1 imu_unplugged time_s 100 unit $gone > gone.rig
  group gone$gone --rig gone.rig
  same good gone$gone recording.tcr
  same good gone$gone parameters.conf
  try resume gone$gone
done
pair() { run --unit SN1 --unit SN2 --out "$1" --rig "$1.rig"; }
fault 1 imu_silent time_s 100 duration_s 60 unit 2 > silent.rig
fault 1 invalid_sample sample 1700 count 100000 unit 1 > never-good.rig
rig another 'unit_serial = SN9\n'
{ fault 1 imu_unplugged time_s 100 unit 1; fault 2 imu_unplugged time_s 120 unit 2; } > all-gone.rig
fault 1 axis_fault axis pitch time_s 60 > table.rig
fault 1 lost_sample sample 1700 count 2 unit 2 > lost.rig
for out in silent never-good another all-gone table lost; do pair $out; done
# a11 of the three units: 1.052, 0.995, 1.036.
tell='echo "$TURNCAL_EVENT $TURNCAL_UNIT $TURNCAL_FOLDER" >> told'
station limits "limit.a11.min = 1.02\nrecord.database = r.db\nrecord.store = kept\nhook.done = $tell\nhook.fail = $tell\n"
group judged --station limits.station
group both --station limits.station --rig gone.rig
try history r.db
cat told
made good gone* silent never-good another all-gone table lost judged both kept
