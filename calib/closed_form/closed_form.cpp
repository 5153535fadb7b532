#include "calib/closed_form/closed_form.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "calib/model/attitude.h"
#include "calib/statistics/block_motion.h"
#include "calib/types/axis.h"
#include "calib/types/value_text.h"

namespace turncal {
namespace {

using Leg = ClosedFormLayout::Leg;

// heading, pitch, roll
constexpr AxisTriple at(double h, double p, double r) { return {{h, p, r}}; }

// A leg as commanded: heading, pitch, roll at its start (up to whole turns) and the turn to its end.
struct LegSpec {
  AxisTriple from_deg, turn_deg;
};
// The legs whose velocities are V1 and V2. Step 1 has none; 13 and 14 have one, without a turn.
constexpr std::array<std::array<LegSpec, 2>, 13> legs_of_step = {{
    {{{at(0, 0, 0), at(0, 0, 360)}, {at(0, 0, 0), at(0, 0, -360)}}},          // 2
    {{{at(-90, 0, 0), at(0, 360, 0)}, {at(-90, 0, 0), at(0, -360, 0)}}},      // 3
    {{{at(-90, 0, -90), at(0, 360, 0)}, {at(-90, 0, -90), at(0, -360, 0)}}},  // 4
    {{{at(0, 0, 0), at(0, 0, 180)}, {at(0, 0, 0), at(0, 0, -180)}}},          // 5
    {{{at(-90, 0, 0), at(0, 180, 0)}, {at(-90, 0, 0), at(0, -180, 0)}}},      // 6
    {{{at(0, 0, 0), at(0, 0, 90)}, {at(0, 0, 0), at(0, 0, -90)}}},            // 7
    {{{at(-90, 0, 0), at(0, 90, 0)}, {at(-90, 0, 0), at(0, -90, 0)}}},        // 8
    {{{at(-90, 0, -90), at(0, 90, 0)}, {at(-90, 0, -90), at(0, -90, 0)}}},    // 9
    {{{at(-90, 0, 0), at(0, 0, 90)}, {at(-90, 0, 0), at(0, 0, -90)}}},        // 10
    {{{at(-90, 0, 0), at(90, 0, 0)}, {at(-90, 0, 0), at(-90, 0, 0)}}},        // 11
    {{{at(0, 0, 0), at(0, 90, 0)}, {at(0, 0, 0), at(0, -90, 0)}}},            // 12
    {{{at(0, 0, 0), at(0, 0, 0)}, {}}},                                       // 13
    {{{at(-90, 0, 0), at(0, 0, 0)}, {}}},                                     // 14
}};

// A static segment of step 1 (y down: of step 5) in which a body axis is vertical.
struct VerticalSpec {
  int step;
  int body_axis;
  bool up;
  AxisTriple at_deg;
};
constexpr std::array<VerticalSpec, 6> verticals = {{
    {1, 0, true, at(0, 90, 0)},
    {1, 0, false, at(0, -90, 0)},
    {1, 1, true, at(0, 0, 0)},
    {5, 1, false, at(0, 0, 180)},
    {1, 2, true, at(0, 0, -90)},
    {1, 2, false, at(0, 0, 90)},
}};

constexpr double min_dwell_s = 10.0, max_misfit_deg = 5.0;

// A unit at rest turns by less: Earth rate, bias and a few pulses of quantisation.
constexpr double rest_rate_radps = 0.02 * rad_per_deg;
constexpr double rest_angle_rad = 2e-5;

bool turns(const Block& block, const SensorModel& model, double period_s) {
  const double time_s = block.samples * period_s;
  return (model.gyro_scale * block.gyro - model.gyro_bias_radps * time_s).norm() >
         rest_rate_radps * time_s + rest_angle_rad;
}

// Are samples missing in block `index` while the unit turned, in that block or in the one before?
bool lost_in_motion(const CompressedRecording& recording, std::size_t index, const SensorModel& model) {
  const Block& block = recording.blocks[index];
  if (block.missing == 0) return false;
  if (turns(block, model, recording.info.sample_period_s)) return true;
  return index > 0 && turns(recording.blocks[index - 1], model, recording.info.sample_period_s);
}

// Returns a block at rest with its missing samples filled in: everything is even over the block.
Block stretched(const Block& block) {
  Block full = block;
  const double factor = double(block.samples + block.missing) / block.samples;
  full.gyro *= factor;
  full.accel *= factor;
  full.gyro_time = 0.5 * block.duration_s * full.gyro;
  full.accel_time = 0.5 * block.duration_s * full.accel;
  full.coning.setZero();
  full.sculling = 0.5 * full.gyro * full.accel.transpose();
  return full;
}

class LegNavigator {
 public:
  LegNavigator(const CompressedRecording& recording, const SensorModel& model, const Eigen::Matrix3d& start_C_nb)
      : C_nb(start_C_nb), recording_(recording), model_(model), earth_(earth_rate_n(recording.info.latitude_deg)) {}

