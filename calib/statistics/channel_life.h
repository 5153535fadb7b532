// Does every channel live? A dead one gives the same value all the time, a stuck one does from some sample on. At rest a gyro that counts
// pulses may well repeat itself, so what is asked is that a channel changes while the table turns the unit: through a whole circle in
// all, by the table's angles, and for 20 s at least.
// A gyro across the axis of a turn feels nothing of it, and one that points west before and after, a half or a whole circle on, may give
// no pulse for minutes. So such a turn, where the other two gyros feel it whole by the nominal scale, says nothing of the third. Nor does
// a turn in which a channel still changed say anything of it: an accelerometer may well repeat itself from the end of a turn on.
//
// Not seen: a channel that is stuck for less than that; one that sticks near its true value and still flickers.
#pragma once

#include <array>
#include <string>

#include "calib/statistics/implausible.h"

namespace turncal {

class ChannelLife {
 public:
  explicit ChannelLife(const RecordingInfo& info);
  void add(const ImuSample& sample);
  // The table turned the unit by so much, up to the last sample.
  void turned(double angle_deg);
  // What was found first, in one line; empty: nothing.
  const std::string& defect() const { return defect_; }

 private:
  struct Channel {
    double value = 0.0;
    std::int64_t since = 0;  // counter of the first sample with this value
    double turned_deg = 0.0;
    double sum = 0.0;  // since the table's last turn was told
  };
  bool says_nothing_of(std::size_t channel, double angle_deg) const;
  double sample_period_s_;
  double gyro_deg_ = 1.0;  // of a count, nominally
  std::array<Channel, 6> channels_{};
  std::int64_t first_ = 0, last_ = 0;
  std::int64_t told_ = 0;  // up to which the table's turns are known
  bool any_ = false;
  std::string defect_;
};

}  // namespace turncal
