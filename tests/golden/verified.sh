#!/bin/sh
# North seeking behind the calibration, in the same walk of the table: what is calibrated is not changed by it, its outcome is the unit's.
name=verified
. ./begin.sh
{ cat head.station; printf 'limit.heading_deg = 0.2\n'; } > plain.station
station verifying 'verify.run = true\nrecord.database = rows.db\n'
seek() { try run --dry-run --unit SN7 --no-diagnosis --station "$1.station" --out "$2" $3; }
seek plain plain "--sequence $demo"
seek verifying v "--sequence $demo"
numbers() { grep -E '^(sigma\.)?[NAna][0-9]+ = ' "$1"; }
numbers plain/parameters.conf > plain.numbers
numbers v/parameters.conf | cmp - plain.numbers && echo "calibrated as without"
turncal calibrate v --out repeated > said
numbers repeated/parameters.conf | cmp - plain.numbers && echo "repeated: calibrated as without"
cat v/verification.conf
try journal v
try history rows.db --attempts --format csv
# The certificate takes the verification of this result, and of no other.
certify() { try certificate v --station plain.station --specimen --out certificate.html; }
certify
cp v/verification.conf whole
turncal calibrate plain --method closed-form --out closed > said
for parameters in closed/parameters.conf v/parameters.conf; do
  try verify --recording v --from-step 15 --out v --parameters $parameters
  certify
done
cp whole v/verification.conf
# Interrupted in the north seeking.
TURNCAL_FAULT_POINT=2600 TURNCAL_FAULT_MODE=kill turncal run --dry-run --unit SN7 --no-diagnosis --sequence "$demo" --station verifying.station --out killed
tail -n 3 killed/run.log
try resume killed
for file in parameters.conf verification.conf; do cmp killed/$file v/$file && echo "killed: the same $file"; done
# Gyros that cannot keep the limit in this time, and a level limit below the noise: nothing is decided, the unit waits, its file is not used.
cp head.station paper.station
seek paper paper --verify
station strict 'limit.level_deg = 0.000001\nlimit.A01.max = 1\nrecord.store = kept\n'
try run --dry-run --unit SN7 --sequence "$demo" --station strict.station --out strict --verify
made v killed paper strict
