#include "orchestrator/devices/commissioning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "calib/model/parameters.h"
#include "imu_io/base/text.h"
#include "orchestrator/devices/first_step_check.h"
#include "orchestrator/run/motion_watch.h"
#include "turntable_drivers/table/table_state.h"
#include "turntable_drivers/table/table_stop.h"

namespace turncal {

namespace {

constexpr double homing_deadline_s = 300.0;
constexpr double least_pose_deg = 30.0;  // a smaller angle tells little about an accelerometer's sign

class Trial {
 public:
  Trial(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
        const RecordingInfo& info, const std::atomic<int>& stop_requests)
      : devices_(devices),
        station_(station),
        settings_(settings),
        stop_requests_(stop_requests),
        buffer_(256),
        period_s_(info.sample_period_s),
        felt_(info),
        speed_(station.axis, station.clock_speed_up) {}

  Status home() {
    TRY(devices_.table.enable());
    TRY(devices_.table.home());
    return wait_until(homing_deadline_s, "the axes did not find their zero", [](const TableStatus& axes) {
      return std::ranges::all_of(axes, [](const AxisStatus& axis) { return axis.homed && !axis.moving; });
    });
  }
  struct Turn {
    double turned_deg = 0.0;  // by the encoder
    Eigen::Vector3d sum;      // of the gyros, minus their mean before the turn
  };
  Result<Turn> turn(Axis axis) {
    TRY(rest());
    sums_ = {};
    TRY(rest());
    if (sums_.flagged > 0.0)
      return input_error("{} of {} samples are flagged as bad: expected another status.good, or a unit that is ready",
                         sums_.flagged, sums_.samples);
    const Eigen::Vector3d at_rest = sums_.gyro / sums_.samples;
    sums_ = {};
    const double from_deg = TRY(position(axis));
    TRY(move(axis, settings_.move_deg, settings_.rate_degps / 2.0));
    if (sums_.lost) return device_error(fmt::format("samples of the unit were lost while {} turned", to_string(axis)));
    const double to_deg = TRY(position(axis));
    const Turn turned{to_deg - from_deg, sums_.gyro - at_rest * sums_.samples};
    TRY(stop_on_way(axis, 0.0, settings_.rate_degps / 2.0));
    TRY(move(axis, 0.0, settings_.rate_degps));
    return turned;
  }
  // Sends the axis off and stops it, as a run told to end does: it has to come to rest short of its target.
  Status stop_on_way(Axis axis, double to_deg, double rate_degps) {
    constexpr double share = 0.3;  // of the way, before the stop
    const Sent sent = TRY(send(axis, to_deg, rate_degps));
    const double way_deg = std::abs(to_deg - sent.from.position_deg);
    const auto turned_deg = [&](const AxisStatus& a) { return std::abs(a.position_deg - sent.from.position_deg); };
    TRY(wait_until(sent.seconds, std::string(to_string(axis)) + " does not turn back",
                   [&](const TableStatus& axes) { return turned_deg(axes[index(axis)]) >= share * way_deg; }));
    if (const Status stopped = devices_.table.stop_all(); !stopped)
      return input_error("{}: the stop was refused: {}", to_string(axis), stopped.error().message);
    const double brake_deg = 2.0 * rate_degps * rate_degps / sent.move.acceleration_degps2;
    const double left_deg = way_deg - turned_deg(TRY(devices_.table.status(axis))) - brake_deg;
    held_deg_.reset();  // a stop may switch drives off
    sent_.reset();
    std::optional<AxisStatus> stands;
    TRY(wait_until(sent.seconds, std::string(to_string(axis)) + " was told to stop and does not come to rest",
                   [&](const TableStatus& axes) {
                     const AxisStatus& a = axes[index(axis)];
                     if (a.moving || !stands || !is_at(a, stands->position_deg)) stands = a;
                     return a.time_s - stands->time_s >= TableStop::stand_s;
                   }));
    if (left_deg > station_.motion.position_tolerance_deg && is_at(*stands, to_deg))
      return input_error(
          "{} was told to stop on its way and went on to its target: expected the stop of the table's manual",
          to_string(axis));
    TRY(devices_.table.enable());
    TRY(wait_until(homing_deadline_s, "the drives did not come on again after a stop", [](const TableStatus& axes) {
      return std::ranges::all_of(axes, [](const AxisStatus& a) { return a.enabled && !a.moving; });
    }));
    if (TRY(devices_.table.status(axis)).homed) return {};
    return input_error(
        "{} was homed, and after a stop says no longer that it is: expected {} as the table's manual has it",
        to_string(axis), bit_text("homed"));
  }
  // Returns the accelerometers' mean per sample at rest, with one axis turned to an angle (none: as it stands). The axis then goes back.
  Result<Eigen::Vector3d> force_at(std::optional<Axis> axis, double to_deg) {
    const double rate_degps = axis ? std::min(settings_.pose_rate_degps, limits_of(*axis).max_rate_degps) : 0.0;
    TRY(axis ? move(*axis, to_deg, rate_degps) : rest());
    sums_ = {};
    TRY(rest());
    const Eigen::Vector3d mean = sums_.accel / sums_.samples;
    if (axis) TRY(move(*axis, 0.0, rate_degps));
    return mean;
  }
  // Returns the host's delay when no rate of the axis could be judged; 0: one was.
  double unjudged_s(Axis axis) const { return unjudged_s_[axis]; }
  const AxisLimits& limits_of(Axis axis) const { return station_.axis[index(axis)]; }

