// What changed from one version of a store to another: parameter by parameter in sigmas, verdict by verdict.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/report/document.h"

namespace turncal {

struct ParameterChange {
  std::string key;
  std::size_t recordings = 0;
  double mean = 0.0, rms = 0.0, largest = 0.0;  // new minus old, in sigmas of the new
  std::string largest_unit, largest_recording;  // its hash
  double sigma_ratio = 1.0;                     // new over old, the median
};

struct VersionChanges {
  std::string from, to;
  std::size_t both = 0, only_from = 0, only_to = 0;  // recordings
  std::vector<ParameterChange> parameters;
  std::map<std::pair<std::string, std::string>, std::size_t>
      verdicts;  // of the diagnosis, or `failed`: (old, new) -> recordings
};

Result<VersionChanges> compare_versions(const std::string& store, const std::string& from, const std::string& to);
Document changes_document(const VersionChanges& changes);

}  // namespace turncal
