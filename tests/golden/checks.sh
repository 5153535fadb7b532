#!/bin/sh
# What `check` says of a station and a sequence: what they cannot do, what is not yet there, what is only guessed.
name=checks
. ./begin.sh
sequence turn <<'SEQ'
  determines n11
  initial H 0 P 0 R 0
  align 12000
  rotate R +360
  dwell 20000
step 2
  initial H 0 P 0 R 0
  align 200
SEQ
check() { try check --station "$1.station" --sequence "${2:-turn.seq}" $3; }
station narrow 'axis.roll.soft_max_deg = 180\naxis.roll.wrap_deg = 0\naxis.roll.max_rate_degps = 5\n'
check narrow

# A table that is not commissioned yet, its address not set, and two guesses.
live table 'table.address = SET-ME:502\n'
sed -i -e 's/^commissioned = true/commissioned = false/' -e '/^write.stop =/s/$/ # [guess]/' -e '/^link.kind =/s/$/ # [guess]/' twin.map
check table
try check --station table.station --explain
sed -i 's/^commissioned = false/commissioned = true/' twin.map
sed -i 's/SET-ME/ttyUSB0/' table.station
check table
# One line for table and unit; a unit that is none.
sed -i 's/^link.kind = tcp/link.kind = rtu\nlink.baud = 115200/' twin.map
sed 's,ttyUSB0:502,/dev/ttyX,; s,device = none,device = /dev/ttyX,' table.station > one.station
check one
sed 's,ttyUSB0:502,/dev/ttyX,; s/^imu.driver.*/imu.driver = rig/; /^imu.frame/d; /^imu.device/d' table.station > mixed.station
check mixed

# The north seeking behind the calibration; not behind steps that need --partial.
travel='axis.heading.soft_min_deg = -190\naxis.heading.soft_max_deg = 190\n'
station plain-travel "$travel"
station seeking-travel "${travel}verify.run = true\n"
station seeking 'verify.run = true\n'
axes=$source/sequences/two_axes.seq
check plain-travel "$axes"
check seeking-travel "$axes"
check seeking "$axes"
check plain "$axes" --verify
check seeking

station rigged 'rig.file = my.rig\n'
check rigged
rig my 'no.such.key = 1\n'
check rigged
