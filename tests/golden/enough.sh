#!/bin/sh
# Runs that end when they know enough: never, when both units do, not before there is a diagnosis, and not where the fit is not believed.
name=enough
. ./begin.sh
known='stop.sigma.n11 = 3e-6\nstop.sigma.n22 = 3e-6\n'
until_known() { try run --dry-run --until-sigma --station "$@"; }
station never "${known}stop.sigma.N01 = 1e-6\n"
until_known never.station --unit SN1 --out never --sequence four.seq
station both "$known"
until_known both.station --unit SN1 --unit SN2 --out both --sequence "$demo"
station at-once 'stop.sigma.n11 = 1\nstop.sigma.n22 = 1\n'
until_known at-once.station --unit SN1 --out at-once --sequence "$steps"
grep -E 'ended_after|verdict' at-once/parameters.conf
# Nor where the fit is not believed.
rig k2 'effect.accel_second_order.y = 200\n'
station doubted 'stop.sigma.n11 = 1\nrig.file = k2.rig\n'
sed '/^step 8/,$d' "$demo" > seven.seq
until_known doubted.station --unit SN1 --out doubted --sequence seven.seq --no-diagnosis
made never both at-once doubted