 private:
  Result<TableStatus> read_table() {
    TableStatus axes;
    for (const Axis axis : all_axes) axes[index(axis)] = TRY(devices_.table.status(axis));
    return axes;
  }
  Status read_for(double seconds) {
    const double end_s = devices_.clock.now_s() + seconds;
    for (bool more = false; more || devices_.clock.now_s() < end_s;) {
      if (stop_requests_.load() > 0) return Error{ErrorKind::aborted, "stopped by the operator"};
      const std::size_t got = TRY(devices_.imu.read(buffer_, std::min(seconds, station_.motion.poll_moving_s)));
      for (const ImuSample& sample : std::span(buffer_).first(got)) {
        felt_.add(sample);
        sums_.lost = sums_.lost || (last_counter_ && sample.counter != *last_counter_ + 1);
        last_counter_ = sample.counter;
        sums_.samples += 1.0;
        sums_.flagged += (sample.flags & sample_flag_invalid) != 0 ? 1.0 : 0.0;
        sums_.gyro += Eigen::Vector3d::Map(sample.gyro.data());
        sums_.accel += Eigen::Vector3d::Map(sample.accel.data());
      }
      if (got > 0) zero_s_ = std::min(zero_s_, devices_.clock.now_s() - unit_s());
      more = got == buffer_.size();  // a late host finds many
    }
    return {};
  }
  // Reads the unit for rest_s of its own counter while no axis is sent, and checks that none turns. All earlier samples have then arrived,
  // however late the host is.
  Status rest() {
    const TableStatus now = TRY(read_table());
    hold(now, std::nullopt);
    const double end_s = devices_.clock.now_s() + settings_.rest_s;
    return wait_until(settings_.rest_s + station_.imu_timeout_s, "no samples from the unit",
                      [&](const TableStatus&) { return last_counter_ && zero_s_ + unit_s() >= end_s; });
  }
  // From now on every axis must stay where it was read, except the one that is sent.
  void hold(const TableStatus& axes, const std::optional<Move>& sent) {
    held_deg_.emplace();
    for (const Axis axis : all_axes) (*held_deg_)[axis] = axes[index(axis)].position_deg;
    sent_ = sent;
  }
  Status wait_until(double seconds, const std::string& late, const std::function<bool(const TableStatus&)>& over) {
    return TRY(is_over_within(seconds, over)) ? Status() : Status(device_error(late));
  }
  Result<bool> is_over_within(double seconds, const std::function<bool(const TableStatus&)>& over) {
    const double deadline_s = devices_.clock.now_s() + seconds;
    for (;;) {
      const double asked_s = devices_.clock.now_s();
      const TableStatus axes = TRY(read_table());
      if (const auto said = too_fast(axes, asked_s))
        return sent_ ? scale_error(sent_->axis, *said, std::nullopt) : device_error(*said);
      for (const Axis axis : all_axes) {
        // Before hold() the drives are still switching on and searching their zero.
        const std::string trouble = trouble_of(axis, axes[index(axis)], held_deg_.has_value());
        if (!trouble.empty()) return device_error(trouble);
      }
      const double tolerance_deg = station_.motion.position_tolerance_deg;
      const auto astray =
          held_deg_ ? stray_axis(axes, *held_deg_, sent_, tolerance_deg, tolerance_deg) : homing_.add(axes);
      if (astray)
        return device_error(*astray + (held_deg_ ? "" : "; or it has found it: expected " + bit_text("homed")));
      if (over(axes)) return true;
      if (devices_.clock.now_s() > deadline_s) return false;
      TRY(read_for(station_.motion.poll_moving_s));
    }
  }
  std::optional<std::string> too_fast(const TableStatus& axes, double asked_s) {
    const auto said = speed_.add(axes, asked_s, devices_.clock.now_s(), sent_, !held_deg_);
    return said ? said : speed_.add_felt({&felt_}, axes, sent_, !held_deg_);
  }
  // factor: how many times too fast the axis turned; none: at least as much as `said` says.
  Error scale_error(Axis axis, const std::string& said, std::optional<double> factor) const {
    const TableConfig& table = station_.table;
    if (!table.described()) return input_error(said);
    const double scale = table.map ? table.map->of(axis).rate_scale : table.dialect->of(axis).rate_scale;
    return input_error("{}: axis.{}.rate_scale in {} is {}, expected {}", said, to_string(axis),
                       table.described()->file, format_number(scale),
                       factor      ? fmt::format("about {:.3g}", scale / *factor)
                       : table.map ? "less, or another rate.type"
                                   : "less");
  }
  // Compares the rate of an axis with the commanded one, as the unit felt it or, when the unit's scale is unknown, by angle and time.
  Status judge_rate(const Move& move, double from_deg, double at_deg, double took_s) {
    constexpr double tolerance = 0.2;
    constexpr double least_deg = 0.5;
    const double way_deg = std::abs(at_deg - from_deg);
    if (way_deg < least_deg) return {};
    const double peak_degps =
        std::min(move.rate_degps, std::sqrt(std::abs(move.target_deg - from_deg) * move.acceleration_degps2));
    const std::optional<double> felt_degps = felt_.end_turn(way_deg);
    if (const auto said = SpeedWatch::judge_turn({&felt_}, move, way_deg)) return device_error(*said);
    // The felt rate contains noise, which matters at slow rates; the mean rate contains the settling, which matters at fast ones.
    const double mean_degps = way_deg / took_s;
    const bool slow = felt_degps && *felt_degps < (1.0 - tolerance) * peak_degps;
    const double degps = slow ? mean_degps : felt_degps.value_or(mean_degps);
    const double factor = degps / peak_degps;
    // The mean rate is below the peak, because it includes ramps and settling.
    if (felt_degps ? std::abs(factor - 1.0) <= tolerance : factor <= 1.0 + tolerance && factor > 0.3) return {};
    return scale_error(
        move.axis,
        fmt::format("{} turned by {:.4g} deg in {:.3g} s, at {:.3g} times the {:.4g} deg/s that were sent ({})",
                    to_string(move.axis), way_deg, took_s, factor, move.rate_degps,
                    felt_degps && !slow ? "as the unit felt it" : "by its positions"),
        factor);
  }
  double unit_s() const { return double(last_counter_.value_or(0)) * period_s_; }
  Result<double> position(Axis axis) { return TRY(devices_.table.status(axis)).position_deg; }
  bool is_at(const AxisStatus& axis, double deg) const {
    return std::abs(axis.position_deg - deg) <= station_.motion.position_tolerance_deg;
  }
  struct Sent {
    Move move;
    AxisStatus from;
    double seconds;  // to arrive in
  };
  Result<Sent> send(Axis axis, double to_deg, double rate_degps) {
    const TableStatus before = TRY(read_table());
    const AxisStatus& from = before[index(axis)];
    const double acceleration_degps2 =
        std::min(std::max(settings_.acceleration_degps2, 2.0 * rate_degps), limits_of(axis).max_acceleration_degps2);
    const Move sent{axis, to_deg, rate_degps, acceleration_degps2};
    hold(before, sent);
    felt_.begin_turn(SpeedWatch::factor * acceleration_degps2);
    const double began_s = devices_.clock.now_s();
    speed_.restart(before, began_s, began_s);
    TRY(devices_.table.move_absolute(axis, to_deg, rate_degps, acceleration_degps2));
    return Sent{sent, from,
                std::abs(to_deg - from.position_deg) / rate_degps + 2.0 * rate_degps / acceleration_degps2 +
                    station_.motion.deadline_margin_s};
  }
  // Moves the axis, and rests.
  Status move(Axis axis, double to_deg, double rate_degps) {
    const Sent sent = TRY(send(axis, to_deg, rate_degps));
    // Times are those of the unit's counter, read after each reading: host and table can be late.
    AxisStatus last = sent.from, read = sent.from;
    const double sent_s = read.time_s = unit_s();
    double turned_until_s = sent_s;
    bool turned = false;
    RateCheck rate(read, std::abs(to_deg - read.position_deg) / rate_degps);
    const auto follow = [&] {
      read.time_s = unit_s();
      if (turned) turned_until_s = read.time_s;
      rate.add(read);
    };
    const bool arrived = TRY(is_over_within(sent.seconds, [&](const TableStatus& axes) {
      const AxisStatus& a = axes[index(axis)];
      follow();
      read = a;
      turned = !is_at(a, last.position_deg);
      if (turned || is_at(a, to_deg)) last = a;
      return !a.moving && a.in_position && is_at(a, to_deg);
    }));
    if (arrived) {
      TRY(read_for(station_.motion.poll_moving_s));
      follow();
      TRY(rest());
    }
    const double at_deg = TRY(position(axis));
    const std::string late_text = std::string(to_string(axis)) + " did not arrive in time";
    if (!arrived && is_at(last, to_deg))
      return input_error(
          "{}: it has stood at its target for {:.3g} s, and {}: expected {} as the table's manual has it", late_text,
          unit_s() - turned_until_s, last.moving ? "still says that it moves" : "in_position was never set",
          bit_text(last.moving ? "moving" : "in_position"));
    if (!arrived && is_at(last, sent.from.position_deg))
      return input_error("{}: it did not turn: expected a move, and in it what enables the drive, as the manual has it",
                         late_text);
    if (const Status fits = judge_rate(sent.move, sent.from.position_deg, at_deg, turned_until_s - sent_s); !fits)
      return arrived ? fits.error() : Error{fits.error().kind, late_text + ": " + fits.error().message};
    if (!arrived) return device_error(late_text);
    unjudged_s_[axis] = std::min(unjudged_s_[axis], TRY(rate.judge(axis, settings_.rate_tolerance)));
    return {};
  }
  std::string bit_text(const std::string& name) const {
    return station_.table.map ? "bit." + name + " of the map" : name + " in status.bit or status.code of the dialect";
  }

