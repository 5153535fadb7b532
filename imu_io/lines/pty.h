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

namespace turncal {

class Pty {
 public:
  Pty() = default;
  Pty(Pty&& other) noexcept;
  Pty& operator=(Pty&& other) noexcept;
  ~Pty();

  static Result<Pty> create(const std::string& link_path = "");
  bool is_open() const { return fd_ >= 0; }
  const std::string& device() const { return device_; }  // the link where there is one
  int descriptor() const { return fd_; }
  // Whether somebody has the device open.
  bool has_peer() const;
  // Everything, waiting at most timeout_s for room; at once and without an effect when there is no peer.
  Status write_all(std::span<const std::byte> data, double timeout_s);
  Status write_all(std::string_view text, double timeout_s);
  // What the peer sent, at most out.size(); 0: nothing within timeout_s, or no peer.
  Result<std::size_t> read(std::span<std::byte> out, double timeout_s);
  void unplug();  // removes the link too

 private:
  int fd_ = -1;
  std::string device_;
  std::string link_;
};

}  // namespace turncal
