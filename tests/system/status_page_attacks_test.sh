#!/usr/bin/env bash
# A run whose status page is attacked: goes on, keeps its memory and descriptors, and stops at once when it is told to.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
binary=${TURNCAL_BINARY:-$here/build/release/turncal}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 "$here/tests/system/status_page_attacks_test.py" "$binary" "$work" "$here/sequences/fourteen_step.seq"