  const StationDevices& devices_;
  const StationConfig& station_;
  const CommissioningSettings& settings_;
  const std::atomic<int>& stop_requests_;
  std::vector<ImuSample> buffer_;
  struct Sums {
    Eigen::Vector3d gyro{0, 0, 0}, accel{0, 0, 0};
    double samples = 0.0, flagged = 0.0;
    bool lost = false;
  };
  Sums sums_;
  std::optional<std::int64_t> last_counter_;
  double period_s_;
  double zero_s_ = 1e300;               // host time of counter 0, from the sample with the least delay
  std::optional<AxisTriple> held_deg_;  // none while homing, when any axis may turn
  HomingWatch homing_{station_.axis};
  FeltRate felt_;
  SpeedWatch speed_;
  std::optional<Move> sent_;
  AxisTriple unjudged_s_{{1e9, 1e9, 1e9}};
};

// Judges the gyros' sum over a turn of `axis` by turned_deg; the error names axis, expected and found.
Status judge_turn(Axis axis, double turned_deg, const Eigen::Vector3d& sum, IncrementKind kind,
                  const CommissioningSettings& settings) {
  const Eigen::Vector3d about = body_axis_of(axis, {});
  const std::string expected = nearest_axis(about);  // "-y"
  const bool pulses = kind == IncrementKind::pulses;
  const double weight = pulses ? settings.gyro_pulse_arcsec * rad_per_arcsec : 1.0;  // 0: not known
  const bool points_there = points_along(sum, about, settings.direction_deg), size_known = weight > 0.0;
  const double felt_deg = sum.norm() * weight / rad_per_deg;
  const bool size_fits =
      !size_known || std::abs(felt_deg - std::abs(turned_deg)) <= settings.scale_tolerance * std::abs(turned_deg);
  if (points_there && size_fits) return {};
  const Eigen::Vector3d shown = sum * (size_known ? weight / rad_per_deg : 1.0);
  const bool plus = expected[0] == '+';
  return input_error(
      "{} turned by {:+g} deg: sensed {:+.3f}, {:+.3f}, {:+.3f} {} about x, y, z: expected {} about {} alone ({})",
      to_string(axis), settings.move_deg, shown.x(), shown.y(), shown.z(), size_known ? "deg" : "pulses",
      size_known ? fmt::format("{:.6f} deg", plus ? turned_deg : -turned_deg)
      : plus     ? "plus"
                 : "minus",
      expected[1],
      points_there ? "scale of the gyros, or counts of the table's axis, by more than 0.5 %"
                   : "sign of the table's axis, or axes and signs of the unit's frame");
}

Status try_turns(Trial& trial, const CommissioningSettings& settings, IncrementKind kind, std::ostream& out) {
  for (const Axis axis : all_axes) {
    const Trial::Turn turned = TRY(trial.turn(axis));
    TRY(judge_turn(axis, turned.turned_deg, turned.sum, kind, settings));
    const double size = turned.sum.norm();
    const bool pulses = kind == IncrementKind::pulses;
    out << fmt::format("{:<7} {:+g} deg: sensed about {}, {:.6g} {}", to_string(axis), settings.move_deg,
                       nearest_axis(body_axis_of(axis, {})),
                       pulses ? std::abs(turned.turned_deg) * 3600.0 / size : size / rad_per_deg,
                       pulses ? "arcsec a pulse" : "deg")
        << std::endl;
  }
  if (kind == IncrementKind::pulses && settings.gyro_pulse_arcsec <= 0.0)
    out << "the scale of the gyros was not judged: give the weight of a pulse with --gyro-pulse-arcsec" << std::endl;
  return {};
}

Status try_poses(Trial& trial, const RecordingInfo& info, double gravity_mps2, const CommissioningSettings& settings,
                 std::ostream& out) {
  DirectionLimits limits{.direction_deg = settings.direction_deg, .force_tolerance = settings.force_tolerance};
  const double weight_mps =
      info.accel_increment == IncrementKind::pulses ? info.accel_pulse_mps : 1.0;  // per increment
  const std::pair<std::optional<Axis>, const char*> poses[] = {
      {std::nullopt, "level"}, {Axis::pitch, "pitch"}, {Axis::roll, "roll"}};
  for (const auto& [axis, name] : poses) {
    AxisTriple angles_deg;
    if (axis) angles_deg[*axis] = std::min(settings.pose_deg, trial.limits_of(*axis).soft_max_deg);
    const double to_deg = axis ? angles_deg[*axis] : 0.0;
    if (axis && to_deg < least_pose_deg) {
      out << name << " may turn to " << to_deg << " deg only: gravity was not compared there" << std::endl;
      continue;
    }
    const Eigen::Vector3d mean = TRY(trial.force_at(axis, to_deg));
    const Eigen::Vector3d force = mean * weight_mps / info.sample_period_s;
    if (Status status = judge_force(force, angles_deg, gravity_mps2, limits); !status)
      return input_error(status.error().message);
    out << fmt::format("gravity, {} {:g} deg: {:+.4f}, {:+.4f}, {:+.4f} m/s^2 along x, y, z", name, to_deg, force.x(),
                       force.y(), force.z())
        << std::endl;
  }
  return {};
}

}  // namespace

Status try_axes(const StationDevices& devices, const StationConfig& station, const CommissioningSettings& settings,
                const std::atomic<int>& stop_requests, std::ostream& out) {
  RecordingInfo info;
  devices.imu.describe(info);
  Trial trial(devices, station, settings, info, stop_requests);
  Status tried = trial.home();
  if (tried) tried = try_turns(trial, settings, info.gyro_increment, out);
  if (tried) tried = try_poses(trial, info, station.gravity_mps2, settings, out);
  for (const Axis axis : all_axes)
    if (const double late_s = trial.unjudged_s(axis); tried && late_s > 0.0)
      out << fmt::format("the rate that {} tells could not be judged: the host was late by {:.2g} s", to_string(axis),
                         late_s)
          << std::endl;
  return tried;
}

void RateCheck::add(const AxisStatus& now) {
  const double way_deg = now.position_deg - last_.position_deg, passed_s = now.time_s - last_.time_s;
  const auto known = [](double rate_degps) { return std::isfinite(rate_degps) ? rate_degps : 0.0; };
  turned_deg_ += way_deg;
  late_s_ = std::max(late_s_, passed_s);
  if (now.time_s - before_s_ <= longest_s_) {
    followed_deg_ += way_deg;
    summed_deg_ += 0.5 * (known(now.rate_degps) + known(last_.rate_degps)) * passed_s;
  }
  said_moving_ = said_moving_ || now.moving;
  before_s_ = std::exchange(last_, now).time_s;
}

Result<double> RateCheck::judge(Axis axis, double tolerance) const {
  if (std::abs(followed_deg_) <= least_followed * std::abs(turned_deg_)) return late_s_;
  const std::string turned = fmt::format("{} turned by {:+.3f} deg ", to_string(axis), followed_deg_);
  if (std::abs(summed_deg_ - followed_deg_) > tolerance * std::abs(followed_deg_))
    return input_error(
        "{}while its rate summed up to {:+.3f} deg: expected a rate that says how fast it turns (its register or "
        "field, "
        "scale and sign)",
        turned, summed_deg_);
  if (!said_moving_) return input_error(turned + "and its status never showed it: expected a bit or code of moving");
  return 0.0;
}

}  // namespace turncal
