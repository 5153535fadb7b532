#include "orchestrator/devices/station_lock.h"

#include <ifaddrs.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

namespace turncal {

namespace {

const std::string& lock_folder() {
  static const std::string folder = ::access("/run/lock", W_OK) == 0 ? "/run/lock" : "/tmp";
  return folder;
}

// An address as IPv6 has it, IPv4 as mapped into it; nothing of any other family.
std::optional<in6_addr> as_ipv6(const sockaddr* address) {
  if (address == nullptr) return {};
  if (address->sa_family == AF_INET6) return reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr;
  if (address->sa_family != AF_INET) return {};
  in6_addr mapped{};
  mapped.s6_addr[10] = mapped.s6_addr[11] = 0xFF;
  std::memcpy(&mapped.s6_addr[12], &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, 4);
  return mapped;
}

// Every address by which this machine reaches itself: 0.0.0.0, 127.x, ::, ::1, those of its interfaces, and IPv4 as IPv6 has it.
bool is_this_machine(const sockaddr& address) {
  const std::optional<in6_addr> host = as_ipv6(&address);
  if (!host) return false;
  const bool mapped = IN6_IS_ADDR_V4MAPPED(&*host) && (host->s6_addr[12] == 127 || host->s6_addr[12] == 0);
  if (mapped || IN6_IS_ADDR_UNSPECIFIED(&*host) || IN6_IS_ADDR_LOOPBACK(&*host)) return true;
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return false;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> freed(first, ::freeifaddrs);
  for (const ifaddrs* one = first; one != nullptr; one = one->ifa_next) {
    const std::optional<in6_addr> own = as_ipv6(one->ifa_addr);
    if (own && IN6_ARE_ADDR_EQUAL(&*own, &*host)) return true;
  }
  return false;
}

// HOST:PORT with the first address that the system has for HOST; what cannot be looked up as it is written.
std::string numeric(const std::string& device) {
  const std::size_t colon = device.rfind(':');
  if (colon == std::string::npos) return device;
  std::string name = device.substr(0, colon);
  if (name.starts_with("[") && name.ends_with("]")) name = name.substr(1, name.size() - 2);
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_family =
      name.find(':') == std::string::npos ? AF_INET : AF_INET6;  // of localhost, too, always the same one
  wanted.ai_socktype = SOCK_STREAM;
  if (::getaddrinfo(name.c_str(), device.substr(colon + 1).c_str(), &wanted, &found) != 0) return device;
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> freed(found, ::freeaddrinfo);
  std::array<char, NI_MAXHOST> host{};
  std::array<char, NI_MAXSERV> port{};
  const int failed = ::getnameinfo(found->ai_addr, found->ai_addrlen, host.data(), host.size(), port.data(),
                                   port.size(), NI_NUMERICHOST | NI_NUMERICSERV);
  if (failed != 0) return device;
  return (is_this_machine(*found->ai_addr) ? std::string("127.0.0.1") : std::string(host.data())) + ":" + port.data();
}

// The last link is not followed: what it leads to is another device after the adapter has come back.
std::string one_name_of(const std::string& device) {
  if (!device.starts_with("/")) return numeric(device);
  const std::filesystem::path name = device;
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::canonical(name.parent_path(), error);
  return error ? device : (folder / name.filename()).string();
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
