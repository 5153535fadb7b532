// The outcome of a verification as a file and as the tables of the paper.
#pragma once

#include <ostream>
#include <string>

#include "calib/navigation/north_seeking.h"
#include "calib/types/recording_types.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

struct VerificationReport {
  RecordingInfo info;
  std::string recording_hash;
  std::string parameters;  // file
  double align_s = 0.0;    // of the shortest alignment
  NorthSeeking found;
  double heading_limit_deg = 0.0, level_limit_deg = 0.0, guard_factor = 1.0;
  UnitVerdict heading = UnitVerdict::not_judged, level = UnitVerdict::not_judged;
  UnitVerdict verdict = UnitVerdict::not_judged;  // the worse of the two
};

std::string format_verification(const VerificationReport& report);
void print_verification(const VerificationReport& report, std::ostream& out);

struct ReferenceReport {
  std::string file;
  ReferenceComparison found;
  std::array<double, 3> limit_deg{};  // by NorthAngle
  bool pass = false;
};
std::string format_references(const ReferenceReport& report);
void print_references(const ReferenceReport& report, std::ostream& out);

}  // namespace turncal
