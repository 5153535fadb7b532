#!/usr/bin/env bash
# Run by scripts/package-test as root in a bare Debian 12, beside the packages of version 0.0.9 and $1.
set -euo pipefail
cd /root/packages
version=$1
export DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8
install() { apt-get install -y -q --no-install-recommends "$@" > apt.log 2>&1 || { cat apt.log; exit 1; }; }
fail() { echo "package-test: $*" >&2; exit 1; }
as_turncal() { setpriv --reuid=turncal --regid=turncal --init-groups --inh-caps=-all "$@"; }
part() { printf '%4d s  %s\n' "$SECONDS" "$*"; }
data=/usr/share/turncal

apt-get update -q > apt.log 2>&1
part "install 0.0.9, without what is only recommended"
install ./turncal_0.0.9_*.deb
! ldd /usr/bin/turncal | grep 'not found' || fail "a library is missing"
id -nG turncal | grep -qw dialout || fail "the user turncal is not in dialout"
[ "$(stat -c '%U:%G %a' /var/lib/turncal)" = "turncal:turncal 2775" ] || fail "/var/lib/turncal: $(stat -c '%U:%G %a' /var/lib/turncal)"
[ -e /usr/share/man/man1/turncal-run.1.gz ] || fail "no manual page of turncal run"
systemd-analyze verify --man=no turncal@main.service turncal-prune.service turncal-prune.timer turncal-serve.service > said 2>&1 || { cat said; fail "systemd-analyze verify"; }
[ ! -s said ] || { cat said; fail "systemd-analyze verify has something to say"; }
# shellcheck source=/dev/null
. /usr/share/bash-completion/completions/turncal
COMP_WORDS=(turncal ru) COMP_CWORD=1
_turncal
[ "${COMPREPLY[*]}" = run ] || fail "completion of 'ru': ${COMPREPLY[*]}"
COMP_WORDS=(turncal run --dry) COMP_CWORD=2
_turncal
[ "${COMPREPLY[*]}" = --dry-run ] || fail "completion of 'run --dry': ${COMPREPLY[*]}"

part "a dry run, without gnuplot"
as_turncal turncal run --dry-run --quiet --unit DRY --out /var/lib/turncal/dry > said 2>&1 || { cat said; fail "the dry run"; }
[ ! -s said ] || { cat said; fail "--quiet printed something"; }
grep -q 'gnuplot' /var/lib/turncal/dry/diagnosis/report.html || fail "the report does not say that it has no plots"

part "a station as systemd starts it, with the twin"
printf '# changed by hand\n' >> /etc/turncal/prune.conf
sed -e "s|^table.map = .*|table.map = $data/orchestrator/stations/twin.map|" -e 's|^clock.speed_up = .*|clock.speed_up = 20|' -e 's|/tmp/turncal-twin-imu|/run/turncal-imu|' \
  "$data/orchestrator/stations/twin.station" > /etc/turncal/main.station
printf 'hook.mount = true\nresume.rest_s = 0\n' >> /etc/turncal/main.station
echo "TURNCAL_OPTIONS=--sequence short_demo.seq" > /etc/turncal/main.env
as_turncal mkdir -m 2775 /var/lib/turncal/main
as_turncal turncal queue /var/lib/turncal/main/queue --add TWIN > said
turncal twin --station /etc/turncal/main.station --table tcp:0 > twin.log 2>&1 &
twin=$!
trap 'kill "$twin" 2> /dev/null || true' EXIT
for _ in $(seq 300); do grep -q ready twin.log && break; sleep 0.1; done
table=$(sed -n 's/.* ready: table modbus at \([0-9.:]*\),.*/\1/p' twin.log)
[ -n "$table" ] || { cat twin.log; fail "the twin is not ready"; }
sed -i "s|^table.address = .*|table.address = $table|" /etc/turncal/main.station
options=$(sed -n 's/^TURNCAL_OPTIONS=//p' /etc/turncal/main.env)
read -r -a command <<< "$(sed -n 's/^ExecStart=//p' /lib/systemd/system/turncal@.service | sed "s|%i|main|g; s|\$TURNCAL_OPTIONS|$options|")"
chown turncal /run/turncal-imu "$(readlink -f /run/turncal-imu)"
# A machine that stalls may spoil it once: the same command goes on.
as_turncal "${command[@]}" > said 2>&1 || { tail -n 1 said; as_turncal "${command[@]}" > said 2>&1; } || { tail -n 20 said; fail "the run with the twin"; }
kill "$twin"
wait "$twin" || true
[ -s /var/lib/turncal/main/runs/TWIN/parameters.conf ] || fail "no parameters of the run with the twin"

