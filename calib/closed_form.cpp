#include "calib/closed_form.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "calib/attitude.h"
#include "calib/leg_navigation.h"

namespace turncal {
namespace {

constexpr double angle_tolerance_deg = 1e-3;  // of commanded angles
constexpr const char* axis_letters = "xyz";

std::string fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

AxisTriple angles_of(const Segment& segment) {
  return {{segment.heading_deg, segment.pitch_deg, segment.roll_deg}};
}

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

// Where a leg lies in the segment list, and how the table turns on the way.
struct Leg {
  std::size_t from = 0;
  std::size_t to = 0;
  double turn_deg = 0.0;                                // about the one axis that turns
  Eigen::Vector3d axis_b = Eigen::Vector3d::Zero();  // that axis in the body
};

struct PlannedStep {
  int step = 0;
  std::vector<Leg> legs;
};

// Finds what the fourteen steps need in the segment list and holds the data against it once, before the first pass.
class Layout {
 public:
  Layout(const CompressedRecording& recording, const ClosedFormOptions& options)
      : recording_(recording), options_(options), first_block_(first_blocks(recording)) {}

  // Status of the search; an error leaves the layout unusable.
  Status find() {
    if (Status status = check_site(); !status.ok()) return status;
    for (int step = 1; step <= closed_form_steps; ++step)
      if (std::none_of(segments().begin(), segments().end(), [&](const Segment& s) { return s.step == step; }))
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
    for (int step = 2; step <= closed_form_steps; ++step) {
      PlannedStep planned{step, {}};
      for (const LegSpec& spec : closed_form_legs(step)) {
        const std::optional<Leg> leg = find_leg(step, spec);
        if (!leg)
          return input_error("step " + std::to_string(step) + ": no dwell after a turn by " + describe(spec.turn_deg) +
                             " that starts at rest at " + describe(spec.from_deg));
        planned.legs.push_back(*leg);
      }
      steps_.push_back(planned);
    }
    return {};
  }

  Status check_data(const SensorModel& model) const {
    for (const std::size_t segment : verticals_)
      if (Status status = check_static(segment, model); !status.ok()) return status;
    for (const PlannedStep& step : steps_) {
      for (const Leg& leg : step.legs) {
        for (const std::size_t segment : {leg.from, leg.to})
          if (Status status = check_static(segment, model); !status.ok()) return status;
        if (Status status = check_way(leg, model); !status.ok()) return status;
      }
    }
    return {};
  }

  StepMeasurement measure_verticals(const SensorModel& model) const {
    StepMeasurement measured = empty_measurement(1);
    for (std::size_t i = 0; i < closed_form_verticals.size(); ++i) {
      const VerticalSpec& spec = closed_form_verticals[i];
      (spec.up ? measured.up : measured.down)[static_cast<std::size_t>(spec.body_axis)] =
          mean_specific_force(recording_, first_block_, verticals_[i], model);
    }
    return measured;
  }

  StepMeasurement measure_legs(const PlannedStep& step, const SensorModel& model) const {
    StepMeasurement measured = empty_measurement(step.step);
    measured.leg1 = navigate(step.legs.front(), model);
    if (step.legs.size() > 1) measured.leg2 = navigate(step.legs.back(), model);
    return measured;
  }

  const std::vector<PlannedStep>& steps() const { return steps_; }

 private:
  const Segments& segments() const { return recording_.segments; }

  StepMeasurement empty_measurement(int step) const {
    StepMeasurement measured;
    measured.step = step;
    measured.gravity_mps2 = recording_.info.gravity_mps2;
    measured.earth_north_radps = earth_rate_n(recording_.info.latitude_deg).x();
    return measured;
  }

  Status check_site() const {
    const RecordingInfo& info = recording_.info;
    if (!(info.gravity_mps2 > 9.5 && info.gravity_mps2 < 10.0))
      return input_error("gravity_mps2 = " + fixed(info.gravity_mps2, 4) + ": expected 9.5 to 10");
    if (!(std::abs(info.latitude_deg) <= 90.0))
      return input_error("latitude_deg = " + fixed(info.latitude_deg, 4) + ": expected -90 to 90");
    if (!(info.sample_period_s > 0.0)) return input_error("sample_period_s: expected more than 0");
    if (recording_.blocks.empty() || segments().empty()) return input_error("the recording has no samples in segments");
    return {};
  }

