# Read by the scripts beside it, which have a name: a folder of its own, and the words that they use.
source=$1
mkdir "../$name"
cd "../$name"
demo=$source/sequences/short_demo.seq
steps=$source/sequences/fourteen_step.seq
sed '/^step 5/,$d' "$demo" > four.seq  # the steps that determine everything
printf 'format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = mock\nimu.driver = rig\n' > head.station
{ cat head.station; printf 'motion.settle_s = 0.5\n'; } > plain.station
cp "$source/orchestrator/stations/twin.map" .
printf 'format = 1\nname = own\nlink.kind = rig\nlimits.low_c = -40\nlimits.high_c = 85\nlimits.ramp_c_per_min = 3\n' > own.chamber

# What is asked for, what is said of it, and the code.
try() {
  echo "turncal $*" >&2
  turncal "$@"
  echo "code $?" >&2
}
# A dry run of four steps.
run() { try run --dry-run --sequence four.seq "$@"; }
# station NAME KEYS, rig NAME KEYS: a file.
station() { { cat plain.station; printf "$2"; } > "$1.station"; }
rig() { printf "$2" > "$1.rig"; }
# fault N KIND KEY VALUE...: keys of a fault of the rig.
fault() {
  number=$1
  printf 'fault.%s.kind = %s\n' "$1" "$2"
  shift 2
  while [ $# -gt 0 ]; do printf 'fault.%s.%s = %s\n' "$number" "$1" "$2"; shift 2; done
}
# sequence NAME: its steps, from the standard input.
sequence() { { printf 'format = 1\nname = %s\nrate_degps = 10\nacceleration_degps2 = 20\nstep 1\n' "$1"; cat; } > "$1.seq"; }
# live NAME KEYS: a station on the twin's map with a unit on a serial line.
live() {
  { printf 'format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = modbus\ntable.map = twin.map\nimu.driver = serial\nimu.frame = laser_gyro\nimu.device = none\n'
    printf "$2"; } > "$1.station"
}
# What is in these folders, and the bytes of what they hold for good.
made() {
  find "$@" ! -type l ! -name .lock | LC_ALL=C sort
  find "$@" -name parameters.conf -o -name recording.tcr | LC_ALL=C sort | xargs -r sha256sum
}
