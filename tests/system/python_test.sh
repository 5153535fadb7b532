#!/usr/bin/env bash
# The Python module beside the program, and the notebooks of docs/examples: tests/system/python_test.py.
set -euo pipefail
ls "$TURNCAL_BUILD"/python/turncal/_turncal*.so > /dev/null 2>&1 || { echo "skipped: the Python module is not built (scripts/install-deps --tests)"; exit 0; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PYTHONPATH=$TURNCAL_BUILD/python PYTHONDONTWRITEBYTECODE=1 PATH=$(dirname "$TURNCAL_BINARY"):$PATH TMPDIR=$work
/usr/bin/python3 "$(dirname "$0")/python_test.py"
