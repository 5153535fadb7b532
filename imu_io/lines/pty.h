// A pseudo-terminal: a serial line without hardware. The twin and the tests stand on the master's side; what is under test
// opens device() as if it were a serial port.
//
// As on a real line, what is sent while nobody has the device open is lost. unplug() is what pulling the adapter is: the
// other side sees a hang-up. With link_path a symbolic link of that name leads to the device, so that one unplugged and made
// anew comes back under the same name; an existing link is replaced, any other file is an error.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "calib/types/status.h"
#include "imu_io/lines/unit_end.h"

namespace turncal {

class Pty : public UnitEnd {
 public:
  Pty() = default;
  Pty(Pty&& other) noexcept;
  Pty& operator=(Pty&& other) noexcept;
  ~Pty() override;

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
  int fd_ = -1;
  std::string device_;
  std::string link_;
};

}  // namespace turncal