  std::optional<std::size_t> find_static(const VerticalSpec& spec) const {
    for (std::size_t k = 0; k < segments().size(); ++k)
      if (segments()[k].step == spec.step && segments()[k].kind == SegmentKind::still &&
          same_up_to_whole_turns(angles_of(segments()[k]), spec.at_deg))
        return k;
    return std::nullopt;
  }

  std::optional<Leg> find_leg(int step, const LegSpec& spec) const {
    std::optional<std::size_t> from;
    for (std::size_t k = 0; k < segments().size(); ++k) {
      const Segment& segment = segments()[k];
      if (segment.step != step || segment.kind == SegmentKind::rotate) continue;
      if (from && segment.kind == SegmentKind::still) {
        const AxisTriple before = angles_of(segments()[*from]);
        const AxisTriple after = angles_of(segment);
        const bool turned_so = std::all_of(all_axes.begin(), all_axes.end(), [&](Axis axis) {
          return same_angle(after[axis] - before[axis], spec.turn_deg[axis]);
        });
        if (turned_so && same_up_to_whole_turns(before, spec.from_deg)) return make_leg(*from, k, before, spec);
      }
      from = k;
    }
    return std::nullopt;
  }

  static Leg make_leg(std::size_t from, std::size_t to, const AxisTriple& start, const LegSpec& spec) {
    Leg leg{from, to, 0.0, Eigen::Vector3d::Zero()};
    for (const Axis axis : all_axes) {
      if (spec.turn_deg[axis] == 0.0) continue;
      leg.turn_deg = spec.turn_deg[axis];
      // C_nb = Ry(-H) Rz(P) Rx(R): the axis as the body has it
      const Eigen::Matrix3d roll = attitude_from_angles(0.0, 0.0, start[Axis::roll] * rad_per_deg);
      if (axis == Axis::roll) leg.axis_b = Eigen::Vector3d::UnitX();
      if (axis == Axis::pitch) leg.axis_b = roll.transpose() * Eigen::Vector3d::UnitZ();
      if (axis == Axis::heading) leg.axis_b = -(commanded_attitude(start).transpose() * Eigen::Vector3d::UnitY());
    }
    return leg;
  }

  LegMotion navigate(const Leg& leg, const SensorModel& model) const {
    return navigate_leg(recording_, first_block_, leg.from, leg.to, model, leg.axis_b);
  }

  std::string place(std::size_t k) const {
    const Segment& s = segments()[k];
    return "step " + std::to_string(s.step) + ", static segment of samples " + std::to_string(s.start_sample) + " to " +
           std::to_string(s.end_sample) + " (" + describe(angles_of(s)) + "): ";
  }

  // Long enough, at rest, and the right way up.
  Status check_static(std::size_t k, const SensorModel& model) const {
    double length_s = 0.0;
    Eigen::Vector3d turned = Eigen::Vector3d::Zero();
    for (std::size_t i = first_block_[k]; i < first_block_[k + 1]; ++i) {
      const Block& block = recording_.blocks[i];
      length_s += block.samples * recording_.info.sample_period_s;
      turned += model.gyro_scale * block.gyro - model.gyro_bias_radps * block.duration_s;
    }
    if (!(length_s >= options_.min_dwell_s))
      return input_error(place(k) + "a dwell of " + fixed(length_s, 3) + " s is too short, expected at least " +
                         fixed(options_.min_dwell_s, 0) + " s");
    const Eigen::Matrix3d C_nb = commanded_attitude(angles_of(segments()[k]));
    turned -= C_nb.transpose() * earth_rate_n(recording_.info.latitude_deg) * length_s;
    const double turned_deg = turned.norm() / rad_per_deg;
    if (!(turned_deg < options_.max_misfit_deg))
      return input_error(place(k) + "the unit turned by " + fixed(turned_deg, 1) + " deg, it was not at rest");
    const Eigen::Vector3d f_n = C_nb * mean_specific_force(recording_, first_block_, k, model);
    const double tilt_deg = std::atan2(std::hypot(f_n.x(), f_n.z()), f_n.y()) / rad_per_deg;
    if (!(f_n.norm() > 0.5 * recording_.info.gravity_mps2) || !(tilt_deg < options_.max_misfit_deg))
      return input_error(place(k) + "the accelerometers feel " + fixed(f_n.norm(), 3) + " m/s^2, " + fixed(tilt_deg, 1) +
                         " deg from the vertical of these angles; the segments do not fit the data");
    return {};
  }