  void advance(std::size_t index) {
    const Block& block = recording_.blocks[index];
    const double t = block.duration_s;
    const bool bridged = block.missing > 0 && !lost_in_motion(recording_, index, model_);
    const BlockMotion motion = evaluate(bridged ? stretched(block) : block, model_, recording_.info.sample_period_s);
    const Eigen::Matrix3d half_turn = rotation_exp(-0.5 * t * earth_);
    velocity += half_turn * (C_nb * motion.velocity) - Eigen::Vector3d(0.0, recording_.info.gravity_mps2 * t, 0.0);
    C_nb = half_turn * half_turn * C_nb * rotation_exp(motion.rotation);
    rotation = motion.rotation;
  }

  Eigen::Matrix3d C_nb;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // of the block last passed

 private:
  const CompressedRecording& recording_;
  const SensorModel& model_;
  const Eigen::Vector3d earth_;
};

// Blocks of segment k are [first[k], first[k + 1]).
std::vector<std::size_t> first_blocks(const CompressedRecording& recording) {
  std::vector<std::size_t> first(recording.segments.size() + 1, recording.blocks.size());
  for (std::size_t i = recording.blocks.size(); i-- > 0;) first[recording.blocks[i].segment] = i;
  // a segment without blocks begins where the next one does
  for (std::size_t k = recording.segments.size(); k-- > 0;) first[k] = std::min(first[k], first[k + 1]);
  return first;
}

// Mean calibrated specific force over a static segment, body frame. REQUIRES a block in it.
Eigen::Vector3d mean_specific_force(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                                    std::size_t segment, const SensorModel& model) {
  Eigen::Vector3d counts = Eigen::Vector3d::Zero();
  double time_s = 0.0;
  for (std::size_t i = first_block[segment]; i < first_block[segment + 1]; ++i) {
    counts += recording.blocks[i].accel;
    time_s += recording.blocks[i].samples * recording.info.sample_period_s;
  }
  return model.accel_scale * counts / time_s - model.accel_bias_mps2;
}

std::string describe(const AxisTriple& angles) {
  return fmt::format("heading {:g}, pitch {:g}, roll {:g}", angles.value[0], angles.value[1], angles.value[2]);
}

std::string place(const Segment& s) {
  return fmt::format("step {}, static segment of samples {} to {} ({}): ", s.step, s.start_sample, s.end_sample,
                     describe(angles_of(s)));
}

constexpr double angle_tolerance_deg = 1e-3;  // of commanded angles

bool same_angle(double one_deg, double other_deg) { return std::abs(one_deg - other_deg) < angle_tolerance_deg; }

bool same_up_to_whole_turns(const AxisTriple& one, const AxisTriple& other) {
  return std::ranges::all_of(all_axes, [&](Axis axis) {
    return std::abs(std::remainder(one[axis] - other[axis], 360.0)) < angle_tolerance_deg;
  });
}

LegMotion navigate_leg(const CompressedRecording& recording, const std::vector<std::size_t>& first_block,
                       const Leg& leg, const SensorModel& model) {
  const Eigen::Matrix3d commanded = attitude_at(angles_of(recording.segments[leg.from]));
  LegMotion motion;
  motion.C_nb_start = level(commanded, mean_specific_force(recording, first_block, leg.from, model));
  LegNavigator navigator(recording, model, motion.C_nb_start);
  for (std::size_t i = first_block[leg.from + 1]; i < first_block[leg.to]; ++i) {
    navigator.advance(i);
    motion.before_dwell_s += recording.blocks[i].duration_s;
    motion.turned_rad += leg.axis_b.dot(navigator.rotation);
  }
  motion.C_nb_arrived = navigator.C_nb;
  navigator.velocity.setZero();
  for (std::size_t i = first_block[leg.to]; i < first_block[leg.to + 1]; ++i) {
    navigator.advance(i);
    motion.dwell_s += recording.blocks[i].duration_s;
  }
  motion.velocity_mps = navigator.velocity;
  const Eigen::Matrix3d turn = navigator.C_nb * motion.C_nb_start.transpose();
  motion.heading_change_rad = -0.5 * (turn(0, 2) - turn(2, 0));  // up is the second axis of n
  return motion;
}

Status check_site(const CompressedRecording& recording) {
  const RecordingInfo& info = recording.info;
  if (!(info.gravity_mps2 > 0.0)) return input_error("gravity_mps2 = {:.4f}: expected more than 0", info.gravity_mps2);
  if (!(std::abs(info.latitude_deg) <= 90.0))
    return input_error("latitude_deg = {:.4f}: expected -90 to 90", info.latitude_deg);
  if (!(info.sample_period_s > 0.0))
    return input_error("sample_period_s = {:.6f}: expected more than 0", info.sample_period_s);
  if (recording.blocks.empty()) return input_error("the recording has no samples in its segments");
  return {};
}

Result<std::size_t> find_static(const Segments& segments, const VerticalSpec& spec) {
  for (std::size_t k = 0; k < segments.size(); ++k)
    if (segments[k].step == spec.step && segments[k].kind == SegmentKind::still &&
        same_up_to_whole_turns(angles_of(segments[k]), spec.at_deg))
      return k;
  return input_error("step {} never sees the {} axis vertical ({}): expected a dwell at {}", spec.step,
                     "xyz"[spec.body_axis], spec.up ? "up" : "down", describe(spec.at_deg));
}

Result<Leg> find_leg(const Segments& segments, int step, const LegSpec& spec) {
  std::optional<std::size_t> from;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    if (segments[k].step != step || segments[k].kind == SegmentKind::rotate) continue;
    if (from && segments[k].kind == SegmentKind::still) {
      const AxisTriple before = angles_of(segments[*from]), after = angles_of(segments[k]);
      const bool turned_so = std::ranges::all_of(
          all_axes, [&](Axis axis) { return same_angle(after[axis] - before[axis], spec.turn_deg[axis]); });
      if (turned_so && same_up_to_whole_turns(before, spec.from_deg)) {
        Leg leg{*from, k, 0.0, Eigen::Vector3d::Zero()};
        for (const Axis axis : all_axes) {
          if (spec.turn_deg[axis] == 0.0) continue;
          leg.turn_deg = spec.turn_deg[axis];
          leg.axis_b = axis_b(axis, before);
        }
        return leg;
      }
    }
    from = k;
  }
  return input_error("step {}: expected a dwell after a turn by {} that starts at rest at {}", step,
                     describe(spec.turn_deg), describe(spec.from_deg));
}

// Returns the specific force along a body axis that is vertical but for a small tilt: what the two others, which
// measure the tilt, leave of g. (With plain g a table 3 arc-minutes off level spoils a_ii by 0.4 ppm.)
double vertical_force(const Eigen::Vector3d& f, int axis, double gravity) {
  const double across2 = f.squaredNorm() - f[axis] * f[axis];
  return std::sqrt(std::max(gravity * gravity - across2, 0.25 * gravity * gravity));
}

// The calibrated reading is s f + e with s the scale error and e the bias error: solved for both, then taken out.
void correct_scale_and_bias(const StepMeasurement& m, Parameters& p) {
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d& up = m.up[i];
    const Eigen::Vector3d& down = m.down[i];
    const double force_up = vertical_force(up, i, m.gravity_mps2);
    const double force_down = vertical_force(down, i, m.gravity_mps2);
    const double scale = (up[i] - down[i]) / (force_up + force_down);
    const double bias = up[i] - scale * force_up;
    p.A0_g[i] = (p.A0_g[i] + bias / standard_gravity_mps2) / scale;
    p.a.row(i) /= scale;
  }
}

