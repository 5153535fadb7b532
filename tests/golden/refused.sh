#!/bin/sh
# What is refused: every line says what was asked for, the error, and the code; what is in the folder is listed at the end, and what was made
# before is not changed (scripts/golden).
name=refused
. ./begin.sh
ln -s ../work/* .
ln -sfn ../work/notes clean  # as clean, and short
dry() { try run --dry-run --sequence "$demo" --unit "$@"; }
mkdir empty
printf 'letter' > letter.txt

# ---- what is typed
try run
try rum
try run --statoin x
try run --sequnce=x --unit A --out o
try --verison
try run --nonsense
try records chek none.db
try help calibrat
try help records chek
try hlep run
try prune line --older-than 30d --list
try database check none.db
try run --settle 2h
try calibrate x --out y --method jiont
try calibrate x --out y --method clsed
try run --quiet --manual --dry-run --unit SN1 --out by_hand

# ---- run, resume, check
try run --dry-run --out out
try run --dry-run --unit SN1
try run --dry-run --unit 'a#b' --out out
dry SN1 --out out --rig missing.rig
dry SN1 --out out --station missing.station
dry SN1 --out letter.txt
dry SN1 --out letter.txt/sub
dry SN1 --out clean
for name in recording.tcr parameters.conf run.log truth.conf recording.partial.tcr; do
  rm -rf old && mkdir old && printf precious > old/$name
  dry SN1 --out old
done
dry '' --out x
try resume clean
try journal letter.txt
try check --station none.station --sequence none.seq
try predict --sequence "$source/README.md"
sequence nodwell <<'SEQ'
  initial H 0 P 0 R 0
  rotate P +90
SEQ
sequence far <<'SEQ'
  initial H 0 P 0 R 0
  align 1000
  rotate P +3000
  dwell 1000
SEQ
try predict --sequence "$source/sequences/fourteen_stp.seq"
sed 's/acceleration_degps2/acceleraton_degps2/' "$demo" > slip.seq
try predict --sequence slip.seq
for bad in nodwell far; do try run --dry-run --unit SN1 --out out --sequence $bad.seq; done
printf 'unit_serial = SN2\n' > unit.rig
dry SN1 --out out --rig unit.rig
dry SN1 --unit SN2 --unit SN1 --out out
dry SN1 --unit 'a#b' --out out
dry 1 $(for k in $(seq 2 17); do echo "--unit $k"; done) --out out
mkdir -p full/SN2 && printf x > full/SN2/recording.tcr
dry SN1 --unit SN2 --out full
for option in --capture-only --partial --no-diagnosis; do dry SN1 --out out --settle 5min $option; done
dry SN1 --out out --verify --capture-only
station silent 'limit.residual_max = 2\n'
dry SN1 --out out --until-sigma --station silent.station
station enough 'stop.sigma.n11 = 3e-6\n'
dry SN1 --out out --until-sigma --station enough.station --capture-only
station open 'stop.sigma.a21 = 1\n'
station zero 'stop.sigma.n33 = 0\n'
station hook 'hook.done = no_such_program_of_ours --now\n'
station outbox 'record.database = r.db\nrecord.outbox = o.db\n'
station limit 'limit.sigma.max = 1\n'
station due 'table.calibration_due = 31.12.2026\n'
station past 'table.id = TT-1\ntable.calibration_due = 2025-12-31\n'
for bad in open zero hook outbox limit due past; do dry SN1 --out out --station $bad.station; done
dry SN1 --out "$(printf 'x%.0s' $(seq 300))"
dry SN1 --unit SN2 --out out --station line.station
for name in postgresql://east:secret@host/turncal 'postgresql://east@host/turncal?password=secret' postgresql://east:sec/secret@host/turncal; do
  station password "record.database = $name\n"
  dry SN1 --out out --station password.station
  try history "$name"
  try shift "$name"
  try records check "$name"
done
try resume nowhere
try resume pair --unit SN8
try resume pair --unit SN9 --unit SN8
# A journal that says complete is believed with the recording that it sealed.
mkdir foreign && cp clean/journal.tcj foreign
try resume foreign
sed 's/^N01 = ./N01 = 9/' clean/parameters.conf > foreign/parameters.conf
try resume foreign
cp clean/parameters.conf foreign
try resume foreign
try run --continue foreign --sequence "$demo"
printf 'something else' > foreign/recording.tcr
try resume foreign
cp clean/recording.tcr foreign
try resume foreign
printf 'of a run that goes on' > foreign/recording.partial.tcr
try resume foreign
try run --continue empty --sequence "$demo"
try run --continue clean
try run --continue clean --sequence "$demo" --unit SN2
try check --station plain.station
station away 'record.database = postgresql://east@127.0.0.1:1/turncal\n'
try check --station away.station --sequence "$steps"

# ---- a table by hand, a live one, a chamber
station hand 'axis.pitch.soft_max_deg = 80\n'
station low 'axis.pitch.soft_min_deg = 10\n'
station french 'operator.language = fr\n'
for bad in hand low french; do dry SN1 --manual --out out --station $bad.station; done
live live 'table.address = 127.0.0.1:1\nimu.2.device = none2\n'
try run --station live.station --unit U --out r --pace 2
try run --station live.station --unit U --out r --rig x
try run --station live.station --unit U --out r | sed 's/ [0-9.]* s  step/ # s  step/'  # of the wall's clock
try run --station live.station --unit A --unit B --unit C --out r
try twin --station "$source/orchestrator/stations/mock.station"
try twin --station "$source/orchestrator/stations/twin.station" --table tcp:x
printf 'A\n' > live.queue
try batch live.queue --station live.station --out r --at-once 3
station own 'chamber.file = own.chamber\nchamber.limit_unit_c = 60\nchamber.settle_s = 60\n'
dry SN1 --out hot --station own.station --temperature 61
dry SN1 --out hot --temperature 30
campaign() { printf "format = 1\nunit = SN1\nstation = own.station\nsequence = $demo\n$1" > own.campaign; shift; try campaign own.campaign "$@"; }
campaign 'temperatures_c = -20, 0, 20, 40, 10\n'
campaign 'temperatures_c = -20, 0, 20, 40, 10\n' --plan
campaign 'temperatures_c = 20\n' --plan
campaign 'temperatures_c = 20, 70\n' --out all --dry-run
campaign 'temperatures_c = 20, 30\nleg.3.switch_on = true\n' --plan
printf 'noise.seed = 1\n' > own.rig
campaign 'temperatures_c = 20, 30\nrig = own.rig\n' --out all --dry-run
cp plain.station own.station
campaign 'temperatures_c = 20, 30\n' --plan

# ---- recordings that are damaged, and what is made of one
recording() {
  mkdir "$1"
  printf 'format = 1\nsample_period_s = 0.005\nlatitude_deg = 29.53\ngravity_mps2 = 9.7914\nunit_serial = SN1\ngyro_increment = pulses\naccel_increment = pulses\naccel_pulse_mps = 0.0005\n' > "$1/recording.conf"
  printf 'step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n1,static,0,4000,0,0,0\n' > "$1/segments.csv"
  awk 'BEGIN { print "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"; for (i = 0; i < 4000; ++i) print i ",0,0,0,0,98,0" }' > "$1/imu.csv"
}
for bad in empty_csv nan empty_conf unknown_key overlap kind no_rest no_csv; do recording $bad; done
: > empty_csv/imu.csv
sed -i 's/^100,0,0/100,0,nan/' nan/imu.csv
: > empty_conf/recording.conf
printf 'colour = red\n' >> unknown_key/recording.conf
sed -i 's/4000,0,0,0/3000,0,0,0\n1,static,2999,4000,0,0,0/' overlap/segments.csv
sed -i 's/static/resting/' kind/segments.csv
sed -i 's/static,0,4000,0,0/rotate,0,4000,0,90/' no_rest/segments.csv
rm no_csv/imu.csv
for bad in empty_csv nan empty_conf unknown_key overlap kind no_csv; do
  try import $bad --out out
  try calibrate $bad --out out
  try calibrate $bad --out out/deep/down --method closed-form
done
try calibrate no_rest --out out
try calibrate no_rest --partial --out out
try diagnose no_rest --out out
try calibrate clean clean --out out
try calibrate effect clean --out out
try calibrate clean capture --method closed-form --out out
try calibrate clean --out clean
try calibrate clean --out effect
try diagnose clean --out effect
try calibrate clean --out two
try calibrate clean --out x --part P7
try calibrate clean --out x --prior clean
try calibrate nothing --out y
try diagnose
try diagnose clean
try diagnose clean --out clean
try import text --out imported
try convert clean/run.log
try diagnose clean/recording.tcr --out ./clean/
try diagnose clean --holdout effect --out effect
try diagnose clean --holdout missing --out out
try diagnose clean --holdout clean --out out
try diagnose clean --holdout effect --out out
try diagnose clean --out letter.txt
try diagnose clean --out out --arw 0.002
try diagnose clean --out out --arw -1 --vrw 8
try diagnose clean --out out --gyro-bias-instability 0.001
mkdir damaged && head -c 2000 clean/parameters.conf > damaged/parameters.conf
try calibrate clean --out damaged
apply() { try apply clean --out out.csv --parameters "$1"; }
sed 's/^N01 = ./N01 = 9/' clean/parameters.conf > digit.conf
sed '/^a22 = /d' clean/parameters.conf > missing.conf
: > empty.conf
for bad in digit.conf missing.conf empty.conf nowhere.conf effect/parameters.conf; do apply $bad; done
for out in clean/journal.tcj clean no/such/folder/out.csv rest.xyz; do try apply clean --parameters clean/parameters.conf --out $out; done
try apply clean --parameters clean/parameters.conf --out r.tcr --as rates
for more in '' '--as increments'; do try apply clean --parameters clean/parameters.conf --out i.mcap $more; done
for form in csv tcr npy mat; do printf 'x' > not.$form && try apply clean --parameters clean/parameters.conf --out not.$form; done
mkdir folder.npy
try export clean --out folder.npy
try export clean --out rest.csv
try convert clean/parameters.conf
try convert nothing.conf --yaml c.yaml
for form in --header --binary --yaml; do try convert clean/parameters.conf $form clean/parameters.conf; done
printf 'something = else\n' > other.conf
try convert clean/parameters.conf --yaml other.conf
try convert clean/parameters.conf --header c.h --yaml ./c.h
try convert clean/parameters.conf --binary nowhere/c.bin
try convert clean/parameters.conf --header x.h --yaml nowhere/x.yaml
try allan clean --against clean/parameters.conf --out letter.txt
printf 'gyro.columns = gx, gy, gz\ngyro.unit = rad/s\naccel.columns = ax, ay, az\naccel.unit = m/s^2\ntime.column = t\ngravity_mps2 = 9.8\nunit_serial = A\n' > allan.map
at_rest() { awk -v n="$1" -v rate="$2" 'BEGIN { print "t,gx,gy,gz,ax,ay,az"; for (k = 0; k < n; ++k) print 0.1 * k "," (k > 300 ? rate : 0) + 0.001 * (k % 7) ",0.001,0.002,0.01,9.8,0.02" }'; }
at_rest 600 0.5 > turn.csv
at_rest 50 0 > short.csv
for table in turn short; do try allan $table.csv --map allan.map; done
sed "s/^1.5,/1.5,7e300,0,0,0,0,0\n&/" short.csv > flip.csv
try import flip.csv --map allan.map --skip-bad-rows --out flip

# ---- plans
try design --separate accel_delay --out x.seq
try design --separate accel_delay --from clean --sigma y --out x.seq
printf 'N01 = 0.0003\n' > want.conf
printf 'N01 = 0.0005\n' > hours.conf
printf 'N99 = 1\n' > unknown.conf
for sigma in want hours unknown; do try design --sigma $sigma.conf --out x.seq; done
try design --out x.seq
try design --time 1s --out x.seq
try design --time 1h --sigma want.conf --out x.seq
try design --time 1h --out letter.txt
try design --time 1h --axes yaw --out x.seq
try design --time 1h --rate 500 --out x.seq
try design --time 1h --out missing/x.seq
for hours in 3600 25h 2d h nan -1h 2h-1h ''; do try predict --sequence "$steps" --navigate "$hours"; done

# ---- verify, navigate, thermal
verify() { try verify --parameters clean/parameters.conf --out v "$@"; }
try verify
try verify --parameters clean/parameters.conf
verify
verify --dry-run --unit SN8
verify --dry-run --unit SN1 --sequence nothing.seq
verify --recording clean --dry-run
verify --recording no_rest
try verify --references none.csv
try verify --references none.csv --dry-run
sequence side <<'SEQ'
  initial H 0 P 0 R 90
  align 6000
  dwell 6000
  dwell 6000
SEQ
sequence once <<'SEQ'
  initial H 0 P 0 R 0
  align 6000
  dwell 6000
SEQ
sequence ninety <<'SEQ'
  initial H 0 P 0 R 0
  align 6000
  dwell 6000
  dwell 6000
  rotate H +90
  dwell 6000
  rotate H +90
  dwell 6000
  dwell 6000
SEQ
sequence brief <<'SEQ'
  initial H 0 P 0 R 0
  align 6000
  dwell 2000
  dwell 2000
SEQ
turncal run --quiet --dry-run --capture-only --unit SN1 --sequence side.seq --out side
verify --recording side
for bad in side once ninety brief; do verify --dry-run --unit SN1 --sequence $bad.seq; done
sed 's/^site.latitude_deg.*/site.latitude_deg = -88/; s/^site.gravity_mps2.*/&\nverify.run = true/' plain.station > north.station
printf 'site.latitude_deg = 88\n' > north.rig
printf 'SN1\n' > north.queue
verify --dry-run --unit SN1 --station north.station
try run --dry-run --unit SN1 --station north.station --out v
try run --dry-run --unit SN1 --rig north.rig --verify --out v
try batch north.queue --dry-run --station north.station --out v
try check --station north.station --sequence "$steps"
head=heading_deg,roll_deg,pitch_deg,reference_heading_deg,reference_roll_deg,reference_pitch_deg
for rows in '30,0,0,30,0,0.0' '' '20,zero,0,20,0,0\n' '20,0,0,20,0,0,7\n' '2000,0,0,20,0,0\n'; do
  printf "$head\n20,0,0,20,0,0\n$rows" > bad.csv
  try verify --references bad.csv
