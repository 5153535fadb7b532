#!/bin/sh
# What `apply` writes, in every form: increments or rates, samples that are marked, messages that import reads again.
name=applied
. ./begin.sh
ln -s ../work/capture ../work/clean .
apply() { try apply "$1" --parameters clean/parameters.conf --out "$2" $3; }
for as in rates increments; do
  for form in csv npy mat; do apply capture $as.$form "--as $as"; done
  head -n 3 $as.csv
done
apply capture increments.tcr
apply capture messages.mcap '--as rates'
try import messages.mcap --out back
turncal export back --out back-text > said
turncal export increments.tcr --out text-increments > said
for folder in back-text text-increments; do cat $folder/recording.conf; sed -n '20000,20002p' $folder/imu.csv; done
# Samples that are marked stay so; to ROS a bad one is not measured.
turncal export capture --out marked > said
printf 'sample,flags\n100,1\n101,1\n' > marked/flags.csv
for as in rates increments; do
  apply marked marked-$as.csv "--as $as"
  sed -n '1p; 100,104p' marked-$as.csv
done
apply marked marked.mcap '--as rates'
try import marked.mcap --out marked-back
try import marked.mcap --out marked-back --skip-bad-rows
sha256sum ./*.csv ./*.npy ./*.mat ./*.tcr back/recording.tcr marked-back/recording.tcr
