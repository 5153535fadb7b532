#!/usr/bin/env bash
# Every output of the command lines of tests/golden is what it was.
set -euo pipefail
here=$(cd "$(dirname "$0")/../.." && pwd)
exec "$here/scripts/golden" "${TURNCAL_BINARY:-$here/build/release/turncal}"
