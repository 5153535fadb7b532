// A run's recording on disk. While it grows it is called `recording.partial.tcr`; only when it is complete and synced does it
// get its name `recording.tcr`, so that no part of a run can be taken for a whole one.
#pragma once

#include <optional>
#include <string>

#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/run/run_observer.h"

namespace turncal {

class RecordingSink : public RunSink {
 public:
  explicit RecordingSink(std::string folder) : folder_(std::move(folder)) {}
  Status start(const RecordingInfo& info) override;
  Status resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) override;
  Status begin_segment(const Segment& segment) override { return writer_->begin_segment(segment); }
  Status add(std::span<const ImuSample> samples) override { return writer_->add(samples); }
  Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) override {
    return writer_->end_segment(kind, end_sample, angles_deg);
  }
  // A rest that another take of it stands in for.
  Status set_aside(const Segment& rest) { return writer_->set_aside(rest); }
  Status sync() override { return writer_->sync(); }
  std::optional<std::uint32_t> written() const override;
  Status finish() override;

  std::string path() const;  // of the finished recording

 private:
  std::string folder_;
  std::optional<RecordingWriter> writer_;
};

}  // namespace turncal
