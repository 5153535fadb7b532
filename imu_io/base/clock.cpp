#include "imu_io/base/clock.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/select.h>

#include <algorithm>
#include <cerrno>
#include <ctime>

#include "imu_io/base/text.h"

namespace turncal {

std::string format_utc(double utc_s) {
  const std::time_t seconds = static_cast<std::time_t>(std::floor(utc_s));
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

int wait_ready(int descriptor, short events, int ms) {
  pollfd which{descriptor, events, 0};
  int ready = ::poll(&which, 1, ms);
  if (ready < 0 && errno == EINVAL) {
    fd_set set;
    FD_ZERO(&set);
    FD_SET(descriptor, &set);
    timeval time{ms / 1000, 1000 * (ms % 1000)};
    ready = ::select(descriptor + 1, events == POLLIN ? &set : nullptr, events == POLLIN ? nullptr : &set, nullptr,
                     ms < 0 ? nullptr : &time);
    which.revents = events;
  }
  return ready > 0 ? which.revents : ready;
}

std::optional<double> parse_utc(const std::string& text) {
  std::tm parts{};
  const char* const end = ::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  if (!end || *end != '\0') return std::nullopt;
  const auto utc_s = double(timegm(&parts));
  return format_utc(utc_s) == text ? std::optional(utc_s) : std::nullopt;
}

std::optional<double> parse_time_stamp(std::string_view text) {
  constexpr std::size_t day = 10, second = 19;
  if (text.size() < second || (text[day] != ' ' && text[day] != 'T')) return {};
  const std::string zone(text.substr(std::min(text.find_first_of("Z+-", second), text.size())));
  std::tm parts{};
  if (const char* const end = zone.empty() ? "" : ::strptime(zone.c_str(), "%z", &parts); !end || *end != '\0')
    return {};
  text.remove_suffix(zone.size());
  const auto whole_s = parse_utc(fmt::format("{}T{}Z", text.substr(0, day), text.substr(day + 1, second - day - 1)));
  const auto part_s = parse_number(fmt::format("0{}", text.substr(second)));
  if (!whole_s || !part_s || *part_s >= 1.0) return {};
  return *whole_s + *part_s - double(parts.tm_gmtoff);
}

}  // namespace turncal
