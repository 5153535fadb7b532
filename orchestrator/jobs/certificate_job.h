// The certificate of one or more runs of a unit (orchestrator/report/certificate.h), from what they left on disk.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

struct CertificateRequest {
  std::vector<std::string>
      runs;             // folders, oldest first: the last one's result is certified, all give the repeatability
  std::string station;  // laboratory.*, customer.*
  bool specimen = false;
};

// Errors: kind input for folders without a result, of several units, of a recording given twice, or in another order; unit_failed for results that are simulated or not
// trusted, unless a specimen is asked for.
Result<std::string> make_certificate(const CertificateRequest& request);

}  // namespace turncal
