// The calibration certificate with the contents of ISO/IEC 17025:2017, 7.8, as one HTML document that prints on A4 (docs/report.md).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/verification_report.h"
#include "orchestrator/station/station_config.h"

namespace turncal {

// Standard uncertainties (k = 1) of one parameter, in its unit.
struct UncertaintyBudget {
  double estimate = 0.0;  // noise and everything estimated jointly: the fit's own covariance
  // The part of the parameter file's sigma beyond it: the spread over confounded effects, and over effects that were nearly
  // claimed (quality.alias.<parameter>). Empty: no diagnosis was made.
  std::optional<double> alias;
  double gravity = 0.0;   // from the site's gravity, in units of which specific force is measured
  double latitude = 0.0;  // upper bound: Earth rate times the error of latitude, whatever the attitudes average out
  std::optional<double> repeatability;  // sample standard deviation over the runs; empty: a single run
  double expanded() const;              // U = 2 times the root of the sum of squares
};

struct Certificate {
  ParameterFile file;                         // the certified result
  std::vector<std::string> recording_hashes;  // of all runs; the result's is the last
  std::array<UncertaintyBudget, parameter_count> budget{};
  std::vector<UncertaintyBudget> effect_budget;  // one for each of file.effects
  VerdictReport conformity;                      // judged with the expanded uncertainties of the budget
  Parties parties;
  std::string parameters_hash;
  std::optional<VerificationReport> verification;  // empty: not made
  std::string issued_utc;
  bool specimen = false;
};

UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, std::size_t parameter, const Parties& parties);
// Returns the budget of an effect of the last run. Its sigma, and so `estimate`, contains the spread over confounded effects.
UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, const EffectValue& effect);
// Returns the keys that a certificate requires and that are missing; empty: none.
std::vector<std::string> missing_keys(const ParameterFile& file, const Parties& parties);

std::string certificate_page(const Certificate& certificate);
// Checks the hash in a page: it is that of the whole file (hash_of_text) with every occurrence of the hash removed. An input error
// for a file that is not a certificate, and for one that was changed after it was issued.
Result<std::string> check_certificate(std::string page, const std::string& file_name);

}  // namespace turncal
