#!/usr/bin/env bash
# Every page in Chromium (scripts/page-test); without one the script says so.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
TURNCAL=${TURNCAL_BINARY:-$here/build/release/turncal} exec "$here/scripts/page-test"
