#include "orchestrator/service/station_actions.h"

#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <system_error>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/text_pieces.h"
#include "imu_io/recordings/recording_check.h"
#include "orchestrator/service/station_view.h"

namespace turncal {

namespace {

Status write_down(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                  double now_utc_s) {
  const std::string path = station.queue + ".actions";
  const std::string line = format_utc(now_utc_s) + " " + operator_name + " " + wanted.action +
                           (wanted.unit.empty() ? "" : " " + wanted.unit) + "\n";
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  const bool written =
      fd >= 0 && ::write(fd, line.data(), line.size()) == static_cast<ssize_t>(line.size()) && ::fsync(fd) == 0;
  const int why = errno;
  if (fd >= 0) ::close(fd);
  if (!written) return device_error(path + ": cannot write: " + std::generic_category().message(why));
  return {};
}

// The process is named by a descriptor before its lock is looked at again, so that its number cannot be another's by then.
Status send_signal(const std::string& lock, pid_t process, int signal) {
  const int fd = static_cast<int>(::syscall(SYS_pidfd_open, process, 0));
  if (fd < 0) return device_error("the run has just ended");
  Status status;
  if (lock_holder(lock) != process)
    status = device_error("the run has just ended");
  else if (::syscall(SYS_pidfd_send_signal, fd, signal, nullptr, 0) != 0)
    status = device_error("process " + std::to_string(process) +
                          " cannot be told: " + std::generic_category().message(errno));
  ::close(fd);
  return status;
}

bool running(const StationView& view) {
  return view.process && (view.state == StationState::running || view.state == StationState::results);
}

// Whether it can be done; nothing is changed.
Status check(const ServedStation& station, const StationAction& wanted, const StationView& view) {
  const auto is = [&wanted](const char* word) { return wanted.action == word; };
  if (is("pause") && running(view) && view.pausing)  // a second Ctrl-C would stop it now
    return input_error("station '" + station.name + "': a pause is asked for already");
  if (is("pause") || is("stop"))
    return running(view) ? Status() : Status(input_error("station '" + station.name + "': no run is going on"));
  if (!is("add") && !is("remove") && !is("again") && !is("mounted"))
    return input_error("action " + quoted(wanted.action) + ": expected add, remove, again, mounted, pause or stop");
  TRY(check_serial(wanted.unit, "unit"));
  if (!is("mounted")) return {};
  if (station.mounted.empty())
    return input_error("station '" + station.name + "': the page has no station.N.mounted, and cannot tell the batch");
  if (view.state != StationState::mounting ||
      std::find(view.units.begin(), view.units.end(), wanted.unit) == view.units.end())
    return input_error("station '" + station.name + "' does not wait for unit " + wanted.unit + " to be mounted");
  return {};
}

}  // namespace

Result<std::string> act(const ServedStation& station, const StationAction& wanted, const std::string& operator_name,
                        double now_utc_s) {
  const StationView view = look_at(station, now_utc_s);
  TRY(check(station, wanted, view));
  TRY(write_down(station, wanted, operator_name, now_utc_s));
  Status done;
  std::string said;
  if (wanted.action == "pause" || wanted.action == "stop") {
    const bool pause = wanted.action == "pause";
    done = send_signal(view.folder + "/.lock", *view.process, pause ? SIGINT : SIGTERM);
    said = pause ? "the run is told to pause at the end of its move or dwell" : "the run is told to stop now";
  } else if (wanted.action == "mounted") {
    done = write_file_atomically(station.mounted, wanted.unit + "\n");
    said = "unit " + wanted.unit + " is mounted";
  } else {
    QueueChange change;
    (wanted.action == "add" ? change.add : wanted.action == "remove" ? change.remove : change.again) = {wanted.unit};
    done = change_queue(station.queue, change);
    said = "unit " + wanted.unit + ": " + wanted.action;
  }
  if (done) return said;
  // What was written down was not done.
  StationAction failed = wanted;
  failed.action = "not done: " + wanted.action;
  TRY(write_down(station, failed, operator_name, now_utc_s));
  return done.error();
}

}  // namespace turncal