bool within(const ParameterDistance& moved, const ParameterDistance& limit) {
  return moved.gyro_bias_degph <= limit.gyro_bias_degph && moved.accel_bias_g <= limit.accel_bias_g &&
         moved.gyro_matrix <= limit.gyro_matrix && moved.accel_matrix <= limit.accel_matrix;
}

}  // namespace

void correct_parameters(const StepMeasurement& m, Parameters& p) {
  if (m.step == 1) return correct_scale_and_bias(m, p);

  const double g = m.gravity_mps2;
  const LegMotion& leg = m.leg1;
  const double T = leg.dwell_s;
  const Eigen::Vector3d slope1 = m.leg1.velocity_mps / m.leg1.dwell_s;
  if (m.step >= 13) {
    // A rate error d has turned the attitude by d t at time t since levelling, so the dwell gains g d (T^2/2 + t0 T).
    const double east = slope1.z() / (g * (0.5 * T + leg.before_dwell_s)) / radps_per_degph;
    const double north = slope1.x() / (g * (0.5 * T + leg.before_dwell_s)) / radps_per_degph;
    // phi_U' = w_N phi_E - dw_U, and the integral of phi_E is V_N / g: an error of the given heading, which tilts about
    // east, is kept out of the drift of the heading (0.0002 deg/h in 600 s at 3 arc-minutes).
    const double from_tilt_rad = m.earth_north_radps * leg.velocity_mps.x() / g;
    p.N0_degph[1] -= (leg.heading_change_rad - from_tilt_rad) / (T + leg.before_dwell_s) / radps_per_degph;
    if (m.step == 13) {
      p.N0_degph[0] += east;
      p.N0_degph[2] -= north;
    } else {
      p.N0_degph[2] += east;
    }
    return;
  }

  // East velocities only: -g phi_N. An error psi of the given heading lets earth rate leak in as psi w_N about east,
  // seen in the north velocity; about north it enters only as psi^2.
  const double slope2_east = m.leg2.velocity_mps.z() / m.leg2.dwell_s;
  const double sum = (slope1.z() + slope2_east) / (2.0 * g);         // (V1 + V2) / (2 g T)
  const double difference = (slope1.z() - slope2_east) / (2.0 * g);  // (V1 - V2) / (2 g T)
  const double g_unit = g / standard_gravity_mps2;                   // A0 is in g of 9.80665 m/s^2
  switch (m.step) {
    case 2: p.n(0, 0) *= 1.0 - difference / (2.0 * pi); break;
    case 3: p.n(2, 2) *= 1.0 - difference / (2.0 * pi); break;
    case 4: p.n(1, 1) *= 1.0 - difference / (2.0 * pi); break;
    case 5: p.A0_g[2] -= 0.5 * sum * g_unit; break;
    case 6: p.A0_g[0] += 0.5 * sum * g_unit; break;
    case 7:
      p.A0_g[1] += difference * g_unit;
      p.a(1, 2) += p.a(2, 2) * sum;
      break;
    case 8: p.a(0, 1) -= p.a(1, 1) * sum; break;
    case 9: p.a(0, 2) -= p.a(2, 2) * sum; break;
    case 10:
      p.n(1, 0) -= p.n(0, 0) * sum;
      p.n(2, 0) -= p.n(0, 0) * difference;
      break;
    case 11:
      p.n(0, 1) += p.n(1, 1) * sum;
      p.n(2, 1) += p.n(1, 1) * difference;
      break;
    case 12:
      p.n(1, 2) += p.n(2, 2) * sum;
      p.n(0, 2) -= p.n(2, 2) * difference;
      break;
    default: break;
  }
}

