// Evaluates a recording of a north seeking (docs/verification.md): each `align` segment is a search for the table's zero, each `static` one a
// counted alignment with the table at the heading of the segment. Also evaluates reference readings from a file.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/report/verification_report.h"

namespace turncal {

// Everything that the recording does not hold: the calibration, and the limits of the station.
struct VerificationRequest {
  std::string recording;
  std::string parameters;  // name of the file
  ParameterFile file;
  VerdictLimits limits;
  int first_step = 0;  // of the north seeking; an earlier calibration is ignored
};

// Checks the requirements of a north seeking, in a plan or a recording: at least one search, two counted alignments in each position, the
// table at pitch and roll 0, and each as long as alignment.h requires. `where` begins the message.
Status check_north_seeking(const Segments& segments, int first_step, double sample_period_s, const std::string& where);

// Evaluates the recording. An alignment with a gap too long to fill (calibrated_intervals.h) is left out.
// Errors: kind input for unusable files, and check_north_seeking; unit_failed when too few alignments are left to judge.
Result<VerificationReport> verify_recording(const VerificationRequest& request);

// Wang (2020), 4.3: heading better than 0.009 deg, roll and pitch better than 0.06 deg.
inline constexpr std::array<double, 3> reference_limits_deg = {0.009, 0.06, 0.06};

// Judges a CSV with the columns heading_deg, roll_deg, pitch_deg, reference_heading_deg, reference_roll_deg, reference_pitch_deg.
Result<ReferenceReport> verify_references(const std::string& csv, const std::array<double, 3>& limit_deg);

// Returns an error of kind unit_failed unless the verdict is accepted.
Status verification_status(const std::string& what, UnitVerdict verdict);

}  // namespace turncal
