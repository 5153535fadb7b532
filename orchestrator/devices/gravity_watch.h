// Passes a unit's samples on and keeps the mean specific force of the last second, for a table turned by hand (GravitySense).
//
// Mean of the accelerometers' increments, per sample, in their own unit; empty before there is a second of samples, and while the
// means of its two halves differ by more than 2 % (the unit turns). One thread.
#pragma once

#include <array>
#include <optional>

#include "imu_io/recordings/imu_source.h"

namespace turncal {

class GravityWatch : public ImuSource {
 public:
  GravityWatch(ImuSource& source, double sample_period_s);  // the source must outlive this

  std::optional<std::array<double, 3>> mean() const;

  Status open() override;
  Result<ImuIdentity> identify() override { return source_.identify(); }
  void describe(RecordingInfo& info) const override { source_.describe(info); }
  Result<std::size_t> read(std::span<ImuSample> out, double timeout_s) override;
  ImuLinkCounters counters() const override { return source_.counters(); }
  void close() override { source_.close(); }

 private:
  ImuSource& source_;
  int half_samples_;
  int count_ = 0;  // of the half that is being filled
  std::array<double, 3> sum_{};
  std::optional<std::array<double, 3>> last_, before_;  // means of the two halves
};

}  // namespace turncal
