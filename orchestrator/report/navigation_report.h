// Free navigation with a parameter file: the request, and the result as a file, a track, a figure and a document.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/navigation/free_navigation.h"
#include "calib/types/recording_types.h"
#include "orchestrator/report/document.h"

namespace turncal {

inline constexpr int default_branches = 8;

struct NavigationRequest {
  std::string recording;
  std::string parameters;  // empty: the recording holds calibrated increments, as `turncal apply` writes them
  std::string against;     // empty: none
  std::string reference;   // true track; empty: it does not move
  double align_s = 300.0;
  double from_s = 0.0;              // from the first sample of the recording
  std::optional<double> to_s;       // default: its end
  std::optional<double> free_s;     // of each branch; default: an hour, or less if the recording is shorter
  int branches = default_branches;  // at most; only branches with different starts
};

struct NavigatedBranch {
  double start_s = 0.0;  // begin of its alignment, from the first sample of the recording
  FreeNavigation navigation;
};

struct NavigatedFile {  // one parameter file
  std::string prefix;   // prefix of its keys: "" or "against."
  std::string path;
  std::string model;
  std::string covariance_source;
  std::string why_not_trusted;  // from the file; empty: it is trusted
  bool noise_assumed = false;   // the file has no noise keys
  FeltSite felt;
  std::vector<NavigatedBranch> branches;
  DriftOverRuns drift;
  std::optional<DriftOverRuns> expected;  // at the end of the first branch; empty for a unit that moves
  double velocity_rms_mps = 0.0;
};

struct NavigationReport {
  NavigationRequest request;
  std::string recording_hash;
  double reference_gap_s = 0.0;  // longest time between two rows of the reference over which it moves
  RecordingInfo info;
  std::int64_t filled_samples = 0;    // lost or bad, filled from their neighbours
  std::int64_t filled_in_motion = 0;  // those in which the unit turned
  std::vector<std::string> faults;    // impossible samples, left out
  std::vector<std::string> lost;      // branches that lost samples ended or excluded
  std::string damage;                 // of the recording; empty: none
  bool without_segments = false;      // everything counts as rest
  std::vector<NavigatedFile> files;   // the requested one, then that of --against
};

std::string format_navigation(const NavigationReport& report);
// Returns branch,time_s,latitude_deg,...: one row for each second of every branch.
std::string format_track(const NavigationReport& report, const NavigatedFile& file);
Figure navigation_figure(const NavigationReport& report);  // velocity and position errors against time
Document navigation_document(const NavigationReport& report);

}  // namespace turncal
