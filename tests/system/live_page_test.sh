#!/usr/bin/env bash
# What a browser shows of a run, while it goes on and when it has ended (live_page_test.py sleeps between looks).
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
python3 "$here/tests/system/live_page_test.py" "${TURNCAL_BINARY:-$here/build/release/turncal}"
