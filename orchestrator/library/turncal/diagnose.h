// `turncal diagnose`: finds effects beyond the 24 parameters in the data (docs/diagnosis.md).
#pragma once

#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <turncal/parameters.h>
#include <turncal/recording.h>
#include <turncal/report.h>

namespace turncal::v0 {

struct DiagnoseOptions {
  std::vector<Recording> holdouts = {};  // of the same unit, not used in the fit
  std::string time_utc = {};             // for the record; empty: now
};

struct Diagnosis {
  std::string verdict;                                     // clean, extended, unexplained, noise_model, not_tested
  std::vector<std::string> effects;                        // added, strongest first
  std::optional<Parameters> parameters;                    // with the effects; none when nothing was tested
  std::vector<std::pair<std::string, std::string>> items;  // of diagnosis.conf (docs/report.md)
  std::string text;                                        // diagnosis.conf
  Report report;
};

// Diagnoses recordings. The worth of the effects in navigation is reported only for recordings loaded from a file.
TURNCAL_API Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options = {});
inline Diagnosis diagnose(const Recording& recording, const DiagnoseOptions& options = {}) {
  return diagnose(std::span(&recording, 1), options);
}

}  // namespace turncal::v0
