#!/usr/bin/env bash
# Says which #include of the tree given as $1 goes against the direction of dependence, one line each; exit code 1 if any.
#   calib <- imu_io <- {turntable_drivers, sequences} <- orchestrator
# Also: our own headers are named from the top folder ("calib/axis.h"); calib uses no files, clocks or threads; and the rig
# shares no model code with the estimator: of calib it sees plain data only.
set -euo pipefail
root=$1

grep -rnE --include='*.h' --include='*.cpp' --include='*.in' '^[[:space:]]*#[[:space:]]*include' \
  "$root"/calib "$root"/imu_io "$root"/turntable_drivers "$root"/sequences "$root"/orchestrator |
  awk -v root="$root/" '
    BEGIN {
      allowed["calib"] = "calib"
      allowed["imu_io"] = "calib imu_io"
      allowed["turntable_drivers"] = "calib imu_io turntable_drivers"
      allowed["sequences"] = "calib imu_io sequences"
      allowed["orchestrator"] = "calib imu_io turntable_drivers sequences orchestrator"
    }
    function bad(why) { print place ": " target ": " why; failed = 1 }
    {
      line = substr($0, length(root) + 1)
      match(line, /:[0-9]+:/)
      place = substr(line, 1, RSTART + RLENGTH - 2)
      folder = line; sub(/\/.*/, "", folder)
      file = line; sub(/:.*/, "", file); sub(/.*\//, "", file)
      rest = substr(line, RSTART + RLENGTH)
      if (!match(rest, /["<][^">]+[">]/)) { target = rest; bad("cannot be read"); next }
      quoted = substr(rest, RSTART, 1) == "\""
      target = substr(rest, RSTART + 1, RLENGTH - 2)
      top = target; sub(/\/.*/, "", top)
      ours = top in allowed && target ~ /\//
      if (quoted && !ours) { bad("expected a header named from the top folder"); next }
      if (ours && index(" " allowed[folder] " ", " " top " ") == 0) { bad(folder " must not depend on " top); next }
      if (folder == "calib" && target ~ /^(fstream|filesystem|iostream|thread|mutex|atomic|future|condition_variable|chrono|ctime|time.h|unistd.h|fcntl.h|sys\/.*)$/)
        bad("calib is pure mathematics: no files, clocks, threads")
      if (folder == "turntable_drivers" && file ~ /^rig/ && top == "calib" && target !~ /^calib\/(recording_types|status|axis)\.h$/)
        bad("the rig shares no model code with the estimator")
    }
    END { exit failed }'
