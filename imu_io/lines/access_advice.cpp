#include "imu_io/lines/access_advice.h"

#include <grp.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>

namespace turncal {

std::string access_advice(const std::string& device, int number) {
  constexpr mode_t read_and_write = S_IRGRP | S_IWGRP;
  struct stat facts {};
  if (number != EACCES || ::stat(device.c_str(), &facts) != 0 || (facts.st_mode & read_and_write) != read_and_write)
    return "";
  group entry{}, *found = nullptr;
  std::array<char, 4096> text{};
  if (::getgrgid_r(facts.st_gid, &entry, text.data(), text.size(), &found) != 0 || found == nullptr) return "";
  return "; its group may: sudo adduser \"$USER\" " + std::string(entry.gr_name) + ", then log in again";
}

}  // namespace turncal
