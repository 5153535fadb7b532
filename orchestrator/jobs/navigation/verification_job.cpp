#include "orchestrator/jobs/navigation/verification_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/navigation/alignment.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/number_table.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"

namespace turncal {
namespace {

// Rounding error of a difference of angles up to 360 deg that are written in decimals.
constexpr double of_rounding_deg = 1e-9;

// A verification is fair when it rejects a good unit at most this often; a deviation that noise exceeds less often is not taken for noise.
constexpr double fair_chance = 0.05, of_noise_alone = 0.01, no_limit_deg = 1e9;

// Returns the sigmas of heading, roll and pitch, with the part of a pulse that the gyros have turned since they last counted.
std::array<double, 3> angle_sigmas_deg(const DriftMatrix& covariance, const Eigen::Quaterniond& q_nb,
                                       double gyro_pulse_rad) {
  std::array<double, 3> sigmas = angle_sigmas(covariance.topLeftCorner<3, 3>(), q_nb);
  sigmas[0] = heading_sigma_of_data(sigmas[0]);
  for (double& sigma : sigmas) sigma = std::hypot(sigma, gyro_pulse_rad / std::sqrt(12.0)) / rad_per_deg;
  return sigmas;
}

Result<NorthReading> reading_of(std::span<const MotionInterval> dwell, double table_deg,
                                const DriftCovariance::Site& site, const NoiseModel& noise, const CountsModel& counts,
                                const ParameterCovariance& parameters) {
  Alignment alignment = TRY(align(dwell, site, DriftCovariance(site, noise, counts)));
  const Eigen::Quaterniond& q = alignment.state.q_nb;
  const AttitudeAngles angles = angles_of(q);
  NorthReading reading{
      .table_deg = table_deg,
      .angle_deg = {angles.heading_rad / rad_per_deg, angles.roll_rad / rad_per_deg, angles.pitch_rad / rad_per_deg},
      .noise_sigma_deg = angle_sigmas_deg(alignment.drift.noise_covariance(), q, noise.gyro_pulse_rad),
      .total_sigma_deg = angle_sigmas_deg(alignment.drift.covariance(parameters), q, noise.gyro_pulse_rad)};
  return reading;
}

// Returns the worse of two verdicts.
UnitVerdict judge_figures(const NorthFigure& one, const NorthFigure& other, double limit, double guard_factor) {
  const auto judged = [&](const NorthFigure& figure) {
    return judge_value(figure.value_deg, figure.sigma_deg, Limit{std::nullopt, limit}, guard_factor);
  };
  return std::max(judged(one), judged(other));
}

// Returns the heading sigma of a dwell of align_s, from the random walk of the level gyros alone.
double walk_sigma_deg(const NoiseModel& noise, double latitude_deg, double align_s) {
  const double walk = noise.angle_random_walk.head<2>().norm() / std::sqrt(2.0);
  return walk / (earth_rate_radps * std::cos(latitude_deg * rad_per_deg) * std::sqrt(align_s)) / rad_per_deg;
}

void judge_north(const VerdictLimits& limits, const NoiseModel& noise, VerificationReport& report) {
  report.heading_limit_deg = limits.heading_deg;
  report.level_limit_deg = limits.level_deg;
  report.guard_factor = limits.guard_factor;
  const NorthSeeking& found = report.found;
  report.heading = judge_figures(found.deviation[0], found.mean_heading, limits.heading_deg, limits.guard_factor);
  report.level = judge_figures(found.deviation[1], found.deviation[2], limits.level_deg, limits.guard_factor);
  report.false_fail = false_fail_probability(found, limits.heading_deg, limits.level_deg);
  // A deviation above the limit that noise alone explains says nothing about the calibration.
  const double seen_deg = std::max(found.deviation[0].value_deg, found.mean_heading.value_deg);
  const double factor = longer_alignment(found, limits.heading_deg, fair_chance,
                                         walk_sigma_deg(noise, report.info.latitude_deg, report.align_s));
  if (report.heading > UnitVerdict::hold && factor > 1.0 &&
      false_fail_probability(found, seen_deg, no_limit_deg) > of_noise_alone) {
    report.heading = UnitVerdict::hold;
    report.would_do_s = 60.0 * std::ceil(report.align_s * factor / 60.0);
  }
  const double level_deg = std::max(found.deviation[1].value_deg, found.deviation[2].value_deg);
  if (report.level > UnitVerdict::hold && false_fail_probability(found, no_limit_deg, limits.level_deg) > fair_chance &&
      false_fail_probability(found, no_limit_deg, level_deg) > of_noise_alone) {
    report.level = UnitVerdict::hold;
    report.level_undecided = true;
  }
  const bool elsewhere = report.felt.speaks_against(report.info.latitude_deg * rad_per_deg);
  report.latitude = elsewhere ? UnitVerdict::fail : UnitVerdict::pass;
  report.gravity = report.felt.weighs_against(report.info.gravity_mps2) ? UnitVerdict::fail : UnitVerdict::pass;
  report.verdict = std::max(verdict_of_figures(report), report.trusted ? UnitVerdict::pass : UnitVerdict::hold);
}

bool is_north_dwell(const Segment& segment, int first_step) {
  return segment.kind != SegmentKind::rotate && segment.step >= first_step;
}

}  // namespace

Status check_north_seeking(const Segments& segments, int first_step, double sample_period_s, const std::string& where) {
  int searches = 0, readings = 0;  // counts in the present position
  const Segment* last = nullptr;
  const auto alone = [&] {
    return input_error("{}: step {}: one alignment at heading {}, expected at least two: one alone has no deviation",
                       where, last->step, format_number(last->heading_deg));
  };
  for (const Segment& segment : segments) {
    if (!is_north_dwell(segment, first_step)) continue;
    const std::string at = where + ": step " + std::to_string(segment.step) + ": ";
    if (std::remainder(segment.pitch_deg, 360.0) != 0.0 || std::remainder(segment.roll_deg, 360.0) != 0.0)
      return input_error(at + "expected the table at pitch 0 and roll 0 to seek north");
    const double seconds = double(segment.end_sample - segment.start_sample) * sample_period_s;
    if (seconds < align_min_rest_s)
      return input_error("{}alignment: {} s at rest, expected at least {:g} s", at, std::lround(seconds),
                         align_min_rest_s);
    if (segment.kind == SegmentKind::align) {
      ++searches;
      continue;
    }
    if (last && last->heading_deg != segment.heading_deg) {
      if (readings < 2) return alone();
      readings = 0;
    }
    ++readings;
    last = &segment;
  }
  if (searches == 0 || last == nullptr)
    return input_error(where + ": expected align dwells that set the table's zero and static ones that count");
  return readings < 2 ? Status(alone()) : Status();
}

Result<VerificationReport> verify_recording(const VerificationRequest& request) {
  std::unique_ptr<RecordingSource> opened = TRY(RecordingSource::open(request.recording));
  RecordingSource& source = *opened;
  const RecordingInfo info = source.info();
  const Segments& segments = source.segments();
  TRY(check_north_seeking(segments, request.first_step, info.sample_period_s, request.recording));
  std::vector<CalibratedIntervals> files;
  files.push_back(TRY(calibrated_intervals(request.file, request.parameters, source)));
  const IntegratedSamples integrated = TRY(integrate_recording(source, {}, files));
  const std::vector<MotionInterval>& intervals = files.front().integrator.intervals();
  const NoiseModel noise = TRY(stored_noise(request.file, request.parameters));
  const StoredCovariance covariance = TRY(stored_covariance(request.file, request.parameters));
  const CountsModel counts = counts_model(from_vector(request.file.parameters), info);
  const DriftCovariance::Site site{info.latitude_deg * rad_per_deg, info.gravity_mps2};

  std::vector<NorthReading> searches, readings;
  std::vector<MotionInterval> rests;
  double shortest_s = 1e300;
  std::vector<std::pair<double, int>> positions;  // table heading, readings left
  VerificationReport report;
  if (source.damage().lost_data()) report.damage = describe(source.damage());
  report.faults = integrated.faults;
  report.noise_assumed = !has_noise(request.file);
  for (const SampleGap& gap : integrated.gaps) report.filled_samples += gap.is_short() ? gap.samples : 0;
  for (const Segment& segment : segments) {
    if (!is_north_dwell(segment, request.first_step)) continue;
    const bool reads = segment.kind != SegmentKind::align;
    if (reads && (positions.empty() || positions.back().first != segment.heading_deg))
      positions.emplace_back(segment.heading_deg, 0);
    if (const SampleGap* gap = long_gap_in(integrated.gaps, segment.start_sample, segment.end_sample)) {
      report.left_out.push_back(
          fmt::format("step {}: {}: {}", segment.step,
                      reads ? "alignment at heading " + format_number(segment.heading_deg) : "search for the zero",
                      gap_words(*gap)));
      continue;
    }
    // Takes the whole intervals inside the segment.
    const double samples_each = double(files.front().integrator.samples_per_interval());
    const auto place = [&](std::int64_t sample) {
      return double(std::max(std::int64_t{0}, sample - integrated.first_sample)) / samples_each;
    };
    const auto begin = std::size_t(std::ceil(place(segment.start_sample)));
    const auto end = std::min(intervals.size(), std::size_t(place(segment.end_sample)));
    const std::string where = request.recording + ": step " + std::to_string(segment.step) + ": ";
    if (begin >= end) return input_error(where + "no samples");
    const std::span<const MotionInterval> dwell = std::span(intervals).subspan(begin, end - begin);
    shortest_s = std::min(shortest_s, double(dwell.size()) * dwell.front().duration_s);
    rests.insert(rests.end(), dwell.begin(), dwell.end());
    const auto reading = reading_of(dwell, segment.heading_deg, site, noise, counts, covariance.covariance);
    if (!reading) return Error{reading.error().kind, where + reading.error().message};
    (reads ? readings : searches).push_back(*reading);
    if (reads) ++positions.back().second;
  }
  const auto few = std::ranges::find_if(positions, [](const auto& p) { return p.second < 2; });
  if (searches.empty() || few != positions.end())
    return Error{
        ErrorKind::unit_failed,
        fmt::format("{}: {}{} without lost samples; {}", request.recording, not_judged_words,
                    searches.empty() ? "no search for the zero"
                                     : fmt::format("{} at heading {}, expected at least two",
                                                   counted(few->second, "alignment"), format_number(few->first)),
                    report.left_out.empty() ? "" : report.left_out.front())};

  report.info = info;
  report.recording_hash = TRY(source.content_hash());
  report.parameters = request.parameters;
  report.calibration_hash = TRY(calibration_hash(request.file));
  report.trusted = is_trusted(request.file);
  report.why_not_trusted = why_not_trusted(request.file);
  report.align_s = shortest_s;
  report.found = seek_north(searches, readings);
  report.felt = felt_site(rests, noise, covariance.covariance);
  judge_north(request.limits, noise, report);
  return report;
}

Result<ReferenceReport> verify_references(const std::string& csv, const std::array<double, 3>& limit_deg) {
  TRY(expect_file(csv, FileKind::csv));
  const std::string content = TRY(read_whole_file(csv));
  std::vector<WantedColumn> wanted;
  for (const char* prefix : {"", "reference_"})
    for (const char* angle : north_angle_names) wanted.push_back({std::string(prefix) + angle + "_deg"});
  const NumberTable table = TRY(read_number_table(content, csv, wanted, TableFormat{.whole_rows = true}));
  if (table.rows() < 2)
    return input_error(csv + ": " + std::to_string(table.rows()) +
                       " rows, expected at least two: the first relates the references to the unit");
  std::vector<ReferenceRow> rows(table.rows());
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (std::size_t a = 0; a < 3; ++a) {
      rows[row].unit_deg[a] = table.columns[a][row];
      rows[row].reference_deg[a] = table.columns[a + 3][row];
      for (const double value : {rows[row].unit_deg[a], rows[row].reference_deg[a]})
        if (!(std::abs(value) <= 360.0))
          return input_error(csv + ":" + std::to_string(table.line[row]) + ": expected angles from -360 to 360 deg");
    }
  ReferenceReport report{.file = csv, .found = compare_references(rows), .limit_deg = limit_deg, .pass = true};
  for (std::size_t a = 0; a < 3; ++a)
    report.pass = report.pass && report.found.worst_deg[a] <= report.limit_deg[a] + of_rounding_deg;
  return report;
}

Status verification_status(const std::string& what, UnitVerdict verdict) {
  if (is_accepted(verdict)) return {};
  return Error{ErrorKind::unit_failed, what + ": verification: " + std::string(to_string(verdict))};
}

}  // namespace turncal
