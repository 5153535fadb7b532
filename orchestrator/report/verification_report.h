// The outcome of a verification: a file, the tables of the paper, and a page with the results beside their limits.
#pragma once

#include <string>
#include <vector>

#include "calib/navigation/alignment.h"
#include "calib/navigation/north_seeking.h"
#include "calib/types/recording_types.h"
#include "orchestrator/report/document.h"
#include "orchestrator/station/verdict.h"

namespace turncal {

struct VerificationReport {
  RecordingInfo info;
  std::string recording_hash;
  std::string parameters;             // file
  std::string calibration_hash;       // hash of its contents (parameter_file.h)
  bool trusted = true;                // from the file
  std::string why_not_trusted;        // from the file
  double align_s = 0.0;               // of the shortest alignment
  std::int64_t filled_samples = 0;    // lost or bad, filled from their neighbours
  std::vector<std::string> faults;    // impossible samples, left out
  std::vector<std::string> left_out;  // alignments with longer gaps
  NorthSeeking found;
  FeltSite felt;
  bool noise_assumed = false;    // the parameter file has none
  double false_fail = 0.0;       // chance that a good unit fails
  double would_do_s = 0.0;       // when noise may explain the result: the alignment time that would decide; 0: decided
  bool level_undecided = false;  // likewise for roll and pitch
  std::string damage;            // of the recording; empty: none
  double heading_limit_deg = 0.0, level_limit_deg = 0.0, guard_factor = 1.0;
  UnitVerdict heading = UnitVerdict::not_judged, level = UnitVerdict::not_judged;
  UnitVerdict latitude = UnitVerdict::not_judged, gravity = UnitVerdict::not_judged;
  // The worst of them; at best hold for parameters that are not trusted.
  UnitVerdict verdict = UnitVerdict::not_judged;
};

// verification.conf; the last line is a checksum (crc.h).
std::string format_verification(VerificationReport report);
// Writes that file, and beside it the page verification.html.
Status write_verification(const std::string& path, const VerificationReport& report);
// Reads what format_verification wrote, to the bit; every key must be there and valid. `info`: only what the file contains.
Result<VerificationReport> read_verification(const std::string& path);
UnitVerdict verdict_of_figures(const VerificationReport& report);  // whether or not the parameters are trusted
// Returns the figures and their limits, for a verdict's reason.
std::string figures_words(const VerificationReport& report);
std::string verification_words(const VerificationReport& report);  // and why the parameters are not trusted
std::string latitude_words(const FeltSite& felt, double of_recording_deg);
std::string gravity_words(const FeltSite& felt, double of_recording_mps2);
// Adds the defects of the samples that were left out, one line each.
void add_faults(const std::vector<std::string>& faults, Document& document);
// Reason of a verification that lost too much data to be judged; it writes no verification.conf.
inline constexpr const char* not_judged_words = "verification: not judged: ";
inline constexpr const char* assumed_noise_words =
    "assumed, the parameter file has no noise keys: 0.002 deg/sqrt(h) and 8 ug/sqrt(Hz)";
Document verification_document(const VerificationReport& report, const std::string& verdict_name = "verdict");

struct ReferenceReport {
  std::string file;
  ReferenceComparison found;
  std::array<double, 3> limit_deg{};  // in the order of north_angle_names
  bool pass = false;
};
std::string format_references(const ReferenceReport& report);
Document reference_document(const ReferenceReport& report);

}  // namespace turncal
