// The calibration certificate: what ISO/IEC 17025:2017, 7.8 asks for, as one HTML document that prints on A4 (docs/report.md).
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
  double estimate = 0.0;  // noise and all that is estimated along: the fit's own covariance
  // What the sigma of the parameter file holds beyond it: the spread over effects that the recording cannot tell apart, and what came near
  // to being claimed (quality.alias.<parameter>). Empty: no diagnosis was made.
  std::optional<double> alias;
  double gravity = 0.0;   // of the site's gravity: specific force is measured in units of it
  double latitude = 0.0;  // bound: Earth's rate times the error of latitude, whatever the attitudes average
  std::optional<double> repeatability;  // sample standard deviation over the runs; empty: a single run
  double expanded() const;              // U = 2 times the root of the sum of squares
};

struct Certificate {
  ParameterFile file;                         // the result that is certified
  std::vector<std::string> recording_hashes;  // of all runs, that of the result last
  std::array<UncertaintyBudget, parameter_count> budget{};
  std::vector<UncertaintyBudget> effect_budget;  // of each of file.effects
  VerdictReport conformity;                      // by the expanded uncertainties of the budget
  Parties parties;
  std::string parameters_hash;
  std::optional<VerificationReport> verification;  // empty: not made
  std::string issued_utc;
  bool specimen = false;
};

UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, std::size_t parameter, const Parties& parties);
// Of an effect of the last of the runs. The spread over confounded effects is in its sigma, so in the estimate.
UncertaintyBudget budget_of(const std::vector<ParameterFile>& runs, const EffectValue& effect);
// What has to stand on a certificate and is not given, as keys; empty: nothing is missing.
std::vector<std::string> missing_keys(const ParameterFile& file, const Parties& parties);

std::string certificate_page(const Certificate& certificate);
// The hash that a page carries is that of the whole file (hash_of_text) with the hash itself taken out wherever it stands. An input error
// for a file that is no certificate, and for one that was changed after it was issued.
Result<std::string> check_certificate(std::string page, const std::string& file_name);

}  // namespace turncal
