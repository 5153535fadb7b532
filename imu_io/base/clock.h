// Time, injected. In a live run it is the machine's; in a dry run it is the rig's, which makes runs reproducible.
#pragma once

#include <optional>
#include <string>

namespace turncal {

class Clock {
 public:
  virtual ~Clock() = default;
  // Seconds since an arbitrary start; never goes back. All deadlines are measured on it.
  virtual double now_s() const = 0;
  // Civil time for records, seconds since 1970-01-01 UTC.
  virtual double utc_s() const = 0;
};

// "2026-01-31T12:00:00Z"
std::string format_utc(double utc_s);
// And back; empty for any other text.
std::optional<double> parse_utc(const std::string& text);

}  // namespace turncal
