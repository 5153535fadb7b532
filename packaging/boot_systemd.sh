#!/usr/bin/env bash
# boot_systemd.sh ROOT COMMAND...: systemd as process 1 of the Debian in ROOT, in namespaces of its own; then COMMAND in it, and all of it is ended.
# For root, where control groups can be made: where they cannot, it says so and ends with 77.
set -euo pipefail
root=$1
shift
log=$(mktemp)
trap 'rm -f "$log"' EXIT
group=turncal-$$
groups=()
for tree in /sys/fs/cgroup /sys/fs/cgroup/unified /sys/fs/cgroup/systemd /sys/fs/cgroup/memory; do
  [ ! -e "$tree/cgroup.procs" ] || ! mkdir "$tree/$group" 2> /dev/null || groups+=("$tree/$group")
done
[ ${#groups[@]} -gt 0 ] || { echo "no control group can be made here"; exit 77; }
clean_up() {
  rm -f "$log"
  for _ in $(seq 20); do  # the last of its processes may need a moment
    find "${groups[@]}" -depth -type d -exec rmdir {} + 2> /dev/null && break
    sleep 0.1
  done
}
trap clean_up EXIT

# What a container's manager would mount. Of control groups either the one hierarchy, or the old ones that this machine has.
boot='
  root=$1
  mount --make-rprivate /
  mount --bind "$root" "$root"
  mount -t proc proc "$root/proc"
  mount -t sysfs -o ro sysfs "$root/sys"
  for folder in run tmp dev; do mount -t tmpfs -o mode=755 tmpfs "$root/$folder"; done
  chmod 1777 "$root/tmp"
  mkdir "$root/dev/pts" "$root/dev/shm"
  for device in null zero full random urandom tty; do touch "$root/dev/$device"; mount --bind "/dev/$device" "$root/dev/$device"; done
  mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
  ln -s pts/ptmx "$root/dev/ptmx"
  ln -s /proc/self/fd "$root/dev/fd"
  if [ -e /sys/fs/cgroup/cgroup.controllers ]; then
    mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
  else
    mount -t tmpfs -o mode=755 tmpfs "$root/sys/fs/cgroup"
    mkdir "$root/sys/fs/cgroup/systemd" "$root/sys/fs/cgroup/memory"
    mount -t cgroup -o none,name=systemd cgroup "$root/sys/fs/cgroup/systemd"
    mount -t cgroup -o memory cgroup "$root/sys/fs/cgroup/memory"
  fi
  exec env -i container=chroot PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot "$root" /lib/systemd/systemd --system'
(
  for folder in "${groups[@]}"; do echo "$BASHPID" > "$folder/cgroup.procs"; done
  exec setsid unshare --mount --pid --fork --uts --ipc --cgroup --kill-child bash -c "$boot" boot "$root"
) > "$log" 2>&1 < /dev/null &
outer=$!
disown "$outer"
inside() { nsenter --target "$process" --mount --pid --uts --ipc --cgroup --root --wd env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 "$@"; }
running() {
  process=$(awk '{print $1}' "/proc/$outer/task/$outer/children") && [ "$(cat "/proc/$process/comm" 2> /dev/null)" = systemd ] &&
    case "$(inside systemctl is-system-running 2> /dev/null)" in running | degraded) true ;; *) false ;; esac
}
code=77
for _ in $(seq 300); do
  kill -0 "$outer" 2> /dev/null || break
  if running; then
    code=0
    inside "$@" || code=$?
    break
  fi
  sleep 0.2
done
[ "$code" != 77 ] || { echo "systemd does not start here:"; tail -n 3 "$log"; }
kill -KILL "$outer" 2> /dev/null || true
while kill -0 "$outer" 2> /dev/null; do sleep 0.1; done
exit "$code"
