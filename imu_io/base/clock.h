// The injected clock. A live run uses the machine's; a dry run uses the rig's, which makes runs reproducible.
#pragma once

#include <time.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>

namespace turncal {

class Clock {
 public:
  virtual ~Clock() = default;
  // Seconds since an arbitrary start; never goes back. All deadlines are measured on it.
  virtual double now_s() const = 0;
  // Civil time for records, seconds since 1970-01-01 UTC.
  virtual double utc_s() const = 0;
};

// Returns "2026-01-31T12:00:00Z".
std::string format_utc(double utc_s);
// Parses what format_utc() writes; empty for any other text.
std::optional<double> parse_utc(const std::string& text);
// Parses a time stamp of a table: "2026-01-31 12:00:00.04", or with T for the blank. Z or an offset such as +02:00 may follow (UTC if none).
std::optional<double> parse_time_stamp(std::string_view text);

// The machine's monotonic clock, for waits on devices. The station's own time is the injected Clock.
inline double monotonic_s() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

// Waits on one descriptor: POLLIN or POLLOUT. Returns revents, 0 on timeout, -1 on error. Uses select() if RLIMIT_NOFILE is 0.
int wait_ready(int descriptor, short events, int ms);

class Deadline {
 public:
  explicit Deadline(double seconds) : end_s_(monotonic_s() + std::max(seconds, 0.0)) {}
  double left_s() const { return std::max(end_s_ - monotonic_s(), 0.0); }
  bool passed() const { return left_s() <= 0.0; }
  // The timeout for poll(): rounded up, so that a wait does not end in a busy loop, and at most an hour.
  int left_ms() const { return int(std::min(std::ceil(1e3 * left_s()), 3.6e6)); }

 private:
  double end_s_;
};

}  // namespace turncal