part "the page of all stations"
printf 'station.1 = main\nstation.1.queue = /var/lib/turncal/main/queue\nstation.1.runs = /var/lib/turncal/main/runs\n' > /etc/turncal/serve.conf
# Not by the function: that would be killed instead of it.
setpriv --reuid=turncal --regid=turncal --init-groups --inh-caps=-all turncal serve /etc/turncal/serve.conf --listen 127.0.0.1:0 > serve.log 2>&1 &
page=$!
for _ in $(seq 100); do grep -q http serve.log && break; sleep 0.1; done
exec 9<> "/dev/tcp/127.0.0.1/$(sed -n 's!.*http://127.0.0.1:\([0-9]*\).*!\1!p' serve.log)"
printf 'GET /status.json HTTP/1.1\r\nHost: localhost\r\n\r\n' >&9
grep -q '"state":"idle"' <&9 || fail "the page of all stations does not say that the queue is done"
exec 9>&-
kill "$page"
wait "$page" || true
for process in $(grep -lx turncal /proc/[0-9]*/comm 2> /dev/null); do
  [ ! "${process%/comm}/root" -ef / ] || fail "a turncal is left running"  # of this system: others share the list of processes
done

part "upgrade to $version"
before=$(find /var/lib/turncal -type f -exec sha256sum {} + | sort)
install "./turncal_${version}_"*.deb "./turncal-doc_${version}_"*.deb
[ "$(dpkg-query -W -f '${Version}' turncal)" = "$version" ] || fail "not upgraded"
[ "$before" = "$(find /var/lib/turncal -type f -exec sha256sum {} + | sort)" ] || fail "the upgrade changed data"
grep -q 'changed by hand' /etc/turncal/prune.conf || fail "the upgrade took an edited file of /etc/turncal"
[ -e /usr/share/doc/turncal/docs/getting-started.md ] || fail "turncal-doc has no getting-started.md"
as_turncal turncal resume /var/lib/turncal/dry | grep -q 'nothing to resume' || fail "the new version does not know the run of the old one"

part "the library, in C++ and in Python"
install "./libturncal0_${version}_"*.deb "./libturncal-dev_${version}_"*.deb "./python3-turncal_${version}_"*.deb g++ cmake make pkg-config
turncal calibrate /var/lib/turncal/dry --out command > said
cp -r /usr/share/doc/turncal/docs/examples/library example
# shellcheck disable=SC2046 # words
g++ -std=c++20 example/calibrate.cpp -o one_line $(pkg-config --cflags --libs turncal)
cmake -S example -B example/build > said && cmake --build example/build >> said || { cat said; fail "the example as a CMake project"; }
python="import turncal; turncal.calibrate(turncal.load('/var/lib/turncal/dry')).parameters.write('of_python.conf')"
./one_line /var/lib/turncal/dry of_line.conf > said && example/build/calibrate /var/lib/turncal/dry of_cmake.conf > said && python3 -c "$python" ||
  { cat said; fail "a calibration by the library"; }
for file in of_line.conf of_cmake.conf of_python.conf; do
  cmp <(grep -vE '^(time_utc|checksum)' command/parameters.conf) <(grep -vE '^(time_utc|checksum)' $file) || fail "$file: other parameters than the command's"
done
apt-get purge -y -q libturncal0 > apt.log 2>&1
[ ! -e /usr/include/turncal ] && [ ! -e /usr/lib/python3/dist-packages/turncal ] || fail "purged, and headers or module are still there"

part "old recordings"
as_turncal turncal run --dry-run --quiet --sequence "$data/sequences/short_demo.seq" --unit DRY --out /var/lib/turncal/again
KEEP_DAYS=$(sed -n 's/^KEEP_DAYS=//p' /etc/turncal/prune.conf)
eval "as_turncal $(sed -n 's/^ExecStart=//p' /lib/systemd/system/turncal-prune.service)" > said || { cat said; fail "the removal of old recordings"; }

part "removal, and purge"
apt-get remove -y -q turncal > apt.log 2>&1
[ ! -e /usr/bin/turncal ] || fail "removed, and still there"
[ "$before" = "$(find /var/lib/turncal -type f -not -path '*/again/*' -exec sha256sum {} + | sort)" ] || fail "the removal changed data"
grep -q 'changed by hand' /etc/turncal/prune.conf || fail "the removal took an edited file of /etc/turncal"
apt-get purge -y -q turncal > apt.log 2>&1
[ ! -e /etc/turncal/prune.conf ] || fail "purged, and a conffile is still there"
for folder in /etc/turncal /var/lib/turncal; do grep -q "turncal: $folder is left" apt.log || fail "the purge does not say that it leaves $folder"; done
[ "$before" = "$(find /var/lib/turncal -type f -not -path '*/again/*' -exec sha256sum {} + | sort)" ] || fail "the purge changed data"
part "installed again, for systemd"
install "./turncal_${version}_"*.deb systemd systemd-sysv dbus

