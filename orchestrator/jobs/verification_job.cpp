#include "orchestrator/jobs/verification_job.h"

#include <algorithm>
#include <cmath>

#include "calib/navigation/alignment.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/recordings/number_table.h"
#include "orchestrator/jobs/calibrated_intervals.h"
#include "orchestrator/jobs/stored_estimate.h"

namespace turncal {
namespace {

// Sigmas of heading, roll and pitch, of an attitude error phi in n (north, up, east) of a unit that is level. What the gyros have turned
// since they last counted is not in the attitude: a part of a pulse.
std::array<double, 3> angle_sigmas_deg(const DriftMatrix& covariance, const Eigen::Quaterniond& q_nb,
                                       double gyro_pulse_rad) {
  const Eigen::Matrix3d C_nb = q_nb.toRotationMatrix();
  const Eigen::Matrix3d of_body = C_nb.transpose() * covariance.topLeftCorner<3, 3>() * C_nb;
  const auto sigma = [&](double variance) {
    return std::sqrt(std::max(0.0, variance) + gyro_pulse_rad * gyro_pulse_rad / 12.0) / rad_per_deg;
  };
  return {sigma(covariance(1, 1)), sigma(of_body(0, 0)), sigma(of_body(2, 2))};
}

Result<NorthReading> reading_of(std::span<const MotionInterval> dwell, double table_deg,
                                const DriftCovariance::Site& site, const NoiseModel& noise, const CountsModel& counts,
                                const ParameterCovariance& parameters) {
  Result<Alignment> alignment = align(dwell, site, DriftCovariance(site, noise, counts));
  if (!alignment) return alignment.error();
  const Eigen::Quaterniond& q = alignment->state.q_nb;
  const AttitudeAngles angles = angles_of(q);
  NorthReading reading;
  reading.table_deg = table_deg;
  reading.angle_deg = {angles.heading_rad / rad_per_deg, angles.roll_rad / rad_per_deg, angles.pitch_rad / rad_per_deg};
  reading.noise_sigma_deg = angle_sigmas_deg(alignment->drift.noise_covariance(), q, noise.gyro_pulse_rad);
  reading.total_sigma_deg = angle_sigmas_deg(alignment->drift.covariance(parameters), q, noise.gyro_pulse_rad);
  return reading;
}

// Both limits are from minus to plus.
UnitVerdict judge_size(double value, double sigma, double limit, double guard_factor) {
  return judge_value(value, sigma, Limit{-limit, limit}, guard_factor);
}

}  // namespace

Result<VerificationReport> verify_recording(const VerificationRequest& request) {
  Result<std::unique_ptr<RecordingSource>> opened = RecordingSource::open(request.recording);
  if (!opened) return opened.error();
  RecordingSource& source = **opened;
  const RecordingInfo info = source.info();
  std::vector<CalibratedIntervals> files;
  Result<CalibratedIntervals> calibrated = calibrated_intervals(request.parameters, source);
  if (!calibrated) return calibrated.error();
  files.push_back(std::move(*calibrated));
  if (Status status = integrate_recording(source, {}, files); !status) return status.error();
  const std::vector<MotionInterval>& intervals = files.front().integrator.intervals();
  const Result<NoiseModel> noise = stored_noise(files.front().file, request.parameters);
  if (!noise) return noise.error();
  const Result<StoredCovariance> covariance = stored_covariance(files.front().file, request.parameters);
  if (!covariance) return covariance.error();
  const CountsModel counts = counts_model(from_vector(files.front().file.parameters), info);
  const DriftCovariance::Site site{info.latitude_deg * rad_per_deg, info.gravity_mps2};

  std::vector<NorthReading> searches, readings;
  double shortest_s = 1e300;
  const Segments& segments = source.segments();
  const std::int64_t first = segments.empty() ? 0 : segments.front().start_sample;
  for (const Segment& segment : segments) {
    if (segment.kind == SegmentKind::rotate) continue;
    const std::string where = request.recording + ": step " + std::to_string(segment.step) + ": ";
    if (std::remainder(segment.pitch_deg, 360.0) != 0.0 || std::remainder(segment.roll_deg, 360.0) != 0.0)
      return input_error(where + "expected the table at pitch 0 and roll 0 to seek north");
    // Whole intervals inside the segment.
    const double samples_each = static_cast<double>(files.front().integrator.samples_per_interval());
    const auto begin =
        static_cast<std::size_t>(std::ceil(static_cast<double>(segment.start_sample - first) / samples_each));
    const auto end = std::min(intervals.size(),
                              static_cast<std::size_t>(static_cast<double>(segment.end_sample - first) / samples_each));
    if (begin >= end) return input_error(where + "no samples");
    const std::span<const MotionInterval> dwell = std::span(intervals).subspan(begin, end - begin);
    shortest_s = std::min(shortest_s, static_cast<double>(dwell.size()) * dwell.front().duration_s);
    const Result<NorthReading> reading =
        reading_of(dwell, segment.heading_deg, site, *noise, counts, covariance->covariance);
    if (!reading) return Error{reading.error().kind, where + reading.error().message};
    (segment.kind == SegmentKind::align ? searches : readings).push_back(*reading);
  }
  if (searches.empty() || readings.empty())
    return input_error(request.recording +
                       ": expected align dwells that set the table's zero and static ones that count");

  VerificationReport report;
  report.info = info;
  const Result<std::string> hash = source.content_hash();
  if (!hash) return hash.error();
  report.recording_hash = *hash;
  report.parameters = request.parameters;
  report.align_s = shortest_s;
  report.found = seek_north(searches, readings);
  report.heading_limit_deg = request.limits.heading_deg;
  report.level_limit_deg = request.limits.level_deg;
  report.guard_factor = request.limits.guard_factor;
  report.heading = judge_size(report.found.worst_heading_error_deg, report.found.worst_heading.total_sigma_deg[0],
                              report.heading_limit_deg, report.guard_factor);
  for (std::size_t k = 0; k < 2; ++k)
    report.level =
        std::max(report.level, judge_size(report.found.worst_level_deviation_deg[k], report.found.level_sigma_deg[k],
                                          report.level_limit_deg, report.guard_factor));
  report.verdict = std::max(report.heading, report.level);
  return report;
}

Result<ReferenceReport> verify_references(const std::string& csv) {
  const Result<std::string> content = read_whole_file(csv);
  if (!content) return content.error();
  std::vector<WantedColumn> wanted;
  for (const char* prefix : {"", "reference_"})
    for (const char* angle : north_angle_names) wanted.push_back({std::string(prefix) + angle + "_deg"});
  const Result<NumberTable> table = read_number_table(*content, csv, wanted, TableFormat{});
  if (!table) return table.error();
  if (table->rows() < 2)
    return input_error(csv + ": " + std::to_string(table->rows()) +
                       " rows, expected two and more: the first binds the references to the unit");
  std::vector<ReferenceRow> rows(table->rows());
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (std::size_t a = 0; a < 3; ++a) {
      rows[row].unit_deg[a] = table->columns[a][row];
      rows[row].reference_deg[a] = table->columns[a + 3][row];
      for (const double value : {rows[row].unit_deg[a], rows[row].reference_deg[a]})
        if (!(std::abs(value) <= 360.0))
          return input_error(csv + ":" + std::to_string(table->line[row]) + ": expected angles from -360 to 360 deg");
    }
  ReferenceReport report;
  report.file = csv;
  report.found = compare_references(rows);
  report.limit_deg = reference_limits_deg;
  report.pass = true;
  for (std::size_t a = 0; a < 3; ++a) report.pass = report.pass && report.found.worst_deg[a] <= report.limit_deg[a];
  return report;
}

Status verification_status(const std::string& what, UnitVerdict verdict) {
  if (is_accepted(verdict)) return {};
  return Error{ErrorKind::unit_failed, what + ": verification: " + std::string(to_string(verdict))};
}

}  // namespace turncal
