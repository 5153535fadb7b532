// The abstract source of IMU samples: the rig, a unit on a line, a replayed recording.
//
// Reading makes time pass in the station's loop: read() returns the samples that have arrived, waiting at most timeout_s.
// In a dry run read() advances the rig by the samples that it returns; nothing else does.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

struct ImuIdentity {
  std::string unit_serial;  // empty: the unit does not report it
  std::string description;  // what is at the other end of the line, for the log
};

struct ImuLinkCounters {
  std::uint64_t samples = 0;
  std::uint64_t lost_samples = 0;  // from gaps in the unit's counter
  std::uint64_t duplicates = 0;
  std::uint64_t bad_frames = 0;
  std::uint64_t resyncs = 0;
};

class ImuSource {
 public:
  virtual ~ImuSource() = default;
  virtual Status open() = 0;
  virtual Result<ImuIdentity> identify() = 0;
  // Fills in the properties of the samples: period, increment kinds, pulse weight, temperature. Site and serial are left unchanged.
  virtual void describe(RecordingInfo& info) const = 0;
  // Writes samples to the front of `out` in counter order and returns their number, at most out.size(); 0 if none came within timeout_s
  // or less. An error (kind device) means that the line is broken; call open() before the next read().
  virtual Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) = 0;
  virtual ImuLinkCounters counters() const = 0;
  virtual void close() = 0;
};

}  // namespace turncal
