// Where a run puts what it captures: the recording on disk, or a test's memory.
//
// Calls come in this order: start (or resume), then begin_segment / add... / end_segment over and over, sync after every step, and finish.
// Counters count from 0 at the first sample of the recording. Any error ends the run.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "calib/types/axis.h"
#include "calib/types/recording_types.h"
#include "calib/types/status.h"

namespace turncal {

class RunSink {
 public:
  virtual ~RunSink() = default;
  virtual Status start(const RecordingInfo& info) = 0;
  // Instead of start: goes on after the segment that ended at end_sample; whatever came after it is dropped. An error when
  // the recording there is not of the same unit, site and kind, or, where `written` is given, not what written() said then.
  virtual Status resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) = 0;
  virtual Status begin_segment(const Segment& segment) = 0;  // end_sample is not yet known
  virtual Status add(std::span<const ImuSample> samples) = 0;
  // The final kind: a dwell that does not count is closed as rotate.
  virtual Status end_segment(SegmentKind kind, std::int64_t end_sample, const AxisTriple& angles_deg) = 0;
  virtual Status sync() = 0;
  // A hash of all that was kept so far; nothing where nothing is kept.
  virtual std::optional<std::uint32_t> written() const = 0;
  virtual Status finish() = 0;  // complete and durable
  // What was found wrong with the unit itself, not with storing; asked when a segment has ended. A recording judges nothing.
  virtual Status unit_fits() const { return {}; }
};

}  // namespace turncal
