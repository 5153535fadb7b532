#include "orchestrator/devices/station_lock.h"

#include <unistd.h>

#include <cctype>
#include <filesystem>
#include <utility>

namespace turncal {

namespace {

const std::string& lock_folder() {
  static const std::string folder = ::access("/run/lock", W_OK) == 0 ? "/run/lock" : "/tmp";
  return folder;
}

std::string one_name_of(const std::string& device) {
  if (!device.starts_with("/")) return device.starts_with("localhost:") ? "127.0.0.1" + device.substr(9) : device;
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(device, error);
  return error ? device : real.string();
}

}  // namespace

std::string lock_path_of(const std::string& device) {
  std::string name = one_name_of(device);
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '.' && c != '-') c = '_';
  }
  return lock_folder() + "/turncal-" + name + ".lock";
}

Result<StationLock> StationLock::acquire(const StationConfig& station) {
  std::vector<std::string> devices;
  if (station.table.map) devices.push_back(station.table.map->link.address);
  if (station.table.dialect) devices.push_back(station.table.dialect->link.address);
  for (std::size_t place = 0; place < station.imu_places(); ++place) {
    devices.push_back(station.imu_settings(place).device);
  }
  StationLock lock;
  for (const std::string& device : devices) {
    Result<LockFile> taken = LockFile::acquire(lock_path_of(device));
    if (!taken) return device_error(device + ": " + taken.error().message);
    lock.locks_.push_back(std::move(*taken));
  }
  return lock;
}

}  // namespace turncal
