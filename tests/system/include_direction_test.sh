#!/usr/bin/env bash
# The project's own tree passes, and a tree with one deliberately bad include each does not.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
check=$here/include_direction.sh
bash "$check" "$here/../.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0
# expect RESULT FILE INCLUDE: a tree with this one line must (fail) or must not (pass) be refused.
expect() {
  rm -rf "$work/tree"
  mkdir -p "$work"/tree/{calib,imu_io,turntable_drivers,sequences,orchestrator}
  echo '#include <vector>' > "$work/tree/calib/fine.h"
  printf '%s\n' "$3" > "$work/tree/$2"
  local result=pass
  bash "$check" "$work/tree" > "$work/said" || result=fail
  if [ "$result" != "$1" ]; then
    echo "expected $1, got $result: $3 in $2"
    failures=$((failures + 1))
  elif [ "$1" = fail ] && ! grep -q "^$2:1: " "$work/said"; then
    echo "the line does not name $2:1: $(cat "$work/said")"
    failures=$((failures + 1))
  fi
}
expect pass calib/a.cpp '#include "calib/axis.h"'
expect pass imu_io/a.cpp '#include "calib/axis.h"'
expect pass turntable_drivers/a.cpp '#include "imu_io/clock.h"'
expect pass sequences/a.cpp '#include "imu_io/key_value.h"'
expect pass orchestrator/a.cpp '#include "turntable_drivers/turntable.h"'
expect pass imu_io/a.cpp '#include <sys/stat.h>'
expect pass turntable_drivers/rig.cpp '#include "calib/recording_types.h"'
expect fail calib/a.cpp '#include "imu_io/clock.h"'
expect fail calib/a.h '#include "orchestrator/progress.h"'
expect fail imu_io/a.cpp '#include "turntable_drivers/turntable.h"'
expect fail imu_io/a.cpp '#include "sequences/sequence.h"'
expect fail turntable_drivers/a.cpp '#include "sequences/sequence.h"'
expect fail sequences/a.cpp '#include "turntable_drivers/turntable.h"'
expect fail turntable_drivers/a.cpp '#include "orchestrator/station_run.h"'
expect fail sequences/a.cpp '  #  include <orchestrator/station_run.h>'
expect fail imu_io/a.cpp '#include "../orchestrator/progress.h"'
expect fail imu_io/a.cpp '#include "clock.h"'
expect fail calib/a.cpp '#include <fstream>'
expect fail calib/a.cpp '#include <chrono>'
expect fail calib/a.cpp '#include <thread>'
expect fail turntable_drivers/rig_sensors.cpp '#include "calib/parameters.h"'
expect fail turntable_drivers/rig.h '#include "calib/attitude.h"'
[ "$failures" -eq 0 ]
