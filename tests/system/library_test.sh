#!/usr/bin/env bash
# The library as it is installed: the example of docs/examples/library builds outside the tree, by one line with pkg-config and as a CMake project,
# and writes the parameters of the command. Nothing but the face is exported.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
library=$TURNCAL_BUILD/libturncal.so
[ -e "$library" ] || { echo "skipped: $library is not built"; exit 0; }
for tool in g++ cmake pkg-config; do command -v "$tool" > /dev/null || { echo "skipped: $tool is not installed"; exit 0; }; done
if grep -q '^TURNCAL_SANITIZE:[^=]*=.' "$TURNCAL_BUILD/CMakeCache.txt"; then echo "skipped: a library with sanitizers needs programs with them"; exit 0; fi
failed=0
fail() { echo "$*"; failed=1; }
others=$(nm --dynamic --defined-only --demangle "$library" | grep -v -e 'turncal::v0::' -e ' A TURNCAL_0' || true)
[ -z "$others" ] || fail "exported, and not of the face: $others"
grep -rlE 'Eigen|"(calib|imu_io|orchestrator)/' "$root/orchestrator/library/turncal" && fail "a header of the face shows what is below it"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cmake --install "$TURNCAL_BUILD" --prefix "$work/usr" > install.log || { cat install.log; exit 1; }
libraries=$(dirname "$(find "$work/usr" -name libturncal.so)")
cp -r "$root/docs/examples/library" example
# shellcheck disable=SC2046 # words
g++ -std=c++20 -Wall -Wextra -Werror example/calibrate.cpp -o one_line $(PKG_CONFIG_PATH=$libraries/pkgconfig pkg-config --cflags --libs turncal)
cmake -S example -B example/build -DCMAKE_PREFIX_PATH="$work/usr" > cmake.log && cmake --build example/build >> cmake.log || { cat cmake.log; exit 1; }

"$TURNCAL_BINARY" run --dry-run --quiet --capture-only --unit LIB --sequence "$root/sequences/forty_minutes.seq" --out run
"$TURNCAL_BINARY" calibrate run --out command > /dev/null
for program in ./one_line example/build/calibrate; do
  LD_LIBRARY_PATH=$libraries "$program" run parameters.conf > said || fail "$program: $?"
  grep -qE '^rate at rest 1(4\.[89]|5\.[012])[0-9]* deg/h$' said || { cat said; fail "$program: expected the earth rate"; }
  diff <(grep -vE '^(time_utc|checksum)' command/parameters.conf) <(grep -vE '^(time_utc|checksum)' parameters.conf) || fail "$program: other parameters"
  rm parameters.conf
done
LD_LIBRARY_PATH=$libraries ./one_line none parameters.conf 2> said && fail "expected an error"
[ "$(sed 's/^calibrate: /turncal: /' said)" = "$("$TURNCAL_BINARY" calibrate none --out x 2>&1)" ] || fail "another line than the command's: $(cat said)"
exit $failed
