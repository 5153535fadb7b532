// The unit's end of a line, for the twin and the tests: what the station calls by its imu.device (byte_line.h), from the other side.
//
//   a path               a pseudo-terminal, with a link of that name (pty.h)
//   tcp:HOST:PORT        listens there; one station at a time
//   udp:[ADDRESS:]PORT   sends there, or to this machine
//   udp_to:HOST:PORT     hears requests there, and answers whoever asked last
// What is sent while no station is there is lost, as on a real line.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "calib/types/status.h"

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

Result<std::unique_ptr<UnitEnd>> open_unit_end(const std::string& device);

}  // namespace turncal
