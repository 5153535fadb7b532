#!/bin/sh
# A campaign in a chamber: its legs are made once and taken together; what is not there is made, what nobody needs is not.
name=campaigns
. ./begin.sh
station own 'chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\n'
rig own 'temperature.rise_c = 0\neffect.gyro_bias_temperature.x = 0.01\n'
campaign() {
  printf "format = 1\nunit = SN1\nstation = own.station\nsequence = four.seq\n$1" > own.campaign
  shift
  try campaign own.campaign --dry-run --no-diagnosis "$@"
}
legs='temperatures_c = 10, 40, 25\nrig = own.rig\nleg.3.switch_on = true\n'
campaign "$legs" --out all
cat all/leg-0*/leg.conf all/thermal.conf
campaign 'temperatures_c = 10, 30, 25\nrig = own.rig\n' --out all
campaign "$legs" --out all
rm -r all/leg-02
campaign "$legs" --out all
cat all/thermal.conf
# The legs that are left when everything can be told, and well enough, are not made; the same when it is asked again.
for degph in 1 1 1e-5; do
  station own "chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\nstop.sigma.N01 = $degph\n"
  campaign 'temperatures_c = 10, 40, 25, 10, 25\nleg.4.switch_on = true\n' --out enough --until-sigma --format json
  ls enough
done
made all enough

# Legs that were measured elsewhere, one without a thermometer; and what is made of parameters that follow the temperature.
legs='all/leg-01 all/leg-02 bare-leg'
turncal export all/leg-03 --out bare > said
cut -d, -f1-7 bare/imu.csv > bare.csv && mv bare.csv bare/imu.csv
turncal calibrate bare --out bare-leg > said
try thermal $legs --out warm
printf 'temperature_c = 25\ndirection = sideways\n' > bare-leg/leg.conf
try thermal $legs --out warm
rm bare-leg/leg.conf
try thermal $legs --out warm --temperature bare-leg=25 --reference 20
cat warm/thermal.conf
try convert warm/parameters.conf --header warm.h
grep -A 4 temperature warm.h
rig hot 'temperature.start_c = 60\ntemperature.rise_c = 0\n'
try run --quiet --dry-run --capture-only --unit SN1 --sequence four.seq --rig hot.rig --out hot
for recording in all/leg-02 hot; do try apply $recording --parameters warm/parameters.conf --out ${recording##*/}.csv; done
# A thermometer that falls silent for more than a minute is none.
turncal export all/leg-02 --out silent > said
awk -F, -v OFS=, 'NR > 100 && NR < 14100 { $8 = "" } { print }' silent/imu.csv > silent.csv && mv silent.csv silent/imu.csv
try apply silent --parameters warm/parameters.conf --out silent.csv
sha256sum leg-02.csv hot.csv
