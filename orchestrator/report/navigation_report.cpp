#include "orchestrator/report/navigation_report.h"

#include <cmath>
#include <cstdio>

#include "calib/model/parameters.h"
#include "calib/navigation/mechanisation.h"
#include "imu_io/base/format_number.h"
#include "orchestrator/figures/drawing.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/report/verification_report.h"

namespace turncal {
namespace {

void line(const std::string& key, double value, std::string& text) {
  text += key + " = " + format_number(value) + "\n";
}
void line(const std::string& key, const std::string& value, std::string& text) { text += key + " = " + value + "\n"; }

void describe_branch(const std::string& prefix, const NavigatedBranch& branch, std::string& text) {
  const FreeNavigation& n = branch.navigation;
  const AttitudeAngles angles = angles_of(n.aligned.q_nb);
  const TrackPoint& end = n.track.back();
  line(prefix + "start_s", branch.start_s, text);
  line(prefix + "align_rest_s", n.align_rest_s, text);
  line(prefix + "heading_deg", angles.heading_rad / rad_per_deg, text);
  line(prefix + "pitch_deg", angles.pitch_rad / rad_per_deg, text);
  line(prefix + "roll_deg", angles.roll_rad / rad_per_deg, text);
  line(prefix + "sigma.heading_deg", n.heading_sigma_rad / rad_per_deg, text);
  line(prefix + "free_s", n.free_s, text);
  line(prefix + "north_m", end.moved_m[0], text);
  line(prefix + "east_m", end.moved_m[1], text);
  line(prefix + "velocity_north_mps", end.velocity_error_mps[0], text);
  line(prefix + "velocity_east_mps", end.velocity_error_mps[1], text);
  line(prefix + "velocity_rms_mps", n.velocity_rms_mps, text);
  line(prefix + "nm_per_h", n.nm_per_h, text);
}

void describe_drift(const std::string& prefix, const DriftOverRuns& drift, std::string& text) {
  line(prefix + "rms_nm_per_h", drift.rms_nm_per_h, text);
  line(prefix + "cep_nm_per_h", drift.cep_nm_per_h, text);
  line(prefix + "r95_nm_per_h", drift.r95_nm_per_h, text);
}

Series series_of(const std::string& label, Colour colour, const FreeNavigation& navigation,
                 double (*value)(const TrackPoint&)) {
  constexpr std::size_t most_points = 900;
  Series series;
  series.label = label;
  series.colour = colour;
  series.points.reserve(navigation.track.size());
  for (const TrackPoint& point : navigation.track) series.points.emplace_back(point.time_s / 60.0, value(point));
  series.points = outline(series.points, most_points);
  return series;
}

double north_mps(const TrackPoint& p) { return p.velocity_error_mps[0]; }
double east_mps(const TrackPoint& p) { return p.velocity_error_mps[1]; }
double radial_nm(const TrackPoint& p) { return p.moved_m.norm() / metres_per_nautical_mile; }

// With three decimals: no 360.000.
double printed_heading_deg(double heading_deg) { return heading_deg < 359.9995 ? heading_deg : 0.0; }

Panel panel(const std::string& title, const std::string& y_label) {
  Panel panel;
  panel.title = title;
  panel.y_label = y_label;
  return panel;
}

}  // namespace

std::string format_navigation(const NavigationReport& report) {
  std::string text = report.info.simulated ? "# Simulated data: a dry run, or a twin.\n" : "";
  line("format", 1.0, text);
  line("recording_hash", report.recording_hash, text);
  line("unit_serial", report.info.unit_serial, text);
  line("simulated", std::string(report.info.simulated ? "true" : "false"), text);
  line("latitude_deg", report.info.latitude_deg, text);
  line("gravity_mps2", report.info.gravity_mps2, text);
  if (!report.reference.empty()) {
    line("reference", report.reference, text);
    line("reference.longest_in_motion_s", report.reference_gap_s, text);
  }
  line("align_s", report.align_s, text);
  if (!report.damage.empty()) line("damage", report.damage, text);
  line("filled_samples", static_cast<double>(report.filled_samples), text);
  line("filled_in_motion", static_cast<double>(report.filled_in_motion), text);
  for (std::size_t k = 0; k < report.faults.size(); ++k) line("fault." + std::to_string(k + 1), report.faults[k], text);
  for (std::size_t k = 0; k < report.lost.size(); ++k) line("lost." + std::to_string(k + 1), report.lost[k], text);
  for (const NavigatedFile& file : report.files) {
    line(file.prefix + "parameters", file.path, text);
    line(file.prefix + "model", file.model, text);
    line(file.prefix + "trusted", std::string(file.trusted ? "true" : "false"), text);
    line(file.prefix + "felt_latitude_deg", file.felt.latitude_rad / rad_per_deg, text);
    line(file.prefix + "felt_latitude_sigma_deg", file.felt.sigma_rad / rad_per_deg, text);
    line(file.prefix + "felt_gravity_mps2", file.felt.gravity_mps2, text);
    line(file.prefix + "noise", std::string(file.noise_assumed ? "assumed" : "file"), text);
    describe_drift(file.prefix + "drift.", file.drift, text);
    line(file.prefix + "velocity_rms_mps", file.velocity_rms_mps, text);
    if (file.expected) {
      line(file.prefix + "expected.from", file.covariance_source, text);
      describe_drift(file.prefix + "expected.", *file.expected, text);
    }
    line(file.prefix + "branches", static_cast<double>(file.branches.size()), text);
    for (std::size_t k = 0; k < file.branches.size(); ++k)
      describe_branch(file.prefix + "branch." + std::to_string(k + 1) + ".", file.branches[k], text);
  }
  return text;
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
           {branch.start_s + report.align_s + point.time_s, point.state.latitude_rad / rad_per_deg,
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

Result<std::string> draw_navigation(const NavigationReport& report, const GnuplotOptions& options) {
  const bool moves = !report.reference.empty();
  Panel north = panel(moves ? "Velocity error north" : "Velocity north", "m/s");
  Panel east = panel(moves ? "Velocity error east" : "Velocity east", "m/s");
  Panel distance = panel(moves ? "Distance from the reference" : "Distance from where it stands", "nautical miles");
  north.legend = report.files.size() > 1;
  distance.x_label = "minutes of free navigation (a Schuler period is 84.4)";
  for (auto file = report.files.rbegin(); file != report.files.rend(); ++file) {
    const bool against = !file->prefix.empty();
    const Colour colour = against ? Colour::before : Colour::after;
    for (std::size_t k = file->branches.size(); k-- > 0;) {
      const FreeNavigation& navigation = file->branches[k].navigation;
      const std::string label = k > 0 ? "" : against ? "against" : "parameters";
      // The first branch stands out; the others show how far they scatter.
      const auto add = [&](Panel& at, double (*value)(const TrackPoint&)) {
        at.series.push_back(series_of(label, colour, navigation, value));
        if (k > 0) at.series.back().style = Series::Style::dashed;
      };
      add(north, north_mps);
      add(east, east_mps);
      add(distance, radial_nm);
    }
  }
  Figure figure;
  figure.id = "navigation";
  figure.label = "Velocity and position error of free inertial navigation against time";
  figure.panel_width = 480;  // so that a telephone shows it in letters that can be read
  figure.panel_height = 220;
  figure.panels = {north, east, distance};
  std::vector<std::string> drawn = TRY(run_gnuplot(draw(figure).script, 1, options));
  return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n" + drawn.front() + "\n";
}

// A turn with a tenth of g is off the straight line between two rows by 3 m.
constexpr double seldom_s = 5.0;

void print_navigation(const NavigationReport& report, std::ostream& out) {
  char text[240];
  if (report.without_segments && report.reference.empty()) out << "no segments: everything counts as rest\n";
  if (report.reference_gap_s > seldom_s) {
    std::snprintf(text, sizeof text,
                  "the reference moves over %.1f s without a row: straight on is assumed, and counts as error\n",
                  report.reference_gap_s);
    out << text;
  }
  if (!report.damage.empty()) out << report.damage << '\n';
  if (report.filled_samples > 0)
    out << report.filled_samples << " samples lost or bad; " << report.filled_in_motion << " of them in a turn\n";
  print_faults(report.faults, out);
  for (const std::string& branch : report.lost) out << branch << '\n';
  for (const NavigatedFile& file : report.files) {
    out << (file.prefix.empty() ? "parameters  " : "against     ") << file.path << "\n";
    out << "  branch  aligned from s   heading deg       free s     north m      east m   nm/h\n";
    for (std::size_t k = 0; k < file.branches.size(); ++k) {
      const NavigatedBranch& branch = file.branches[k];
      const FreeNavigation& n = branch.navigation;
      const Eigen::Vector2d end = n.track.back().moved_m;
      std::snprintf(text, sizeof text, "  %6zu  %14.1f  %8.3f +- %.3f  %7.0f  %10.0f  %10.0f  %6.3f\n", k + 1,
                    branch.start_s, printed_heading_deg(angles_of(n.aligned.q_nb).heading_rad / rad_per_deg),
                    n.heading_sigma_rad / rad_per_deg, n.free_s, end[0], end[1], n.nm_per_h);
      out << text;
    }
    if (file.branches.size() + report.lost.size() < static_cast<std::size_t>(report.branches_asked) &&
        report.branches_asked != default_branches)
      out << "  starts    " << file.branches.size() << " of the " << report.branches_asked
          << " asked for: the recording has no more of that length\n";
    std::snprintf(text, sizeof text, "  drift     rms %.3f, CEP %.3f, R95 %.3f nm/h; velocity rms %.3f m/s\n",
                  file.drift.rms_nm_per_h, file.drift.cep_nm_per_h, file.drift.r95_nm_per_h, file.velocity_rms_mps);
    out << text;
    if (file.expected) {
      std::snprintf(text, sizeof text,
                    "  expected  rms %.3f, CEP %.3f, R95 %.3f nm/h at the end of the first branch, from noise%s\n",
                    file.expected->rms_nm_per_h, file.expected->cep_nm_per_h, file.expected->r95_nm_per_h,
                    file.covariance_source == "none"      ? " alone"
                    : file.covariance_source == "effects" ? " alone (the file has effects)"
                                                          : " and parameters");
      out << text;
      if (file.noise_assumed) out << "            noise " << assumed_noise_words << "\n";
    }
    if (file.felt.weighs_against(report.info.gravity_mps2))
      out << "  GRAVITY   " << gravity_words(file.felt, report.info.gravity_mps2)
          << ": one of the two, or the calibration, is wrong\n";
    if (file.felt.speaks_against(report.info.latitude_deg * rad_per_deg))
      out << "  LATITUDE  " << latitude_words(file.felt, report.info.latitude_deg)
          << ": one of the two, or the calibration, is wrong\n";
    if (!file.trusted) out << "  " << not_trusted_words << "\n";
  }
}

}  // namespace turncal
