// The unit's end of a line, for the twin and the tests: what the station calls by its imu.device (byte_line.h), from the other side.
//
//   a path               a pseudo-terminal, with a link of that name
//   tcp:HOST:PORT        listens there; one station at a time
//   udp:[ADDRESS:]PORT   sends there, or to this machine
//   udp_to:HOST:PORT     hears requests there, and answers whoever asked last
// What is sent while no station is there is lost, as on a real line.
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
  // As the station has to name it.
  virtual const std::string& device() const = 0;
  virtual bool is_open() const = 0;
  virtual bool has_peer() const = 0;  // a station listens, as far as can be known
  // Everything, waiting at most timeout_s for room; at once and without an effect when there is no peer.
  virtual Status write_all(std::span<const std::byte> data, double timeout_s) = 0;
  // What the station sent, at most out.size(); 0: nothing within timeout_s, or no peer.
  virtual Result<std::size_t> read(std::span<std::byte> out, double timeout_s) = 0;
  virtual void unplug() = 0;
};

// A pseudo-terminal: a serial line without hardware. The twin and the tests stand on the master's side; what is under test
// opens device() as if it were a serial port.
//
// As on a real line, what is sent while nobody has the device open is lost. unplug() is what pulling the adapter is: the
// other side sees a hang-up. With link_path a symbolic link of that name leads to the device, so that one unplugged and made
// anew comes back under the same name; an existing link is replaced, any other file is an error.
class Pty : public UnitEnd {
 public:
  Pty() = default;
  Pty(Pty&& other) noexcept { *this = std::move(other); }
  Pty& operator=(Pty&& other) noexcept;
  ~Pty() override { unplug(); }

  static Result<Pty> create(const std::string& link_path = "");
  bool is_open() const override { return fd_ >= 0; }
  const std::string& device() const override { return device_; }  // the link where there is one
  int descriptor() const { return fd_; }
  bool has_peer() const override;  // somebody has the device open
  Status write_all(std::span<const std::byte> data, double timeout_s) override;
  Status write_all(std::string_view text, double timeout_s);
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s) override;
  void unplug() override;  // removes the link too

 private:
  Descriptor fd_;
  std::string device_;
  std::string link_;
};

Result<std::unique_ptr<UnitEnd>> open_unit_end(const std::string& device);

}  // namespace turncal
