#!/usr/bin/env bash
# The release program is position-independent, binds every symbol at the start, has its stack guarded and its copies checked.
set -euo pipefail
grep -q '^CMAKE_BUILD_TYPE:.*=Release' "$TURNCAL_BUILD/CMakeCache.txt" || { echo "skipped: not the release build"; exit 0; }
headers=$(readelf --wide --file-header --dynamic --program-headers --dyn-syms "$TURNCAL_BINARY")
failed=0
need() { grep -Eq "$1" <<< "$headers" || { echo "$TURNCAL_BINARY: not $2"; failed=1; }; }
need 'Type: +DYN' "position-independent"
need 'FLAGS_1.* PIE' "position-independent"
need '\(FLAGS(_1)?\).*NOW' "bound at the start (-z now)"
need 'GNU_RELRO' "relocated read-only (-z relro)"
need '__stack_chk_fail' "guarded on the stack (-fstack-protector-strong)"
need '__[a-z]+_chk(@|$| )' "checked in its copies (_FORTIFY_SOURCE)"
exit $failed
