// What a report has to know beside the Diagnosis itself.
#pragma once

#include <string>
#include <vector>

#include "calib/statistics/compression.h"
#include "orchestrator/figures/gnuplot.h"

namespace turncal {

struct DiagnosisContext {
  explicit DiagnosisContext(const CompressedRecording& fitted) : recording(fitted) {}
  const CompressedRecording& recording;  // the one that was fitted
  std::string recording_path;
  std::string recording_hash;
  std::string holdout_path;  // empty: none
  std::string time_utc;
  double false_alarm = 0.005;  // family-wise, as asked of diagnose()
  bool noise_given = false;    // configured, not fitted
  std::string method = "joint";
  bool of_run = false;             // made at the end of a run, which says the verdict on the unit itself
  bool hand_turned = false;        // no table angles: rests and rotations by hand
  std::vector<std::string> notes;  // on the data: damage, lost samples
  GnuplotOptions gnuplot;
};

}  // namespace turncal
