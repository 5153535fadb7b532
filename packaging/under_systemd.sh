#!/usr/bin/env bash
# Run by packaging/boot_systemd.sh in a bare Debian 12 that has the package and whose process 1 is systemd: the units themselves, and what
# docs/getting-started.md says that systemd does with them.
set -euo pipefail
export LC_ALL=C.UTF-8
data=/usr/share/turncal
folder=/var/lib/turncal/line
log=/var/log/turncal/line.log
fail() {
  echo "package-test: $*" >&2
  systemctl status --no-pager --lines=5 turncal@line twin >&2 || true
  tail -n 10 "$log" >&2 || true
  exit 1
}
part() { printf '%4d s  %s\n' "$SECONDS" "$*"; }
property() { systemctl show --value --property "$1" turncal@line; }
# within SECONDS COMMAND...: waits until the command succeeds.
within() {
  local limit=$((SECONDS + $1))
  shift
  until "$@"; do
    [ "$SECONDS" -lt "$limit" ] || fail "not in time: $*"
    sleep 0.2
  done
}
is() { [ "$(property "$1")" = "$2" ]; }
moving() { property StatusText | grep -q moving; }
twin_ready() { [ "$(journalctl --unit twin --output cat | grep -c ready)" = "$twins" ]; }
twins=0
start_twin() {
  systemctl --quiet stop twin 2> /dev/null || true
  systemd-run --quiet --unit=twin turncal twin --station /etc/turncal/line.station
  twins=$((twins + 1))
  within 30 twin_ready
  chown turncal "$(readlink -f /run/turncal-imu)"
}
page_says() {
  exec 9<> /dev/tcp/127.0.0.1/8081 || return 1
  printf 'GET /status.json HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' >&9
  grep -q "$1" <&9
}
# ended STATUS: the service is at its end, nothing has failed, and systemd does not start it again.
ended() {
  within 60 is ActiveState inactive
  [ "$(property ExecMainStatus) $(property Result)" = "$1 success" ] || fail "ended with $(property ExecMainStatus), $(property Result); expected $1"
  [ "$(property NRestarts)" = 0 ] || fail "started again by systemd"
}

part "a station and its twin"
sed -e "s|^table.map = .*|table.map = $data/orchestrator/stations/twin.map|" -e 's|^clock.speed_up = .*|clock.speed_up = 10|' \
  -e 's|/tmp/turncal-twin-imu|/run/turncal-imu|' "$data/orchestrator/stations/twin.station" > /etc/turncal/line.station
printf 'hook.mount = true\nresume.rest_s = 0\n' >> /etc/turncal/line.station
echo "TURNCAL_OPTIONS=--sequence $data/sequences/short_demo.seq" > /etc/turncal/line.env
start_twin
install -d -o turncal -g turncal -m 2775 "$folder"
setpriv --reuid=turncal --regid=turncal --init-groups turncal queue "$folder/queue" --add TWIN > /dev/null

# Enabled, as docs/getting-started.md says: else systemd forgets what became of it, its starts included.
systemctl --quiet enable turncal@line
part "stopped four times in an hour, and started again by hand"
for _ in 1 2 3 4; do
  systemctl start turncal@line
  within 60 moving
  systemctl stop turncal@line
  ended 75
done

part "paused"
systemctl start turncal@line
within 60 moving
systemctl kill --signal INT turncal@line
ended 75

part "killed while the table moves"
systemctl start turncal@line
within 60 moving
systemctl kill --signal KILL --kill-who main turncal@line
start_twin  # a pseudo-terminal stays exclusive when its owner is killed
within 30 is NRestarts 1
within 60 moving

part "stuck while the table moves"
systemctl kill --signal STOP --kill-who main turncal@line
within 90 is SubState auto-restart
start_twin
within 30 is NRestarts 2
within 60 moving
grep -qi 'watchdog' <(journalctl --unit turncal@line --output cat) || fail "the watchdog did not see it"

part "to its end"
within 300 is ActiveState inactive
case "$(property ExecMainStatus)" in 0 | 20) ;; *) fail "ended with $(property ExecMainStatus)" ;; esac
[ -s "$folder/runs/TWIN/parameters.conf" ] || fail "no parameters"

part "the page of all stations"
printf 'station.1 = line\nstation.1.queue = %s/queue\nstation.1.runs = %s/runs\n' "$folder" "$folder" > /etc/turncal/serve.conf
systemctl start turncal-serve
within 20 page_says '"state":"idle"' 2> /dev/null
systemctl stop turncal-serve
[ "$(systemctl show --value --property Result turncal-serve)" = success ] || fail "the page did not end as it should"

part "a fault and a mistake are not tried again"
systemctl --quiet stop twin
install -d -o turncal -g turncal -m 2775 /var/lib/turncal/wrong
setpriv --reuid=turncal --regid=turncal --init-groups turncal queue /var/lib/turncal/wrong/queue --add TWIN > /dev/null
cp /etc/turncal/line.station /etc/turncal/wrong.station
for code in 50 1; do
  systemctl start turncal@wrong || true
  within 60 systemctl --quiet is-failed turncal@wrong
  sleep 12
  found=$(systemctl show --value --property ExecMainStatus --property NRestarts turncal@wrong | sort -nr | paste -sd ' ')
  [ "$found" = "$code 0" ] || fail "ended with $found; expected $code, and 0 starts by systemd"
  sed -i 's/^imu.device/imu.devise/' /etc/turncal/wrong.station
done
grep -q "wrong.station: .*'imu.device'" /var/log/turncal/wrong.log || fail "wrong.log does not name file and key"

part "the removal of old recordings"
systemctl start turncal-prune.service || fail "turncal-prune.service: $(journalctl --unit turncal-prune --output cat)"
part "done, under systemd"
