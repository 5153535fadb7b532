// Passes a unit's samples on and keeps what a table turned by hand is compared with: the mean specific force of the last second
// (GravitySense), and what the gyros have added up to (TurnSense).
//
// Mean of the accelerometers' increments, per sample, in their own unit; empty before there is a second of samples, and while the
// means of its two halves differ by more than 2 % (the unit turns). The sum: degrees by the nominal scale; through samples that were lost
// the unit turned on as in the next one. One thread.
#pragma once

#include <array>
#include <optional>

#include "imu_io/recordings/imu_source.h"

namespace turncal {

class GravityWatch : public ImuSource {
 public:
  GravityWatch(ImuSource& source, double sample_period_s);  // the source must outlive this

  std::optional<std::array<double, 3>> mean() const;
  std::optional<std::array<double, 3>> turned_deg() const { return counter_ ? std::optional(turned_) : std::nullopt; }

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
  std::array<double, 3> turned_{};
  std::optional<std::int64_t> counter_;  // of the last sample
  double deg_per_count_ = 0.0;
  std::optional<std::array<double, 3>> last_, before_;  // means of the two halves
};

}  // namespace turncal
