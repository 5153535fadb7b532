#!/usr/bin/env bash
# shellcheck disable=SC2015
# benchmarks/run and benchmarks/score on the two shortest cases: the model agrees with closed forms, all answers are the sealed ones, turncal
# scores, a wrong parameter file scores worse, and an answer or a seal that was changed is refused.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
program=$(realpath "${TURNCAL_BINARY:-$here/build/release/turncal}")
python=/usr/bin/python3
"$python" -c 'import numpy' 2> /dev/null || { echo "skipped: python3 has no numpy"; exit 0; }
export PYTHONDONTWRITEBYTECODE=1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

"$python" "$here/benchmarks/unit_model.py" > said || { echo "FAILED: the model"; cat said; exit 1; }
env -u IMU_TK -u PSINS "$here/benchmarks/run" --turncal "$program" --out out --case 3 8 --format json > rows.json 2> said || { echo "FAILED: run"; cat said; exit 1; }
"$python" - "$here" << 'PYTHON'
import json, sys
sys.path.insert(0, sys.argv[1] + "/benchmarks")
import cases
assert len(cases.seals()) == len(cases.CASES) == 13
for n in range(1, 14):
    assert cases.seals()[f"{n:02}"] == cases.seal(cases.draw(n)[0]), n
    assert cases.seal(cases.draw(n, 1)[0]) not in cases.seals().values()
rows = {(r["case"], r["program"]): r for r in json.load(open("rows.json"))}
assert len(rows) == 6, list(rows)
mems, diagnosed = rows[3, "joint"], rows[8, "diagnose"]
# Bounds three times what was measured, or more: noise differs with the version of numpy.
for r, most in ((mems, (150, 40, 40, 8, 100, 40)), (diagnosed, (30, 15, 8, 1.5, 60, 8))):
    for key, bound in zip("accel_ug accel_ppm accel_arcsec gyro_degph gyro_ppm gyro_arcsec".split(), most):
        assert 0 < r[key] < bound, (key, r)
    assert 0.2 < r["nees"] < 3 and r["dof"] == 21 and r["user_s"] > 0, r
assert diagnosed["names"] == "right" and diagnosed["verdict"] == "extended", diagnosed
assert abs(diagnosed["effects_over_sigma"]["effect.accel_second_order.y"]) < 5, diagnosed
assert "names" not in mems and "refused" in rows[8, "closed form"], rows
# What nobody told of is worse to leave out than to name.
assert rows[8, "joint"]["accel_ug"] > 5 * diagnosed["accel_ug"] and rows[8, "joint"]["trusted"] == "false", rows
PYTHON

# Somebody else's file: right, wrong, without sigmas, in another body frame.
score() { "$here/benchmarks/score" "$@"; }
answer=out/answers/08.conf
found=out/found/08/diagnose/parameters.conf
score $answer $found --format json > right.json
awk '$1 == "n11" { $3 *= 1.0002 } $1 == "A02" { $3 += 1e-3 } { print }' $found > wrong.conf
score $answer wrong.conf --format json > wrong.json
grep -E '^[NAna][0-9]' $found > bare.conf
score $answer bare.conf --format json > bare.json
sed 's/accel_second_order/gyro_magnetic/' $found > named.conf
score $answer named.conf --format json > named.json
sed '/^#/d' $answer > truth.conf
score $answer truth.conf --format json > truth.json
"$python" << 'PYTHON'
import json
right, wrong, bare, named, truth = (json.load(open(f + ".json")) for f in ("right", "wrong", "bare", "named", "truth"))
assert 100 < wrong["gyro_ppm"] < 150 and 500 < wrong["accel_ug"] < 650, wrong     # 200 ppm of one of three, 1000 ug of one of three
assert wrong["nees"] > 100 * right["nees"] and abs(wrong["largest"]) > 10, wrong
assert "nees" not in bare and bare["names"] == "none" and bare["accel_ug"] == right["accel_ug"], bare
assert named["names"] == "0 of 1, wrong: gyro_magnetic", named
assert max(truth[k] for k in ("accel_ug", "accel_ppm", "accel_arcsec", "gyro_degph", "gyro_ppm", "gyro_arcsec")) < 1e-6, truth
assert truth["names"] == "right", truth
PYTHON

refused() {  # refused WORDS ARGUMENTS...: exit code 1, one line, with these words, and nothing printed
  local code=0 words=$1
  shift
  "$@" > printed 2> said || code=$?
  [ $code = 1 ] && [ "$(wc -l < said)" = 1 ] && grep -qF -- "$words" said && [ ! -s printed ] || { echo "FAILED: $*: code $code, expected '$words'"; cat said; exit 1; }
}
sed 's/^n11 = 9/n11 = 8/' $answer > tampered.conf
refused "tampered.conf: not the sealed answer of case 08" score tampered.conf $found
refused "none.conf: cannot be read" score $answer none.conf
grep -v '^A03' bare.conf > bad.conf && refused "bad.conf: A03 missing" score $answer bad.conf
sed 's/^a11 = .*/a11 = nan/' bare.conf > bad.conf && refused "bad.conf:16: a11: expected a finite number" score $answer bad.conf
{ cat bare.conf; echo 'N01 = 1'; } > bad.conf && refused "N01 is there twice" score $answer bad.conf
{ cat bare.conf; echo 'sigma.N01 = 0'; } > bad.conf && refused "sigma.N01: expected a number above 0" score $answer bad.conf
{ cat bare.conf; echo 'gyro_increment = rad'; } > bad.conf && refused "gyro_increment = rad" score $answer bad.conf
refused "none is not there" "$here/benchmarks/run" --turncal "$work/none" --case 3

# A seal that was changed.
mkdir -p tree/tests && cp -r "$here/benchmarks" "$here/sequences" tree && cp -r "$here/tests/peers" tree/tests
sed -i '3s/.$/x/' tree/benchmarks/seals.txt
refused "case 3: what was drawn is not the sealed answer" tree/benchmarks/run --make --case 3 --out tree/out
