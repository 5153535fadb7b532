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
