// North seeking made of a recording of it (docs/verification.md): each `align` segment is a search for the table's zero, each `static` one an
// alignment that counts, where the table stands at the heading of the segment. And readings of references, from a file.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/verification_report.h"

namespace turncal {

// What the recording does not say: the calibration, and the limits of the station.
struct VerificationRequest {
  std::string recording;
  std::string parameters;  // how the file is called
  ParameterFile file;
  VerdictLimits limits;
  int first_step = 0;  // of the north seeking; what a calibration before it recorded is left alone
};

// What a north seeking needs, of a plan as of a recording of one: at least one search, two alignments that count in each position, the
// table at pitch and roll 0, and each of them as long as alignment.h asks for. `where` begins the message.
Status check_north_seeking(const Segments& segments, int first_step, double sample_period_s, const std::string& where);

// An alignment in which more samples were lost than are filled in (calibrated_intervals.h) is left out.
// Errors: kind input for files that cannot be used, and check_north_seeking; unit_failed where too few alignments are left to judge.
Result<VerificationReport> verify_recording(const VerificationRequest& request);

// Wang (2020), 4.3: heading better than 0.009 deg, roll and pitch better than 0.06 deg.
inline constexpr std::array<double, 3> reference_limits_deg = {0.009, 0.06, 0.06};

// A CSV with the columns heading_deg, roll_deg, pitch_deg, reference_heading_deg, reference_roll_deg, reference_pitch_deg.
Result<ReferenceReport> verify_references(const std::string& csv, const std::array<double, 3>& limit_deg);

// Kind unit_failed unless the verdict is one to accept.
Status verification_status(const std::string& what, UnitVerdict verdict);

}  // namespace turncal
