// The outcome of a verification as a file and as the tables of the paper.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "calib/navigation/alignment.h"
#include "calib/navigation/north_seeking.h"
#include "calib/types/recording_types.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

struct VerificationReport {
  RecordingInfo info;
  std::string recording_hash;
  std::string parameters;             // file
  bool trusted = true;                // as the file says of itself
  double align_s = 0.0;               // of the shortest alignment
  std::int64_t filled_samples = 0;    // lost or bad, as their neighbours
  std::vector<std::string> left_out;  // alignments in which more samples were lost
  NorthSeeking found;
  RestLatitude felt;
  double false_fail = 0.0;  // chance that a good unit fails
  double would_do_s =
      0.0;             // undecided, noise explains what was found: how long an alignment would have to be; 0: decided
  std::string damage;  // of the recording; empty: none
  double heading_limit_deg = 0.0, level_limit_deg = 0.0, guard_factor = 1.0;
  UnitVerdict heading = UnitVerdict::not_judged, level = UnitVerdict::not_judged;
  UnitVerdict latitude = UnitVerdict::not_judged;
  // The worst of them; not better than hold for parameters that are not trusted.
  UnitVerdict verdict = UnitVerdict::not_judged;
};

std::string format_verification(const VerificationReport& report);
// The figures and their limits, for a verdict's reason.
std::string verification_words(const VerificationReport& report);
// Why it is undecided; empty where it is not.
std::string undecided_words(const VerificationReport& report);
std::string latitude_words(const RestLatitude& felt, double of_recording_deg);
inline constexpr const char* not_trusted_words =
    "NOT TRUSTED: the parameter file says that its sigmas cannot be believed";
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
