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
  mkdir -p "$work"/tree/{calib/types,imu_io,turntable_drivers,sequences,orchestrator,tests} "$(dirname "$work/tree/$2")"
  echo '#include <vector>' > "$work/tree/calib/types/fine.h"
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
expect pass calib/model/a.cpp '#include "calib/types/axis.h"'
expect pass imu_io/base/a.cpp '#include "calib/types/axis.h"'
expect pass turntable_drivers/table/a.cpp '#include "imu_io/base/clock.h"'
expect pass sequences/a.cpp '#include "imu_io/base/key_value.h"'
expect pass orchestrator/run/a.cpp '#include "turntable_drivers/table/turntable.h"'
expect pass orchestrator/main.cpp '#include "orchestrator/commands/commands.h"'
expect pass imu_io/base/a.cpp '#include <sys/stat.h>'
expect pass turntable_drivers/rig/rig.cpp '#include "calib/types/recording_types.h"'
expect pass turntable_drivers/twins/a.h '#include "turntable_drivers/rig/rig.h"'
expect pass orchestrator/devices/a.h '#include "turntable_drivers/rig/rig.h"'
# Upward between folders.
expect fail calib/types/a.cpp '#include "imu_io/base/clock.h"'
expect fail calib/types/a.h '#include "orchestrator/watch/progress.h"'
expect fail imu_io/base/a.cpp '#include "turntable_drivers/table/turntable.h"'
expect fail imu_io/base/a.cpp '#include "sequences/sequence.h"'
expect fail turntable_drivers/table/a.cpp '#include "sequences/sequence.h"'
expect fail sequences/a.cpp '#include "turntable_drivers/table/turntable.h"'
expect fail turntable_drivers/table/a.cpp '#include "orchestrator/run/station_run.h"'
expect fail sequences/a.cpp '  #  include <orchestrator/run/station_run.h>'
# Upward, or sideways, between rooms.
expect fail calib/types/a.h '#include "calib/model/parameters.h"'
expect fail calib/joint/a.h '#include "calib/rests/rest_model.h"'
expect fail calib/statistics/a.cpp '#include "calib/evidence/diagnosis.h"'
expect fail imu_io/lines/a.h '#include "imu_io/recordings/recording_source.h"'
expect fail imu_io/base/a.h '#include "imu_io/frames/crc.h"'
expect fail turntable_drivers/manual/a.h '#include "turntable_drivers/modbus/modbus_frame.h"'
expect fail turntable_drivers/ascii/a.h '#include "turntable_drivers/modbus/register_map.h"'
expect fail orchestrator/run/a.cpp '#include "orchestrator/watch/progress.h"'
expect fail orchestrator/report/a.cpp '#include "orchestrator/commands/commands.h"'
expect fail orchestrator/jobs/a.h '#include "orchestrator/commands/commands.h"'
expect fail orchestrator/commands/a.h '#include "orchestrator/main.h"'
expect fail calib/a.cpp '#include <vector>'
expect fail orchestrator/utilities/a.cpp '#include <vector>'
# The simulator is seen by twins, dry runs and tests only, and shares no model code.
expect fail turntable_drivers/manual/a.h '#include "turntable_drivers/rig/rig.h"'
expect fail orchestrator/run/a.cpp '#include "turntable_drivers/rig/rig.h"'
expect fail orchestrator/station/a.h '#include "turntable_drivers/rig/rig_config.h"'
expect fail sequences/a.h '#include "turntable_drivers/rig/rig_config.h"'
expect fail turntable_drivers/rig/rig_sensors.cpp '#include "calib/model/parameters.h"'
expect fail turntable_drivers/rig/rig.h '#include "calib/model/attitude.h"'
# By whatever way.
expect_with() {  # FILE INCLUDE, where a header of devices includes the rig
  rm -rf "$work/tree"
  mkdir -p "$work"/tree/{calib/types,imu_io,turntable_drivers,sequences,orchestrator/devices,tests} "$(dirname "$work/tree/$1")"
  echo '#include "turntable_drivers/rig/rig.h"' > "$work/tree/orchestrator/devices/sim.h"
  printf '%s\n' "$2" > "$work/tree/$1"
  if bash "$check" "$work/tree" > "$work/said" || ! grep -q "^$1:1: .*leads to the rig" "$work/said"; then
    echo "not refused for leading to the rig: $2 in $1: $(cat "$work/said")"
    failures=$((failures + 1))
  fi
}
expect_with orchestrator/report/a.h '#include "orchestrator/devices/sim.h"'
expect_with orchestrator/figures/a.cpp '#include "orchestrator/devices/sim.h"'
# Other spellings of the same.
expect fail calib/types/a.h '#include "calib/../imu_io/base/clock.h"'
expect fail calib/types/a.h '#include <calib//../imu_io/base/clock.h>'
expect fail calib/types/a.h '/* x */ #include "imu_io/base/clock.h"'
expect fail calib/types/a.h '%:include "imu_io/base/clock.h"'
expect fail calib/types/a.h '#import "imu_io/base/clock.h"'
expect fail orchestrator/run/a.cpp '#include "orchestrator/run/b.cpp"'
expect fail imu_io/base/a.h '#include <tests/files.h>'
# Libraries have their rooms.
expect fail orchestrator/run/a.h '#include <CLI/CLI.hpp>'
expect fail calib/types/a.h '#include <sqlite3.h>'
expect fail imu_io/base/a.h '#include <modbus/modbus.h>'
expect pass orchestrator/commands/a.h '#include <CLI/CLI.hpp>'
# How headers are named, and what mathematics may use.
expect fail imu_io/base/a.cpp '#include "../orchestrator/watch/progress.h"'
expect fail imu_io/base/a.cpp '#include "clock.h"'
expect fail calib/types/a.cpp '#include <fstream>'
expect fail calib/types/a.cpp '#include <chrono>'
expect fail calib/types/a.cpp '#include <thread>'
expect fail calib/types/a.cpp '#include <semaphore>'
# A room of 40 files is full.
expect pass calib/types/a.h '#include <vector>'
for k in $(seq 38); do touch "$work/tree/calib/types/$k.cpp"; done
bash "$check" "$work/tree" || failures=$((failures + 1))
touch "$work/tree/calib/types/39.cpp"
if bash "$check" "$work/tree" > "$work/said" || [ "$(cat "$work/said")" != 'calib/types: 41 files: a room has at most 40' ]; then
  echo "a room of 41 files passed, or was not named: $(cat "$work/said")"
  failures=$((failures + 1))
fi
[ "$failures" -eq 0 ]