done
# Readings that can be judged.
for rows in '20.186751,0.009256,-0.017475,20.186751,0.009256,-0.017475\n74.261759,0.017019,0.052811,74.262023,0.017211,0.052833\n20.017897,0.012601,-0.013012,20.017913,0.012871,-0.014151\n' \
            '20,0,0,20,0,0\n359.995,0,0,0.005,0,0\n' '20,0,0,20,0,0\n100.3,0.06,0,100.291,0,0.06\n'; do
  printf "$head\n$rows" > readings.csv
  try verify --references readings.csv
  try verify --references readings.csv --station head.station --format json
done
navigate() { try navigate capture --out nav --parameters "$@"; }
try navigate capture --out nav
try navigate nothing --parameters clean/parameters.conf --out nav
try navigate capture --parameters clean/parameters.conf --out capture
try navigate capture --parameters clean/parameters.conf --out letter.txt
navigate nothing.conf
navigate digit.conf
for more in '--align 5000s' '--for 5000s' '--from 700s --to 600s' '--from 1e300' '--from 600s' '--align nan' '--branches 0' '--branches 1e3' '--against nothing.conf'; do
  navigate clean/parameters.conf $more
done
reference() { printf "$1" > bad.csv; navigate clean/parameters.conf --reference bad.csv; }
head=time_s,latitude_deg,longitude_deg
navigate clean/parameters.conf --reference nothing.csv
reference "$head\n0,29.53,10\n"
reference "$head\n0,29.53,10\n5,29.53,10\n4,29.53,10\n"
reference "$head\n0,29.53,10\n5,89,10\n"
reference 'time_s,latitude_deg\n0,29.53\n5,29.53\n'
reference "$head,velocity_east_mps\n0,29.53,10,1\n5,29.53,10,1\n"
reference "$head\n0,40,10\n2000,40,10\n"
reference "$head\n0,29.53,10\n200,29.53,10\n"
reference "$head\n0,29.53,10\n2000,29.53,10.5\n"
try thermal clean clean --out warm
try thermal clean --out warm
try thermal clean effect --out warm
try thermal clean joint --out warm --temperature clean=hot
try thermal clean joint --out warm --temperature leg9=60
try certificate clean
try certificate clean --check certificate.html
try certificate --check letter.txt
try certificate clean --station plain.station --out c.html
try certificate clean --station plain.station --specimen --out c.html --pdf ./c.html
try certificate nothing --specimen --station plain.station --out c.html

