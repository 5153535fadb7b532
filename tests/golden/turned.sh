#!/bin/sh
# A unit turned by hand: a gyro that is dead, too few rests, numbers in another unit; what is not trusted leaves no parameters. And what
# `allan` says of rests.
name=turned
. ./begin.sh
turncal export ../work/segmented --out text > said
# changed NAME AWK: the recording with this done to every sample.
changed() { mkdir "$1" && cp text/*.conf text/segments.csv "$1" && awk -F, -v OFS=, -v CONVFMT=%.17g "NR > 1 { $2 } { print }" text/imu.csv > "$1/imu.csv"; }
# table NAME: its samples alone, without their numbers.
table() { sed 's/^[^,]*,//' "$1/imu.csv" > "$1.csv"; }
map() { printf "rate_hz = 200\ngyro.columns = gyro_x, gyro_y, gyro_z\ngyro.unit = rad\naccel.columns = accel_x, accel_y, accel_z\naccel.unit = m/s\ngravity_mps2 = 9.7914\nunit_serial = SN1\n$1" > table.map; }

changed dead '$3 = 0'
table dead
map ''
try import dead --out binary
try import dead.csv --map table.map --out dead-table
for recording in dead binary dead-table; do try calibrate $recording --out out; done

mkdir few && cp text/* few && head -n 8 text/segments.csv > few/segments.csv
for command in diagnose calibrate; do try $command few --out out; done
try calibrate text --method closed-form --out out
try diagnose text --arw 0.1 --vrw 10 --out out

changed in_g '$5 = $5 / 9.80665; $6 = $6 / 9.80665; $7 = $7 / 9.80665'
try diagnose text --out out
cp ../work/clean/parameters.conf out  # as an earlier one
try diagnose in_g --out out
cat out/diagnosis.conf
ls out
try calibrate in_g --out calibrated
try segment in_g --out again
try allan again
table text
for scale in 0.75 1 1.3; do
  map "accel.scale = $scale\n"
  try import text.csv --map table.map --out scaled-$scale
done

# One wild sample is left out, whatever its size; a limit is no number to read as one.
map ''
sed -i 's/^rate_hz.*/rate_hz = 50/; s/gyro.unit = rad/&\/s/; s/accel.unit = m\/s/&^2/' table.map
for wild in 0.02 1 50; do
  awk -v wild=$wild 'function normal(   i, x) { for (i = 0; i < 12; ++i) { s = (s * 16807) % 2147483647; x += s / 2147483647 } return x - 6 }
    BEGIN { s = 4; print "gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"; for (k = 0; k < 3000; ++k)
      printf "%.9f,%.9f,%.9f,%.9f,%.9f,%.9f\n", 7e-4 * normal() + (k == 1500 ? wild : 0), 7e-4 * normal(), 7e-4 * normal(), 7e-3 * normal(), 7e-3 * normal(), 9.7914 + 7e-3 * normal() }' > wild.csv
  try allan wild.csv --map table.map --format json
done
find . ! -type l ! -name .lock | LC_ALL=C sort
