#include "orchestrator/report/navigation_report.h"

#include <fmt/format.h>

#include "calib/model/parameters.h"
#include "calib/navigation/mechanisation.h"
#include "imu_io/base/data_text.h"
#include "imu_io/base/text.h"
#include "orchestrator/report/verification_report.h"

namespace turncal {
namespace {

void describe_branch(const std::string& prefix, const NavigatedBranch& branch, KeyValues& lines) {
  const FreeNavigation& n = branch.navigation;
  const AttitudeAngles angles = angles_of(n.aligned.q_nb);
  const TrackPoint& end = n.track.back();
  for (const auto& [key, value] :
       std::initializer_list<std::pair<const char*, double>>{{"start_s", branch.start_s},
                                                             {"align_rest_s", n.align_rest_s},
                                                             {"heading_deg", angles.heading_rad / rad_per_deg},
                                                             {"pitch_deg", angles.pitch_rad / rad_per_deg},
                                                             {"roll_deg", angles.roll_rad / rad_per_deg},
                                                             {"sigma.heading_deg", n.heading_sigma_rad / rad_per_deg},
                                                             {"free_s", n.free_s},
                                                             {"north_m", end.moved_m[0]},
                                                             {"east_m", end.moved_m[1]},
                                                             {"velocity_north_mps", end.velocity_error_mps[0]},
                                                             {"velocity_east_mps", end.velocity_error_mps[1]},
                                                             {"velocity_rms_mps", n.velocity_rms_mps},
                                                             {"nm_per_h", n.nm_per_h}})
    lines.number(prefix + key, value);
}

void describe_drift(const std::string& prefix, const DriftOverRuns& drift, KeyValues& lines) {
  lines.number(prefix + "rms_nm_per_h", drift.rms_nm_per_h);
  lines.number(prefix + "cep_nm_per_h", drift.cep_nm_per_h);
  lines.number(prefix + "r95_nm_per_h", drift.r95_nm_per_h);
}

std::string drift_words(const DriftOverRuns& drift) {
  return fmt::format("rms {:.3f}, CEP {:.3f}, R95 {:.3f} NM/h", drift.rms_nm_per_h, drift.cep_nm_per_h,
                     drift.r95_nm_per_h);
}

Series series_of(const std::string& label, Colour colour, const FreeNavigation& navigation,
                 double (*value)(const TrackPoint&)) {
  constexpr std::size_t most_points = 900;
  Series series{.label = label, .colour = colour};
  series.points.reserve(navigation.track.size());
  for (const TrackPoint& point : navigation.track) series.points.emplace_back(point.time_s / 60.0, value(point));
  series.points = outline(series.points, most_points);
  return series;
}

double north_mmps(const TrackPoint& p) { return 1000.0 * p.velocity_error_mps[0]; }
double east_mmps(const TrackPoint& p) { return 1000.0 * p.velocity_error_mps[1]; }
double radial_m(const TrackPoint& p) { return p.moved_m.norm(); }
double radial_nm(const TrackPoint& p) { return radial_m(p) / metres_per_nautical_mile; }

// Rounds to the sigma's digits, from 0 on, so that 360.000 cannot appear.
Cell heading_cell(const FreeNavigation& n) {
  constexpr double steepest_deg = 80.0;
  const AttitudeAngles angles = angles_of(n.aligned.q_nb);
  const double heading_deg = angles.heading_rad / rad_per_deg, sigma_deg = n.heading_sigma_rad / rad_per_deg;
  if (std::abs(angles.pitch_rad) > steepest_deg * rad_per_deg) return cell::number("x vertical");
  const Cell rounded = cell::with_sigma(heading_deg, sigma_deg);
  return rounded.words.starts_with("360") ? cell::with_sigma(0.0, sigma_deg) : rounded;
}

}  // namespace

std::string format_navigation(const NavigationReport& report) {
  KeyValues lines;
  if (report.info.simulated) lines.comment("Simulated data: a dry run, or a twin.");
  lines.number("format", 1.0);
  lines.text("recording_hash", report.recording_hash);
  lines.text("unit_serial", report.info.unit_serial);
  lines.flag("simulated", report.info.simulated);
  lines.number("latitude_deg", report.info.latitude_deg);
  lines.number("gravity_mps2", report.info.gravity_mps2);
  if (!report.request.reference.empty()) {
    lines.text("reference", report.request.reference);
    lines.number("reference.longest_in_motion_s", report.reference_gap_s);
  }
  lines.number("align_s", report.request.align_s);
  if (!report.damage.empty()) lines.text("damage", report.damage);
  lines.number("filled_samples", double(report.filled_samples));
  lines.number("filled_in_motion", double(report.filled_in_motion));
  for (const auto& [key, texts] : {std::pair{"fault", &report.faults}, std::pair{"lost", &report.lost}})
    for (std::size_t k = 0; k < texts->size(); ++k) lines.text(fmt::format("{}.{}", key, k + 1), (*texts)[k]);
  for (const NavigatedFile& file : report.files) {
    lines.text(file.prefix + "parameters", file.path);
    lines.text(file.prefix + "model", file.model);
    lines.flag(file.prefix + "trusted", file.why_not_trusted.empty());
    lines.text(file.prefix + "trusted.reason", file.why_not_trusted);
    lines.number(file.prefix + "felt_latitude_deg", file.felt.latitude_rad / rad_per_deg);
    lines.number(file.prefix + "felt_latitude_sigma_deg", file.felt.sigma_rad / rad_per_deg);
    lines.number(file.prefix + "felt_gravity_mps2", file.felt.gravity_mps2);
    lines.text(file.prefix + "noise", file.noise_assumed ? "assumed" : "file");
    describe_drift(file.prefix + "drift.", file.drift, lines);
    lines.number(file.prefix + "velocity_rms_mps", file.velocity_rms_mps);
    if (file.expected) {
      lines.text(file.prefix + "expected.from", file.covariance_source);
      describe_drift(file.prefix + "expected.", *file.expected, lines);
    }
    lines.number(file.prefix + "branches", double(file.branches.size()));
    for (std::size_t k = 0; k < file.branches.size(); ++k)
      describe_branch(fmt::format("{}branch.{}.", file.prefix, k + 1), file.branches[k], lines);
  }
  return lines.take();
}

std::string format_track(const NavigationReport& report, const NavigatedFile& file) {
  std::string text =
      "branch,time_s,latitude_deg,longitude_deg,velocity_north_mps,velocity_east_mps,heading_deg,pitch_deg,roll_deg,"
      "north_m,east_m\n";
  NumberBuffer buffer;
  for (std::size_t k = 0; k < file.branches.size(); ++k) {
    const NavigatedBranch& branch = file.branches[k];
    for (const TrackPoint& point : branch.navigation.track) {
      const AttitudeAngles angles = angles_of(point.state.q_nb);
      text += format_number(k + 1, buffer);
      for (const double value :
           {branch.start_s + report.request.align_s + point.time_s, point.state.latitude_rad / rad_per_deg,
            point.state.longitude_rad / rad_per_deg, point.state.velocity_n_mps[0], point.state.velocity_n_mps[2],
            angles.heading_rad / rad_per_deg, angles.pitch_rad / rad_per_deg, angles.roll_rad / rad_per_deg,
            point.moved_m[0], point.moved_m[1]}) {
        text += ',';
        text += format_number(value, buffer);
      }
      text += '\n';
    }
  }
  return text;
}

Figure navigation_figure(const NavigationReport& report) {
  const bool moves = !report.request.reference.empty();
  Panel north, east, distance;
  north.title = moves ? "Velocity error north" : "Velocity north";
  east.title = moves ? "Velocity error east" : "Velocity east";
  distance.title = moves ? "Distance from the reference" : "Distance from the true position";
  double farthest_m = 0.0;
  for (const NavigatedFile& file : report.files)
    for (const NavigatedBranch& branch : file.branches)
      for (const TrackPoint& point : branch.navigation.track) farthest_m = std::max(farthest_m, radial_m(point));
  const bool near = farthest_m < metres_per_nautical_mile;
  north.y_label = east.y_label = "mm/s";
  distance.y_label = near ? "m" : "nautical miles (NM)";
  north.x_label = east.x_label = distance.x_label = "minutes of free navigation";
  for (auto file = report.files.rbegin(); file != report.files.rend(); ++file) {
    const bool against = !file->prefix.empty();
    const Colour colour = against ? Colour::before : Colour::after;
    for (std::size_t k = file->branches.size(); k-- > 0;) {
      const FreeNavigation& navigation = file->branches[k].navigation;
      const std::string label = k > 1     ? ""
                                : k == 1  ? (against ? "" : "other starts")
                                : against ? "compared with"
                                          : "first start";
      // The first branch stands out; the others show the scatter.
      const auto add = [&](Panel& at, double (*value)(const TrackPoint&)) {
        at.series.push_back(series_of(label, colour, navigation, value));
        if (k > 0) at.series.back().style = Series::Style::dashed;
      };
      add(north, north_mmps);
      add(east, east_mmps);
      add(distance, near ? radial_m : radial_nm);
    }
  }
  Figure figure = small_panels("navigation", "Velocity and position error of free inertial navigation against time",
                               "Over longer times the velocities oscillate with the Schuler period of 84.4 minutes.");
  figure.panels = {north, east, distance};
  return figure;
}

// In this time a turn at 0.1 g departs from the straight line between two rows by 3 m.
constexpr double seldom_s = 5.0;

Document navigation_document(const NavigationReport& report) {
  using namespace cell;
  const std::string heading = "Free navigation, unit " + report.info.unit_serial;
  Document document{"turncal: " + heading, heading};
  document.soft(fmt::format("Recording {} with content {}.", report.request.recording, report.recording_hash));
  if (report.info.simulated) document.add(Paragraph{"Simulated data: no real unit navigated.", "loud"}, Scope::page);
  const NavigatedFile& judged = report.files.front();
  const std::string expected = judged.expected ? "; expected: " + drift_words(*judged.expected) : "";
  const bool trusted = judged.why_not_trusted.empty();
  const std::string trust = trusted ? "" : "; the parameters are not trusted: " + judged.why_not_trusted;
  document.add(Paragraph{"Drift: " + drift_words(judged.drift) + expected + trust + ".",
                         trusted ? "verdict" : "verdict unexplained"},
               Scope::page);
  document.figure(navigation_figure(report));
  if (report.without_segments && report.request.reference.empty())
    document.text("no segments: everything counts as rest");
  if (report.reference_gap_s > seldom_s)
    document.text(
        fmt::format("the reference moves over {:.1f} s without a row: a straight line is assumed, and its error counts",
                    report.reference_gap_s));
  if (!report.damage.empty()) document.text(report.damage);
  if (report.filled_samples > 0)
    document.text(fmt::format("{} lost or bad; {} of them in a turn", counted(report.filled_samples, "sample"),
                              report.filled_in_motion));
  add_faults(report.faults, document);
  for (const std::string& branch : report.lost) document.text(branch);
  for (const NavigatedFile& file : report.files) {
    const std::string which = file.prefix.empty() ? "parameters" : "against";
    document.section(which, which + "  " + file.path);
    Table table{{number("branch"), number("alignment from s"), number("heading after it, deg"), number("sigma"),
                 number("free s"), number("north m"), number("east m"), number("NM/h")}};
    for (std::size_t k = 0; k < file.branches.size(); ++k) {
      const FreeNavigation& n = file.branches[k].navigation;
      const Eigen::Vector2d end = n.track.back().moved_m;
      const double spread_m = file.drift.rms_nm_per_h * metres_per_nautical_mile * n.free_s / 3600.0;
      table.row({count(k + 1), fixed(file.branches[k].start_s, 1), heading_cell(n),
                 number(n.heading_sigma_rad / rad_per_deg, 2), fixed(n.free_s, 0), with_sigma(end[0], spread_m),
                 with_sigma(end[1], spread_m), fixed(n.nm_per_h, 3)});
    }
    document.add(std::move(table));
    Facts facts;
    if (file.branches.size() + report.lost.size() < std::size_t(report.request.branches) &&
        report.request.branches != default_branches)
      facts.add("starts", fmt::format("{} of the {} asked for: the recording is too short for more",
                                      file.branches.size(), report.request.branches));
    facts.add("drift", fmt::format("{}; velocity rms {:.3f} m/s", drift_words(file.drift), file.velocity_rms_mps));
    if (file.expected) {
      facts.add("expected", drift_words(*file.expected) + " at the end of the first branch, from noise" +
                                (file.covariance_source == "none"      ? " alone"
                                 : file.covariance_source == "effects" ? " alone (the file has effects)"
                                                                       : " and parameters"));
      if (file.noise_assumed) facts.add("noise", assumed_noise_words);
    }
    if (file.felt.weighs_against(report.info.gravity_mps2))
      facts.add("GRAVITY",
                gravity_words(file.felt, report.info.gravity_mps2) + ": one of the two, or the calibration, is wrong");
    if (file.felt.speaks_against(report.info.latitude_deg * rad_per_deg))
      facts.add("LATITUDE",
                latitude_words(file.felt, report.info.latitude_deg) + ": one of the two, or the calibration, is wrong");
    if (!file.why_not_trusted.empty()) facts.add("not trusted", file.why_not_trusted);
    document.add(std::move(facts));
  }
  return document;
}

}  // namespace turncal