ClosedFormLayout::ClosedFormLayout(const CompressedRecording& recording)
    : recording_(recording), first_block_(first_blocks(recording)) {}

Status ClosedFormLayout::find() {
  TRY(check_site(recording_));
  const Segments& segments = recording_.segments;
  for (int step = 1; step <= closed_form_steps; ++step)
    if (std::ranges::none_of(segments, [&](const Segment& s) { return s.step == step; }))
      return input_error("step {} is missing: the closed form needs steps 1 to {}", step, closed_form_steps);
  for (const VerticalSpec& spec : verticals) verticals_.push_back(TRY(find_static(segments, spec)));
  legs_.resize(closed_form_steps + 1);
  for (int step = 2; step <= closed_form_steps; ++step)
    for (const LegSpec& spec : std::span(legs_of_step[step - 2]).first(step < 13 ? 2 : 1))
      legs_[step].push_back(TRY(find_leg(segments, step, spec)));
  return {};
}

Status ClosedFormLayout::check_data(const SensorModel& model) const {
  for (const std::size_t segment : verticals_) TRY(check_static(segment, model));
  for (const std::vector<Leg>& legs : legs_)
    for (const Leg& leg : legs) {
      TRY(check_static(leg.from, model));
      TRY(check_static(leg.to, model));
      TRY(check_way(leg, model));
    }
  return {};
}

