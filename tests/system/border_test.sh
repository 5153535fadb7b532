#!/usr/bin/env bash
# What crosses the program's border: results that somebody has changed, cells for spreadsheets, serial numbers, standard descriptors,
# modes of files, output into its own source, sequences that cannot be calibrated.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo /tmp)")
trap 'rm -rf "$work"' EXIT
fail() { echo "FAILED: $*" >&2; exit 1; }
# expect CODE TEXT ARGUMENTS...: the text stands in the output, or in the one line of error.
expect() {
  local wanted=$1 text=$2 code=0
  shift 2
  "$binary" "$@" > said.out 2> said.err || code=$?
  [ "$code" = "$wanted" ] || fail "code $code, expected $wanted: $*: $(cat said.err)"
  cat said.out said.err > said
  grep -q -- "$text" said || fail "'$text' is not said: $*: $(cat said)"
}
cd "$work"
cat > station <<'STATION'
format = 1
table.driver = mock
imu.driver = rig
site.latitude_deg = 29.53
site.gravity_mps2 = 9.7914
motion.settle_s = 0.5
record.database = results.db
record.store = store
STATION
demo=$here/sequences/short_demo.seq
run=(run --dry-run --no-diagnosis --station station --sequence "$demo")

# Modes, with a umask that allows everything; a formula for a serial number.
(umask 0; expect 0 'verdict' "${run[@]}" --unit '=1+1' --out out1)
expect 0 'verdict' "${run[@]}" --unit SN2 --operator '@SUM(1)' --out out2
loose=$(find out1 out2 store results.db -type f -perm /022) || true
[ -z "$loose" ] || fail "writable for others: $loose"

# CSV: text that would be a formula is guarded, numbers are not.
expect 0 'SN2' history results.db --format csv
mv said.out all.csv
grep -q "^1,'=1+1,.*,'@SUM\|^1,'=1+1," all.csv || fail "a formula is in the CSV: $(head -c 300 all.csv)"
grep -q ",'@SUM(1)," all.csv || fail "a formula is in the CSV: $(head -c 300 all.csv)"
! grep -qE ",'-?[0-9]" all.csv || fail "a number is guarded"

# Somebody changes a row: value, unit, verdict of the file kept with it.
expect 0 'SN2' history results.db
for change in "UPDATE calibration SET unit = 'SN3' WHERE id = 2" "UPDATE calibration SET time_utc = '2027-01-01T00:00:00Z' WHERE id = 2" \
              "UPDATE calibration SET verdict = 'pass' WHERE id = 2" \
              "UPDATE calibration SET simulated = 0 WHERE id = 2" "UPDATE calibration SET operator = 'X' WHERE id = 2" \
              "UPDATE calibration SET parameter_file = replace(parameter_file, 'n11 = 0', 'n11 = 1') WHERE id = 2"; do
  cp results.db changed.db
  python3 -c "import sqlite3, sys; c = sqlite3.connect('changed.db'); c.execute(sys.argv[1]); c.commit()" "$change"
  expect 1 'row 2' history changed.db
  grep -q '^ *2 .*damaged' said.out || fail "the row is not marked: $change: $(cat said.out)"
  expect 1 'row 2' history changed.db --format csv
  [ "$(wc -l < said.out)" = 2 ] || fail "a damaged row is in the CSV: $change"
done

# A value beside the file: what is shown is the file's, and the check says it.
cp results.db changed.db
python3 -c "import sqlite3; c = sqlite3.connect('changed.db'); c.execute(\"UPDATE value SET value = value * 1.001 WHERE calibration = 2 AND key = 'n11'\"); c.commit()"
shown() { "$binary" history "$1" --parameter n11 --simulated; }
[ "$(shown changed.db)" = "$(shown results.db)" ] || fail "history shows the changed value: $(shown changed.db)"
expect 1 'row 2' records check changed.db

# Serial numbers.
expect 1 'printable characters' "${run[@]}" --unit $'SN\xC2\x9B31m' --out no
expect 1 'printable characters' "${run[@]}" --unit $'SN\xFF' --out no
! LC_ALL=C grep -q $'\xFF\|\xC2\x9B' said || fail "the message has the bytes that it refuses"
[ ! -e no ] || fail "something was made"

# Numbers that are none, and a recording without a rest.
expect 1 'a number above 0' "${run[@]}" --unit A --pace nan --out no
expect 1 'a number above 0' diagnose no --arw nan --vrw 8 --out no
expect 1 'a number from 0 to 1000000' diagnose no --arw 1 --vrw 8 --gyro-bias-instability nan --out no

# An option with a range, one that a script left empty, a folder for a file.
expect 1 "'nan': expected a number from 0.01 to 1000" twin --station station --speed-up nan
expect 1 "'1e300': expected a number from 0.5 to 30" commission --station station --move 1e300
expect 1 'not empty' "${run[@]}" --unit A --listen '' --out no
expect 1 'not empty' "${run[@]}" --unit A --operator '' --out no
expect 1 'not a regular file' history .

