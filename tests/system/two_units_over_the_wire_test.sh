#!/usr/bin/env bash
# Two units on one table over real lines: each gets the parameters of the run in process (scripts/over-the-wire --units 2).
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$here/scripts/over-the-wire" --units 2 --sequence "$here/sequences/short_demo.seq" --out "$work/out"