# ---- queues, databases, archives
printf 'SN1 # a comment\n# another\nSN#3\n' > marked
try batch nowhere --dry-run --out units
try batch marked --dry-run --out units
try batch north.queue --dry-run --out units --station missing.station
try queue queue --add SN20
try queue queue --remove SN99
try queue queue --again SN23
printf 'SN1\nSN1\n' > doubled
try queue doubled
try history results.db --simulated --together --report results.db
for chart in --control '--parameter N01' '--report mixed.html'; do try history results.db --simulated $chart; done
try history results.db --control
try history results.db --compare 1 2
try history results.db --compare 1 99
try history results.db --compare 1 1
try history results.db --parameter N99
try history results.db --format csv --control
for day in yesterday 2026-02-30 2026-13 2026-02-01T25:00:00Z 202 2026- 2026-1-01; do try history results.db --from $day; done
for one in --control --report=r.html --parameter=N01; do try history results.db --attempts $one; done
for command in history shift; do try $command results.db --station west; done
try history results.db --verdict bad
try shift results.db --from 2026-02 --to 2026-01-31
try shift results.db --simulated --pdf
printf '%4096s' x > garbage.db
try history garbage.db
try history none.db
try records check garbage.db
try records check missing.db
try records backup results.db
try records backup results.db --out letter.txt
try records backup results.db --out results.db
try records copy results.db
try records copy results.db results.db
try records check results.db other.db
try records roles results.db
try records prune line
try records prune line --older-than 0d
try records prune nowhere --older-than 1d
try records restore parameters --unit SN20
try records restore parameters --unit SN20 --version 1
try records restore parameters --unit SN7
try records restore parameters --unit SN20 --simulated --version 30
list() { printf "$1" > list.csv; try recalibrate list.csv --out x; }
list 'path,station\nSN1,a\n'
list 'recording,colour\nSN1,a\n'
list 'recording,station\nSN1\n'
list 'recording,measured_utc\nclean,yesterday\n'
try recalibrate nowhere --out x
try recalibrate clean --out x --chunk 2 2
try recalibrate clean --out x --engine slurm --chunk 0 2
try recalibrate clean --out x --as-version ../evil
try recalibrate clean --out x --chunks 2
(PATH=$(dirname "$(command -v turncal)"); try recalibrate clean --out x --engine slurm)
mkdir 'with, comma' && cp clean/recording.tcr 'with, comma' && try recalibrate 'with, comma' --out x --engine slurm
try fleet diagnose capture
try fleet diagnose store --by station --by station

# ---- the page of all stations
serve() { printf "$1" > serve.conf; shift; try serve serve.conf "$@"; }
east='station.1 = east\nstation.1.queue = queue\nstation.1.runs = runs\n'
try serve none
serve 'station.1 = east\nstation.1.queue = queue\n'
serve "${east}station.2 = east\nstation.2.queue = q\nstation.2.runs = r\n"
serve "${east}serve.password = x\n"
serve "${east}serve.password_file = operators\n"
serve "${east}serve.database = postgresql://ana:x@host/line\n"
serve "${east}alert.command = true\n"
serve "${east}alert.command = true\nalert.record = none/alerts\n"
printf 'ana:secret\n' > operators && chmod 600 operators
serve "${east}serve.password_file = operators\n"
printf 'ana:$6$turncaltest$Ca3hHOX/8w81m.o69BWfLBp6laKsAnyBM.2euUeTvSVC1lnGTC5ljBbWVMKUnvJPVZsjRyAF80Zn8AABDxDyW1\n' > operators
serve "${east}serve.password_file = operators\n" --listen 0.0.0.0:0
chmod 644 operators
serve "${east}serve.password_file = operators\n"
find . ! -type l ! -name .lock | LC_ALL=C sort
