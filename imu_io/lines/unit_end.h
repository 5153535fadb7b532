// The unit's end of a line, for the twin and the tests. `device` is the station's imu.device (byte_line.h):
//
//   a path               creates a pseudo-terminal and a link to it of that name
//   tcp:HOST:PORT        listens there, for one station at a time
//   udp:[ADDRESS:]PORT   sends there; without an address to this machine
//   udp_to:HOST:PORT     receives requests there, and answers the last sender
// As on a real line, bytes sent while no station is there are lost.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "calib/types/status.h"
#include "imu_io/base/files.h"

namespace turncal {

class UnitEnd {
 public:
  virtual ~UnitEnd() = default;
  // Returns the name that the station must use.
  virtual const std::string& device() const = 0;
  virtual bool is_open() const = 0;
  virtual bool has_peer() const = 0;  // a station is listening, as far as can be known
  // Writes everything, waiting at most timeout_s for room. Without a peer it returns at once and the data are lost.
  virtual Status write_all(std::span<const std::byte> data, double timeout_s) = 0;
  // Reads what the station sent, at most out.size() bytes; 0 if nothing came within timeout_s or there is no peer.
  virtual Result<std::size_t> read(std::span<std::byte> out, double timeout_s) = 0;
  virtual void unplug() = 0;
};

// A pseudo-terminal: a serial line without hardware. The twin and the tests have the master side; the program under test
// opens device() like a serial port.
//
// As on a real line, bytes sent while nobody has the device open are lost. unplug() acts like pulling the adapter: the
// other side sees a hang-up. With link_path a symbolic link of that name points to the device, so that a new device
// has the old name after an unplug(). An existing link is replaced; any other file of that name is an error.
class Pty : public UnitEnd {
 public:
  Pty() = default;
  Pty(Pty&& other) noexcept { *this = std::move(other); }
  Pty& operator=(Pty&& other) noexcept;
  ~Pty() override { unplug(); }

  static Result<Pty> create(const std::string& link_path = "");
  bool is_open() const override { return fd_ >= 0; }
  const std::string& device() const override { return device_; }  // the link if there is one
  int descriptor() const { return fd_; }
  bool has_peer() const override;  // somebody has the device open
  Status write_all(std::span<const std::byte> data, double timeout_s) override;
  Status write_all(std::string_view text, double timeout_s);
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s) override;
  void unplug() override;  // also removes the link

 private:
  Descriptor fd_;
  std::string device_;
  std::string link_;
};

Result<std::unique_ptr<UnitEnd>> open_unit_end(const std::string& device);

}  // namespace turncal
