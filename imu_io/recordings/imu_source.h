// One abstract source of IMU samples: the rig, a serial port, a replayed recording.
//
// Reading is what makes time pass in the station's loop: read() returns what has arrived, waiting at most timeout_s.
// In a dry run read() advances the rig by the samples it returns; nothing else does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

struct ImuIdentity {
  std::string unit_serial;  // empty: the unit does not tell
  std::string description;  // what stands on the other end, for the log
};

struct ImuLinkCounters {
  std::uint64_t samples = 0;
  std::uint64_t lost_samples = 0;  // by the unit's counter
  std::uint64_t duplicates = 0;
  std::uint64_t bad_frames = 0;
  std::uint64_t resyncs = 0;
};

class ImuSource {
 public:
  virtual ~ImuSource() = default;
  virtual Status open() = 0;
  virtual Result<ImuIdentity> identify() = 0;
  // What the samples are: period, increment kinds, pulse weight, temperature. Site and serial are left as they are.
  virtual void describe(RecordingInfo& info) const = 0;
  // Number of samples written to the front of `out`, in counter order, at most out.size(); 0 after timeout_s, or earlier, without
  // one. An error (kind device) means the link is gone; read() is not to be called again before open().
  virtual Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) = 0;
  virtual ImuLinkCounters counters() const = 0;
  virtual void close() = 0;
};

}  // namespace turncal
