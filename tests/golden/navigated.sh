#!/bin/sh
# Navigation on data that no unit gives, or that are not what they are called.
name=navigated
. ./begin.sh
ln -s ../work/clean ../work/capture ../work/contradicted .
turncal export capture --out text > said
parameters=clean/parameters.conf
# changed NAME AWK: the recording with this done to every sample.
changed() { mkdir "$1" && cp text/*.conf text/segments.csv "$1" && awk -F, -v OFS=, "NR > 1 { $2 } { print }" text/imu.csv > "$1/imu.csv"; }
navigate() { rm -rf nav; try navigate "$1" --parameters $parameters --out nav --align 60s --branches 1 $2 && grep -E 'filled|fault|felt|heading_deg|rms' nav/navigation.conf; }
navigate text
changed glitch 'if ($1 == 20000) $2 = 20000'
changed word 'if ($1 == 20000) $2 = -2147483647'
changed knock 'if ($1 == 20000) $6 = 2000'
changed dead-gyros '$2 = $3 = $4 = 0'
changed dead-accelerometers '$5 = $6 = $7 = 0'
changed far 'if ($1 >= 20000 && $1 < 20100) $5 = 2147483647'
changed jump 'if ($1 > 20000) $1 += 200000000'
changed turning '$4 = 96'
for recording in glitch word knock dead-gyros dead-accelerometers far jump turning; do navigate $recording; done
changed no-segments ''
head -n 1 text/segments.csv > no-segments/segments.csv
navigate no-segments '--to 300s'
# A gravity that is not felt, and nearly; another latitude; a period that is not the parameters'.
for change in gravity_mps2/9.7834 gravity_mps2/9.78 latitude_deg/39.53 sample_period_s/0.0025; do
  rm -rf told && cp -r text told && sed -i "s/^${change%/*} = .*/${change%/*} = ${change#*/}/" told/recording.conf
  navigate told
done
# Parameters that are not trusted.
try navigate capture --parameters contradicted/parameters.conf --out doubtful --align 60s --branches 1
grep trusted doubtful/navigation.conf
# What `apply` left is navigated as it is.
turncal apply capture --parameters $parameters --out applied.tcr > said
parameters=
rm -rf nav
try navigate applied.tcr --out nav --align 60s --branches 1
grep heading_deg nav/navigation.conf
