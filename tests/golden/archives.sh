#!/bin/sh
# An archive of recordings: each once, damage named, versions beside one another, as a fleet; a database of them.
name=archives
. ./begin.sh
mkdir archive archive/copy
for unit in SN1 SN2; do turncal run --dry-run --quiet --no-diagnosis --sequence four.seq --unit $unit --out archive/$unit; done
cp archive/SN1/recording.tcr archive/copy
: > archive/empty.tcr
head -c 40 archive/SN2/recording.tcr > archive/damaged.tcr
again() { try recalibrate archive --no-diagnosis --threads 1 --out "$@"; }
again old-new --as-version old
again old-new --as-version old
again old-new --as-version new --against old
head -c 20000 archive/SN1/recording.tcr > archive/cut.tcr
{ head -c 20000 archive/SN1/recording.tcr; printf '\125'; tail -c +20002 archive/SN1/recording.tcr; } > archive/flipped.tcr
again damaged-too --as-version v
rm damaged-too/v/*/parameters.conf
again damaged-too --as-version v
for chunk in 0 1; do again chunks --chunk $chunk 2 --as-version v; done
cat damaged-too/v/recordings.csv chunks/v/recordings*.csv
made old-new damaged-too chunks

# What the list says stands in the files.
printf 'recording,station,lot,measured_utc\narchive/SN1,east,7,2026-01-31T12:00:00Z\narchive/SN2,west,8,2026-02-01T12:00:00Z\n' > list.csv
try recalibrate list.csv --out listed --no-diagnosis --threads 1
try fleet diagnose listed --by station --by lot --by month --page fleet.html
try fleet diagnose archive/SN1 --format json

# Rows of a station's database are an archive and a fleet, as the files are.
station line 'station.name = east\nlimit.residual_max = 2\nrecord.database = rows.db\n'
for unit in SN3 SN4; do run --quiet --no-diagnosis --station line.station --part P7 --lot "lot $unit" --unit $unit --out runs/$unit; done
turncal fleet diagnose runs --format csv > files.csv
turncal fleet diagnose rows.db --format csv | cmp - files.csv && echo "rows as files"
try fleet diagnose rows.db --by lot --by part --by version --by month
try records copy rows.db copy.db
turncal fleet diagnose copy.db --format csv | cmp - files.csv && echo "copied rows as files"
rm -r runs/SN4
try recalibrate rows.db --no-diagnosis --threads 1 --out of-rows
sha256sum fleet.html
