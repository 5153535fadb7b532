// What a report has to know beside the Diagnosis itself.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/statistics/compression.h"

namespace turncal {

// What the added effects are worth in free inertial navigation, nautical miles per hour, rms over branches.
struct NavigationWorth {
  std::string source;  // which data: "second recording", "fitted recording"
  std::size_t branches = 0;
  double free_s = 0.0;                                  // of the first branch
  double before = 0.0, after = 0.0;                     // the 24 parameters alone; with the effects
  double noise = 0.0;                                   // what noise alone lets expect
  std::vector<std::pair<std::string, double>> effects;  // each: what leaving it out moves the track by
};

// One of several recordings of a unit.
struct SwitchOn {
  std::string hash;
  std::optional<std::int64_t> started_utc_s;  // where it says so
};

struct DiagnosisContext {
  explicit DiagnosisContext(const CompressedRecording& fitted) : recording(fitted) {}
  const CompressedRecording& recording;  // the one that was fitted, or several joined
  std::string recording_path;
  std::string recording_hash;         // of several: of the first
  std::vector<SwitchOn> switched_on;  // all
  std::string holdout_path;           // empty: none
  std::string time_utc;
  double false_alarm = 0.005;  // family-wise, as asked of diagnose()
  bool noise_given = false;    // configured, not fitted
  std::string method = "joint";
  bool of_run = false;       // made at the end of a run, which says the verdict on the unit itself
  bool hand_turned = false;  // no table angles: rests and rotations by hand
  std::optional<NavigationWorth> worth;
  std::vector<std::string> notes;  // on the data: damage, lost samples
};

}  // namespace turncal