# Where a file cannot be made although nothing forbids it.
sed 's,results.db,/proc/no/results.db,' station > elsewhere
expect 1 '/proc: no folder can be made there' check --station elsewhere --sequence "$demo"
expect 1 '/proc: no folder can be made there' run --dry-run --station elsewhere --sequence "$demo" --unit A --out no
[ ! -e no ] || fail "something was made"

# A dry run stands where its station does.
sed 's,29.53,80,' station > north
expect 0 'verdict' run --dry-run --no-diagnosis --station north --sequence "$demo" --unit N --out north_run

# Standard descriptors: full, or closed. What is printed must not get into the first file that is opened.
code=0; "$binary" check --sequence "$demo" > /dev/full 2> said.err || code=$?
[ "$code" = 50 ] && grep -q 'standard output' said.err || fail "code $code on a full output: $(cat said.err)"
code=0; "$binary" history results.db > /dev/full 2> said.err || code=$?
[ "$code" = 50 ] || fail "code $code on a full output"
# A reader that goes away (| head) has read enough: no error, of a result as of a run's lines.
for command in "check --sequence $demo" "predict --sequence $demo" "history results.db"; do
  exec 8> >(exec true); sleep 0.3
  code=0; "$binary" $command >&8 2> said.err || code=$?
  exec 8>&-
  [ "$code" = 0 ] && [ ! -s said.err ] || fail "code $code without a reader: $command: $(cat said.err)"
done
exec 8> >(exec true); sleep 0.3
code=0; "$binary" run --dry-run --capture-only --unit SN5 --sequence "$demo" --out unread >&8 2> said.err || code=$?
exec 8>&-
[ "$code" = 0 ] || fail "code $code of a run without a reader: $(cat said.err)"
expect 1 'nosuch: there is no such folder: expected a record.store' records restore nosuch --unit A
expect 1 'nosuch: there is no such folder: expected a record.store' records restore nosuch --unit A --version 2
for closed in '>&-' '2>&-' '<&-' '<&- >&- 2>&-'; do
  rm -rf closed
  code=0; eval "\"\$binary\" run --dry-run --capture-only --unit SN4 --sequence \"\$demo\" --out closed $closed" > said.out 2> said.err || code=$?
  [ "$code" = 0 ] || fail "code $code with $closed: $(cat said.err)"
  expect 0 'begin' journal closed
  expect 0 'exported' export closed --out "text${#closed}$RANDOM"
done

# Into its own source.
expect 1 'another folder' export out2 --out out2
expect 1 'another folder' export out2/recording.tcr --out ./out2/../out2
expect 0 'exported' export out2 --out text
expect 1 'another folder' import text --out text
expect 1 'another folder' segment text --out text
before=$(sha256sum out2/recording.tcr out2/parameters.conf)
expect 1 'another file' apply out2 --parameters out2/parameters.conf --out out2/recording.tcr
expect 1 'expected a name that ends in' apply out2 --parameters out2/parameters.conf --out out2/parameters.conf
cp out2/parameters.conf out2/parameters.csv
expect 1 'another file' apply out2 --parameters out2/parameters.csv --out out2/parameters.csv
[ "$before" = "$(sha256sum out2/recording.tcr out2/parameters.conf)" ] || fail "the source was changed"

# Too short to calibrate: said before anything moves, by check, run and batch; captured; estimated in part.
cat > short.seq <<'SEQ'
format = 1
name = short
rate_degps = 30
acceleration_degps2 = 60
step 1 "pitch"
  initial H 0 P 0 R 0
  align 2000
  rotate P +90
  dwell 4000
  rotate P -180
  dwell 4000
  rotate P +90
  rotate R +90
  dwell 4000
  rotate R +90
  dwell 4000
SEQ
expect 1 'short does not determine' run --dry-run --unit A --sequence short.seq --out a
[ ! -e a ] || fail "something was made"
printf 'A\n' > queue
expect 1 'short does not determine' batch queue --dry-run --sequence short.seq --out b
[ ! -e b ] && [ ! -e queue.state ] || fail "something was made"
expect 1 'does not determine' check --sequence short.seq
expect 0 'can run this sequence' check --sequence short.seq --partial
expect 0 'complete' run --dry-run --unit A --sequence short.seq --out a --capture-only
# What a recording does not determine has one exit code, whoever finds it.
expect 20 'does not determine' calibrate a --out q
expect 20 '.' diagnose a --out q
expect 0 'verdict *not judged: estimated in part' run --dry-run --no-diagnosis --station station --unit P --sequence short.seq --out p --partial
grep -q '^a11 = ' p/parameters.conf || fail "no estimate"
[ ! -e store/simulated/P ] || fail "an estimate in part was put in use"
expect 0 'can run this sequence' check --sequence "$demo"
! grep -q 'does not determine' said || fail "short_demo determines all"
# A table whose calibration is overdue is refused before anything else is looked at with devices.
{ cat station; echo 'table.id = T7'; echo 'table.calibration_due = 2020-01-31'; } > overdue
expect 1 "table 'T7' was due on 2020-01-31" check --station overdue --sequence "$demo"
expect 0 'can run this sequence' check --station overdue --sequence "$demo" --override-due 'none other here'
echo "the border: good"