StepMeasurement ClosedFormLayout::measure(int step, const SensorModel& model) const {
  StepMeasurement measured;
  measured.step = step;
  measured.gravity_mps2 = recording_.info.gravity_mps2;
  measured.earth_north_radps = earth_rate_n(recording_.info.latitude_deg).x();
  for (std::size_t i = 0; step == 1 && i < verticals.size(); ++i)
    (verticals[i].up ? measured.up : measured.down)[verticals[i].body_axis] =
        mean_specific_force(recording_, first_block_, verticals_[i], model);
  if (step == 1) return measured;
  const std::vector<Leg>& legs = legs_[step];
  measured.leg1 = navigate_leg(recording_, first_block_, legs.front(), model);
  if (legs.size() > 1) measured.leg2 = navigate_leg(recording_, first_block_, legs.back(), model);
  return measured;
}

Status ClosedFormLayout::check_static(std::size_t k, const SensorModel& model) const {
  const Segment& segment = recording_.segments[k];
  double length_s = 0.0;
  Eigen::Vector3d turned = Eigen::Vector3d::Zero();
  for (std::size_t i = first_block_[k]; i < first_block_[k + 1]; ++i) {
    const Block& block = recording_.blocks[i];
    length_s += block.samples * recording_.info.sample_period_s;
    turned += model.gyro_scale * block.gyro - model.gyro_bias_radps * block.duration_s;
  }
  if (!(length_s >= min_dwell_s))
    return input_error("{}a dwell of {:.3f} s is too short, expected at least {:.0f} s", place(segment), length_s,
                       min_dwell_s);
  const Eigen::Matrix3d C_nb = attitude_at(angles_of(segment));
  turned -= C_nb.transpose() * earth_rate_n(recording_.info.latitude_deg) * length_s;
  const double turned_deg = turned.norm() / rad_per_deg;
  if (!(turned_deg < max_misfit_deg))
    return input_error("{}the unit turned by {:.1f} deg, expected rest", place(segment), turned_deg);
  const Eigen::Vector3d f_n = C_nb * mean_specific_force(recording_, first_block_, k, model);
  const double tilt_deg = std::atan2(std::hypot(f_n.x(), f_n.z()), f_n.y()) / rad_per_deg;
  if (!(f_n.norm() > 0.5 * recording_.info.gravity_mps2) || !(tilt_deg < max_misfit_deg))
    return input_error(
        "{}the accelerometers feel {:.3f} m/s^2, {:.1f} deg from the vertical of these "
        "angles; the segments do not fit the data",
        place(segment), f_n.norm(), tilt_deg);
  return {};
}

