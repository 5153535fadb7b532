#!/usr/bin/env bash
# Says which #include of the tree given as $1 goes against the direction of dependence, one line each; exit code 1 if any.
#   calib <- imu_io <- {turntable_drivers, sequences} <- orchestrator
# Within a folder the rooms are one-way, too: a room sees those of lower rank only (the table `rank` below).
# Also: our own headers are named from the top folder ("calib/types/axis.h"); calib uses no files, clocks or threads; the rig
# shares no model code with the estimator: of calib it sees plain data only; and only twins, dry runs and what starts them see the rig, by
# whatever way. A library has the room that uses it. Nothing but .h, .cpp and .cpp.in is looked at, so there is nothing else.
# A room, of tests too, has at most 40 files of C++: a fuller one is two.
set -euo pipefail
root=$1

crowded=$(find "$root"/calib "$root"/imu_io "$root"/turntable_drivers "$root"/sequences "$root"/orchestrator "$root"/tests \
  -name '*.h' -printf '%h\n' -o -name '*.cpp' -printf '%h\n' | sort | uniq -c |
  awk -v root="$root/" '$1 > 40 { print substr($2, length(root) + 1) ": " $1 " files: a room has at most 40" }')
if [ -n "$crowded" ]; then
  echo "$crowded"
  exit 1
fi

other=$(find "$root"/calib "$root"/imu_io "$root"/turntable_drivers "$root"/sequences "$root"/orchestrator \
  \( -name '*.hpp' -o -name '*.hh' -o -name '*.hxx' -o -name '*.inc' -o -name '*.ipp' -o -name '*.cc' -o -name '*.cxx' -o -name '*.c' \) -printf "%P\n")
if [ -n "$other" ]; then
  echo "$other: expected .h or .cpp"
  exit 1
fi

grep -rnE --include='*.h' --include='*.cpp' --include='*.in' '^[[:space:]]*(/\*.*\*/[[:space:]]*)*(#|%:|\?\?=)[[:space:]]*(include|import)' \
  "$root"/calib "$root"/imu_io "$root"/turntable_drivers "$root"/sequences "$root"/orchestrator |
  awk -v root="$root/" '
    BEGIN {
      allowed["calib"] = "calib"
      allowed["imu_io"] = "calib imu_io"
      allowed["turntable_drivers"] = "calib imu_io turntable_drivers"
      allowed["sequences"] = "calib imu_io sequences"
      allowed["orchestrator"] = "calib imu_io turntable_drivers sequences orchestrator"
      ranks("calib", "types; model; statistics; closed_form joint rests navigation; evidence; prediction fleet thermal")
      ranks("imu_io", "base; recordings lines; frames; units")
      ranks("turntable_drivers", "table; modbus ascii manual rig; chamber; twins")
      ranks("orchestrator", "station; run; watch records; devices; figures; report; line; jobs; fleet service; commands library; python; .")
      sees_rig = " turntable_drivers/rig turntable_drivers/twins orchestrator/devices orchestrator/jobs orchestrator/commands "
      # By what a job is given: a run that can be a dry one.
      reaches_rig = sees_rig "orchestrator/fleet orchestrator/service orchestrator/library orchestrator/. "
      library["CLI/"] = "orchestrator/commands"; library["libpq-fe.h"] = "orchestrator/records"; library["sqlite3.h"] = "orchestrator/records imu_io/recordings"
      library["modbus/"] = library["modbus.h"] = "turntable_drivers/modbus"; library["crypt.h"] = "orchestrator/service"
      library["matio.h"] = library["xxhash.h"] = library["hdf5.h"] = library["zstd.h"] = library["lz4frame.h"] = library["bzlib.h"] = library["zlib.h"] = "imu_io/recordings"
    }
    # Rooms of a folder, lowest first; those between two semicolons do not see each other. "." is the folder itself.
    function ranks(folder, text,    level, levels, i, j, names, n) {
      roomed[folder] = 1
      levels = split(text, level, "; *")
      for (i = 1; i <= levels; ++i) {
        n = split(level[i], names, " ")
        for (j = 1; j <= n; ++j) rank[folder "/" names[j]] = i
      }
    }
    function room_of(path,    part, n) { n = split(path, part, "/"); return part[1] "/" (n > 2 ? part[2] : ".") }
    function bad(why) { print place ": " target ": " why; failed = 1 }
    {
      line = substr($0, length(root) + 1)
      match(line, /:[0-9]+:/)
      place = substr(line, 1, RSTART + RLENGTH - 2)
      folder = line; sub(/\/.*/, "", folder)
      path = line; sub(/:.*/, "", path)
      room = room_of(path)
      if ((folder in roomed) && !(room in rank)) { target = path; bad(room " is not a room of the table"); next }
      rest = substr(line, RSTART + RLENGTH)
      if (!match(rest, /["<][^">]+[">]/)) { target = rest; bad("cannot be read"); next }
      quoted = substr(rest, RSTART, 1) == "\""
      target = substr(rest, RSTART + 1, RLENGTH - 2)
      if (rest !~ /^[ \t]*#[ \t]*include[ \t]*["<]/) { bad("expected #include and nothing before it"); next }
      if (target ~ /\.\.|\/\/|^\/|\/\.\// || target ~ /\.cpp$/) { bad("expected a header named from the top folder"); next }
      if (target ~ /^tests\//) { bad("tests are seen by tests"); next }
      for (name in library)
        if (index(target, name) == 1 && index(" " library[name] " ", " " room " ") == 0) bad("is for " library[name])
      top = target; sub(/\/.*/, "", top)
      ours = top in allowed && target ~ /\//
      if (quoted && !ours) { bad("expected a header named from the top folder"); next }
      if (ours && index(" " allowed[folder] " ", " " top " ") == 0) { bad(folder " must not depend on " top); next }
      if (folder == "calib" && target ~ /^(fstream|filesystem|iostream|ostream|istream|stdio.h|thread|mutex|shared_mutex|semaphore|barrier|latch|stop_token|pthread.h|atomic|future|condition_variable|chrono|ctime|time.h|unistd.h|fcntl.h|sys\/.*)$/)
        bad("calib is pure mathematics: no files, clocks, threads")
      if (ours) {
        target_room = room_of(target)
        if (top == folder && target_room != room && (folder in roomed) && !(rank[target_room] < rank[room]))
          bad(room " must not depend on " target_room)
        if (target_room == "turntable_drivers/rig" && index(sees_rig, " " room " ") == 0)
          bad("the rig is for twins, dry runs and tests")
        ++edges
        from[edges] = path; to[edges] = target; at[edges] = place; of_room[edges] = room
        if (target_room == "turntable_drivers/rig") reaches[path] = 1
      }
      if (room == "turntable_drivers/rig" && top == "calib" && target !~ /^calib\/types\/(recording_types|status|axis)\.h$/)
        bad("the rig shares no model code with the estimator")
    }
    END {
      for (grown = 1; grown;) {
        grown = 0
        for (i = 1; i <= edges; ++i) if ((to[i] in reaches) && !(from[i] in reaches)) { reaches[from[i]] = 1; grown = 1 }
      }
      for (i = 1; i <= edges; ++i)
        if ((to[i] in reaches) && index(reaches_rig, " " of_room[i] " ") == 0) {
          place = at[i]; target = to[i]
          bad("leads to the rig, which is for twins, dry runs and tests")
        }
      exit failed
    }'
