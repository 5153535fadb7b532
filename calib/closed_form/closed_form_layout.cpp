#include "calib/closed_form/closed_form_layout.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "calib/closed_form/leg_navigation.h"
#include "calib/model/attitude.h"

namespace turncal {
namespace {

constexpr double angle_tolerance_deg = 1e-3;  // of commanded angles
constexpr const char* axis_letters = "xyz";

std::string fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

AxisTriple angles_of(const Segment& segment) { return {{segment.heading_deg, segment.pitch_deg, segment.roll_deg}}; }

std::string describe(const AxisTriple& angles) {
  std::string text;
  for (const Axis axis : all_axes) {
    char part[64];
    std::snprintf(part, sizeof part, "%s%s %g", text.empty() ? "" : ", ", to_string(axis), angles[axis]);
    text += part;
  }
  return text;
}

bool same_angle(double one_deg, double other_deg) { return std::abs(one_deg - other_deg) < angle_tolerance_deg; }

bool same_up_to_whole_turns(const AxisTriple& one, const AxisTriple& other) {
  return std::all_of(all_axes.begin(), all_axes.end(), [&](Axis axis) {
    return std::abs(std::remainder(one[axis] - other[axis], 360.0)) < angle_tolerance_deg;
  });
}

Eigen::Matrix3d commanded_attitude(const AxisTriple& angles) {
  return attitude_from_angles(angles[Axis::heading] * rad_per_deg, angles[Axis::pitch] * rad_per_deg,
                              angles[Axis::roll] * rad_per_deg);
}

// C_nb = Ry(-H) Rz(P) Rx(R): a table axis as the body has it, constant while the table turns about it alone.
Eigen::Vector3d table_axis_in_body(Axis axis, const AxisTriple& angles) {
  if (axis == Axis::roll) return Eigen::Vector3d::UnitX();
  if (axis == Axis::heading) return -(commanded_attitude(angles).transpose() * Eigen::Vector3d::UnitY());
  const Eigen::Matrix3d roll = attitude_from_angles(0.0, 0.0, angles[Axis::roll] * rad_per_deg);
  return roll.transpose() * Eigen::Vector3d::UnitZ();
}

}  // namespace

ClosedFormLayout::ClosedFormLayout(const CompressedRecording& recording, double min_dwell_s, double max_misfit_deg)
    : recording_(recording),
      min_dwell_s_(min_dwell_s),
      max_misfit_deg_(max_misfit_deg),
      first_block_(first_blocks(recording)) {}

Status ClosedFormLayout::find() {
  if (Status status = check_site(); !status.ok()) return status;
  const Segments& segments = recording_.segments;
  for (int step = 1; step <= closed_form_steps; ++step)
    if (std::none_of(segments.begin(), segments.end(), [&](const Segment& s) { return s.step == step; }))
      return input_error("step " + std::to_string(step) + " is missing: the closed form needs steps 1 to " +
                         std::to_string(closed_form_steps));
  for (const VerticalSpec& spec : closed_form_verticals) {
    const std::optional<std::size_t> found = find_static(spec);
    if (!found)
      return input_error("step " + std::to_string(spec.step) + " never sees the " + axis_letters[spec.body_axis] +
                         " axis vertical (" + (spec.up ? "up" : "down") + "): expected a dwell at " +
                         describe(spec.at_deg));
    verticals_.push_back(*found);
  }
  legs_.resize(closed_form_steps + 1);
  for (int step = 2; step <= closed_form_steps; ++step) {
    for (const LegSpec& spec : closed_form_legs(step)) {
      const std::optional<Leg> leg = find_leg(step, spec);
      if (!leg)
        return input_error("step " + std::to_string(step) + ": expected a dwell after a turn by " +
                           describe(spec.turn_deg) + " that starts at rest at " + describe(spec.from_deg));
      legs_[static_cast<std::size_t>(step)].push_back(*leg);
    }
  }
  return {};
}

Status ClosedFormLayout::check_data(const SensorModel& model) const {
  for (const std::size_t segment : verticals_)
    if (Status status = check_static(segment, model); !status.ok()) return status;
  for (const std::vector<Leg>& legs : legs_) {
    for (const Leg& leg : legs) {
      if (Status status = check_static(leg.from, model); !status.ok()) return status;
      if (Status status = check_static(leg.to, model); !status.ok()) return status;
      if (Status status = check_way(leg, model); !status.ok()) return status;
    }
  }
  return {};
}

StepMeasurement ClosedFormLayout::measure(int step, const SensorModel& model) const {
  StepMeasurement measured;
  measured.step = step;
  measured.gravity_mps2 = recording_.info.gravity_mps2;
  measured.earth_north_radps = earth_rate_n(recording_.info.latitude_deg).x();
  if (step == 1) {
    for (std::size_t i = 0; i < closed_form_verticals.size(); ++i) {
      const VerticalSpec& spec = closed_form_verticals[i];
      (spec.up ? measured.up : measured.down)[static_cast<std::size_t>(spec.body_axis)] =
          mean_specific_force(recording_, first_block_, verticals_[i], model);
    }
    return measured;
  }
  const std::vector<Leg>& legs = legs_[static_cast<std::size_t>(step)];
  measured.leg1 = navigate(legs.front(), model);
  if (legs.size() > 1) measured.leg2 = navigate(legs.back(), model);
  return measured;
}

LegMotion ClosedFormLayout::navigate(const Leg& leg, const SensorModel& model) const {
  return navigate_leg(recording_, first_block_, leg.from, leg.to, model, leg.axis_b);
}

Status ClosedFormLayout::check_site() const {
  const RecordingInfo& info = recording_.info;
  if (!(info.gravity_mps2 > 0.0))
    return input_error("gravity_mps2 = " + fixed(info.gravity_mps2, 4) + ": expected more than 0");
  if (!(std::abs(info.latitude_deg) <= 90.0))
    return input_error("latitude_deg = " + fixed(info.latitude_deg, 4) + ": expected -90 to 90");
  if (!(info.sample_period_s > 0.0))
    return input_error("sample_period_s = " + fixed(info.sample_period_s, 6) + ": expected more than 0");
  if (recording_.blocks.empty()) return input_error("the recording has no samples in its segments");
  return {};
}

std::optional<std::size_t> ClosedFormLayout::find_static(const VerticalSpec& spec) const {
  for (std::size_t k = 0; k < recording_.segments.size(); ++k) {
    const Segment& segment = recording_.segments[k];
    if (segment.step == spec.step && segment.kind == SegmentKind::still &&
        same_up_to_whole_turns(angles_of(segment), spec.at_deg))
      return k;
  }
  return std::nullopt;
}

std::optional<ClosedFormLayout::Leg> ClosedFormLayout::find_leg(int step, const LegSpec& spec) const {
  std::optional<std::size_t> from;
  for (std::size_t k = 0; k < recording_.segments.size(); ++k) {
    const Segment& segment = recording_.segments[k];
    if (segment.step != step || segment.kind == SegmentKind::rotate) continue;
    if (from && segment.kind == SegmentKind::still) {
      const AxisTriple before = angles_of(recording_.segments[*from]);
      const AxisTriple after = angles_of(segment);
      const bool turned_so = std::all_of(all_axes.begin(), all_axes.end(), [&](Axis axis) {
        return same_angle(after[axis] - before[axis], spec.turn_deg[axis]);
      });
      if (turned_so && same_up_to_whole_turns(before, spec.from_deg)) {
        Leg leg{*from, k, 0.0, Eigen::Vector3d::Zero()};
        for (const Axis axis : all_axes) {
          if (spec.turn_deg[axis] == 0.0) continue;
          leg.turn_deg = spec.turn_deg[axis];
          leg.axis_b = table_axis_in_body(axis, before);
        }
        return leg;
      }
    }
    from = k;
  }
  return std::nullopt;
}

std::string ClosedFormLayout::place(std::size_t k) const {
  const Segment& s = recording_.segments[k];
  return "step " + std::to_string(s.step) + ", static segment of samples " + std::to_string(s.start_sample) + " to " +
         std::to_string(s.end_sample) + " (" + describe(angles_of(s)) + "): ";
}

Status ClosedFormLayout::check_static(std::size_t k, const SensorModel& model) const {
  double length_s = 0.0;
  Eigen::Vector3d turned = Eigen::Vector3d::Zero();
  for (std::size_t i = first_block_[k]; i < first_block_[k + 1]; ++i) {
    const Block& block = recording_.blocks[i];
    length_s += block.samples * recording_.info.sample_period_s;
    turned += model.gyro_scale * block.gyro - model.gyro_bias_radps * block.duration_s;
  }
  if (!(length_s >= min_dwell_s_))
    return input_error(place(k) + "a dwell of " + fixed(length_s, 3) + " s is too short, expected at least " +
                       fixed(min_dwell_s_, 0) + " s");
  const Eigen::Matrix3d C_nb = commanded_attitude(angles_of(recording_.segments[k]));
  turned -= C_nb.transpose() * earth_rate_n(recording_.info.latitude_deg) * length_s;
  const double turned_deg = turned.norm() / rad_per_deg;
  if (!(turned_deg < max_misfit_deg_))
    return input_error(place(k) + "the unit turned by " + fixed(turned_deg, 1) + " deg, expected rest");
  const Eigen::Vector3d f_n = C_nb * mean_specific_force(recording_, first_block_, k, model);
  const double tilt_deg = std::atan2(std::hypot(f_n.x(), f_n.z()), f_n.y()) / rad_per_deg;
  if (!(f_n.norm() > 0.5 * recording_.info.gravity_mps2) || !(tilt_deg < max_misfit_deg_))
    return input_error(place(k) + "the accelerometers feel " + fixed(f_n.norm(), 3) + " m/s^2, " + fixed(tilt_deg, 1) +
                       " deg from the vertical of these angles; the segments do not fit the data");
  return {};
}

Status ClosedFormLayout::check_way(const Leg& leg, const SensorModel& model) const {
  const std::size_t first = first_block_[leg.from + 1];
  const Segment& to = recording_.segments[leg.to];
  for (std::size_t i = first; i < first_block_[leg.to + 1]; ++i) {
    const Block& block = recording_.blocks[i];
    if (lost_in_motion(recording_, i, model))
      return input_error("step " + std::to_string(to.step) + ": " + std::to_string(block.missing) +
                         " samples are missing near sample " + std::to_string(block.start_sample) +
                         ", in a rotation: the angle turned is lost");
  }
  const LegMotion motion = navigate(leg, model);
  const double turned_deg = motion.turned_rad / rad_per_deg;
  if (!(std::abs(turned_deg - leg.turn_deg) < max_misfit_deg_))
    return input_error(place(leg.to) + "the gyros felt a turn of " + fixed(turned_deg, 1) + " deg on the way, " +
                       fixed(leg.turn_deg, 0) + " were commanded; the segments do not fit the data");
  const Eigen::AngleAxisd apart(commanded_attitude(angles_of(to)).transpose() * motion.C_nb_arrived);
  if (!(apart.angle() / rad_per_deg < max_misfit_deg_))
    return input_error(place(leg.to) + "the navigated attitude is " + fixed(apart.angle() / rad_per_deg, 1) +
                       " deg from these angles; the segments do not fit the data");
  return {};
}

}  // namespace turncal
