#!/usr/bin/env bash
# A whole run over real lines gives the parameters of the run in process (scripts/over-the-wire, here with the short sequence).
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$here/scripts/over-the-wire" --sequence "$here/sequences/short_demo.seq" --out "$work/out"