  // No sample lost on the way, turned as commanded.
  Status check_way(const Leg& leg, const SensorModel& model) const {
    const std::size_t first = first_block_[leg.from + 1];
    const std::size_t dwell = first_block_[leg.to];
    for (std::size_t i = first; i < dwell + 1; ++i) {
      const Block& block = recording_.blocks[i];
      const bool reaches_back = block.start_sample < segments()[leg.to].start_sample;  // the gap, across the border
      if (block.missing > 0 && reaches_back && dwell > first)
        return input_error("step " + std::to_string(segments()[leg.to].step) + ": " + std::to_string(block.missing) +
                           " samples are missing near sample " + std::to_string(block.start_sample) +
                           ", in a rotation: the angle turned is lost");
    }
    const LegMotion motion = navigate(leg, model);
    const double turned_deg = motion.turned_rad / rad_per_deg;
    if (!(std::abs(turned_deg - leg.turn_deg) < options_.max_misfit_deg))
      return input_error(place(leg.to) + "the gyros felt a turn of " + fixed(turned_deg, 1) + " deg on the way, " +
                         fixed(leg.turn_deg, 0) + " were commanded; the segments do not fit the data");
    const Eigen::AngleAxisd apart(commanded_attitude(angles_of(segments()[leg.to])).transpose() * motion.C_nb_arrived);
    if (!(apart.angle() / rad_per_deg < options_.max_misfit_deg))
      return input_error(place(leg.to) + "the navigated attitude is " + fixed(apart.angle() / rad_per_deg, 1) +
                         " deg from these angles; the segments do not fit the data");
    return {};
  }

  const CompressedRecording& recording_;
  const ClosedFormOptions& options_;
  const std::vector<std::size_t> first_block_;
  std::vector<std::size_t> verticals_;  // segments, in the order of closed_form_verticals
  std::vector<PlannedStep> steps_;      // 2 to 14
};

bool within(const ParameterDistance& moved, const ParameterDistance& limit) {
  return moved.gyro_bias_degph <= limit.gyro_bias_degph && moved.accel_bias_g <= limit.accel_bias_g &&
         moved.gyro_matrix <= limit.gyro_matrix && moved.accel_matrix <= limit.accel_matrix;
}

std::string describe(const ParameterDistance& moved) {
  char text[160];
  std::snprintf(text, sizeof text, "N0 %.2g deg/h, A0 %.2g g, n %.2g, a %.2g", moved.gyro_bias_degph, moved.accel_bias_g,
                moved.gyro_matrix, moved.accel_matrix);
  return text;
}

}  // namespace

ParameterDistance distance(const Parameters& one, const Parameters& other, const RecordingInfo& info) {
  const double nominal = info.gyro_increment == IncrementKind::pulses ? Parameters{}.n(0, 0) : 1.0;
  return {(one.N0_degph - other.N0_degph).cwiseAbs().maxCoeff(), (one.A0_g - other.A0_g).cwiseAbs().maxCoeff(),
          (one.n - other.n).cwiseAbs().maxCoeff() / nominal, (one.a - other.a).cwiseAbs().maxCoeff()};
}

Result<ClosedFormResult> closed_form_calibrate_with(const CompressedRecording& recording, const Parameters& start,
                                                    const ClosedFormOptions& options, const StepCorrection& correct) {
  Layout layout(recording, options);
  if (Status status = layout.find(); !status.ok()) return status.error();
  if (Status status = layout.check_data(sensor_model(start, recording.info)); !status.ok()) return status.error();

  ClosedFormResult result;
  result.parameters = start;
  Parameters& parameters = result.parameters;
  while (result.passes < options.max_passes && !result.converged) {
    const Parameters before = parameters;
    correct(layout.measure_verticals(sensor_model(parameters, recording.info)), parameters);
    for (const PlannedStep& step : layout.steps())
      correct(layout.measure_legs(step, sensor_model(parameters, recording.info)), parameters);
    ++result.passes;
    if (!to_vector(parameters).allFinite()) {
      result.message = "diverged in pass " + std::to_string(result.passes);
      return result;
    }
    result.corrections.push_back(distance(parameters, before, recording.info));
    result.converged = within(result.corrections.back(), options.tolerance);
  }
  const std::string passes = std::to_string(result.passes) + (result.passes == 1 ? " pass" : " passes");
  result.message = (result.converged ? "converged in " : "not converged in ") + passes;
  if (!result.corrections.empty()) result.message += ", the last one moved " + describe(result.corrections.back());
  return result;
}

Result<ClosedFormResult> closed_form_calibrate(const CompressedRecording& recording, const Parameters& start,
                                               const ClosedFormOptions& options) {
  return closed_form_calibrate_with(recording, start, options, correct_parameters);
}

}  // namespace turncal