Status ClosedFormLayout::check_way(const Leg& leg, const SensorModel& model) const {
  const Segment& to = recording_.segments[leg.to];
  for (std::size_t i = first_block_[leg.from + 1]; i < first_block_[leg.to + 1]; ++i)
    if (lost_in_motion(recording_, i, model))
      return input_error("step {}: {} missing near sample {}, in a rotation: the angle turned is lost", to.step,
                         counted(recording_.blocks[i].missing, "sample"), recording_.blocks[i].start_sample);
  const LegMotion motion = navigate_leg(recording_, first_block_, leg, model);
  const double turned_deg = motion.turned_rad / rad_per_deg;
  if (!(std::abs(turned_deg - leg.turn_deg) < max_misfit_deg))
    return input_error(
        "{}the gyros felt a turn of {:.1f} deg on the way, {:.0f} were commanded; the "
        "segments do not fit the data",
        place(to), turned_deg, leg.turn_deg);
  const Eigen::AngleAxisd apart(attitude_at(angles_of(to)).transpose() * motion.C_nb_arrived);
  if (!(apart.angle() / rad_per_deg < max_misfit_deg))
    return input_error("{}the navigated attitude is {:.1f} deg from these angles; the segments do not fit the data",
                       place(to), apart.angle() / rad_per_deg);
  return {};
}

ParameterDistance distance(const Parameters& one, const Parameters& other, const RecordingInfo& info) {
  const double nominal = start_parameters(info).n(0, 0);
  return {(one.N0_degph - other.N0_degph).cwiseAbs().maxCoeff(), (one.A0_g - other.A0_g).cwiseAbs().maxCoeff(),
          (one.n - other.n).cwiseAbs().maxCoeff() / nominal, (one.a - other.a).cwiseAbs().maxCoeff()};
}

Result<ClosedFormResult> closed_form_calibrate(const CompressedRecording& recording, const Parameters& start,
                                               const ClosedFormOptions& options) {
  ClosedFormLayout layout(recording);
  TRY(layout.find());
  TRY(layout.check_data(sensor_model(start, recording.info)));

  ClosedFormResult result;
  result.parameters = start;
  Parameters& parameters = result.parameters;
  while (result.passes < options.max_passes && !result.converged) {
    const Parameters before = parameters;
    for (int step = 1; step <= closed_form_steps; ++step)
      options.correct(layout.measure(step, sensor_model(parameters, recording.info)), parameters);
    ++result.passes;
    if (!to_vector(parameters).allFinite()) {
      result.message = fmt::format("diverged in pass {}", result.passes);
      return result;
    }
    result.corrections.push_back(distance(parameters, before, recording.info));
    result.converged = within(result.corrections.back(), options.tolerance);
  }
  result.message = fmt::format("{}converged in {} pass{}", result.converged ? "" : "not ", result.passes,
                               result.passes == 1 ? "" : "es");
  if (result.corrections.empty()) return result;
  const ParameterDistance& moved = result.corrections.back();
  result.message += fmt::format(", the last one moved N0 {:.2g} deg/h, A0 {:.2g} g, n {:.2g}, a {:.2g}",
                                moved.gyro_bias_degph, moved.accel_bias_g, moved.gyro_matrix, moved.accel_matrix);
  return result;
}

}  // namespace turncal
