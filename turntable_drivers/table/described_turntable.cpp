#include "turntable_drivers/table/described_turntable.h"

#include <fmt/format.h>

#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr double longest_leg = 0.45;  // fraction of a circle
constexpr double leg_done_deg = 0.5;  // near enough to send the next leg, whose target is an angle, not a distance

std::string degrees(double value) { return format_number(std::round(1e4 * value) / 1e4) + " deg"; }

// Returns why an axis must not be homed or moved: a fault, a motion, a disabled drive.
std::optional<std::string> refusal_of_state(const AxisStatus& now) {
  const std::string text = now.text.empty() ? "" : ": " + now.text;
  if (now.emergency_stop) return "emergency stop is pressed" + text;
  if (now.fault) return "drive fault: expected it cleared" + text;
  if (!now.remote) return "not in remote mode";
  // An unknown rate, at the first reading of a device that reports none, is not a motion.
  if (now.moving && !std::isnan(now.rate_degps)) return "a motion is under way: expected it finished or stopped";
  if (!now.enabled) return "not enabled";
  return {};
}

// A pause within a stop is not interrupted.
void hold(double seconds) { static_cast<void>(StopSignal().pause(seconds)); }

}  // namespace

DescribedTurntable::DescribedTurntable(const TableDescription& description, const TableLinkSettings& link,
                                       std::unique_ptr<TableCodec> codec, const Clock& clock,
                                       const std::atomic<int>* stop_requests)
    : clock_(clock),
      stop_(stop_requests),
      table_(description),
      link_(link),
      codec_(std::move(codec)),
      line_(link, stop_) {}

// ---- messages ----

Error DescribedTurntable::table_error(const std::string& what) const {
  return device_error("table " + table_.name + ": " + what);
}

Error DescribedTurntable::axis_error(Axis axis, const std::string& what) const {
  return table_error(std::string(to_string(axis)) + ": " + what);
}

Error DescribedTurntable::given_up(Axis axis) const {
  return {ErrorKind::aborted, axis_error(axis, "given up for a stop").message};
}

Error DescribedTurntable::about(const TableRequest& request, const Error& error) const {
  return {error.kind, codec_->message(request, axis_error(request.axis, "").message, error.message)};
}

// ---- what is permitted ----

Status DescribedTurntable::connected() const {
  if (!connected_) return table_error("not connected");
  if (lost()) return device_error("link lost: " + lost_reason_ + "; expected it connected again");
  return {};
}

Status DescribedTurntable::commissioned() const {
  if (table_.commissioned) return {};
  return input_error(
      table_error("not commissioned: expected scale, sign and order checked and commissioned = true in " + table_.file)
          .message);
}

Result<AxisStatus> DescribedTurntable::ready(Axis axis) {
  Result<AxisStatus> now = status(axis);
  if (!now) return now;
  if (const auto refusal = refusal_of_state(*now)) return axis_error(axis, *refusal);
  return now;
}

// ---- commands ----

Status DescribedTurntable::carry_out(TableOperation operation, Axis axis, const Moves& moves) {
  // Everything is encoded before anything is sent.
  std::vector<std::optional<TableRequest>> requests;
  for (std::size_t step = 0; step < codec_->steps(operation); ++step) {
    requests.emplace_back();
    if (codec_->pause_s(operation, step) > 0.0) continue;
    Result<TableRequest> request = codec_->encode(operation, axis, step, moves);
    if (!request) return axis_error(axis, request.error().message);
    requests.back() = std::move(*request);
  }
  const bool is_stop = operation == TableOperation::stop || operation == TableOperation::abort;
  for (std::size_t step = 0; step < requests.size(); ++step) {
    if (!requests[step]) {
      const double pause_s = codec_->pause_s(operation, step);
      if (is_stop) hold(pause_s);
      if (!is_stop && !stop_.pause(pause_s)) return given_up(axis);
      continue;
    }
    const Judgement judgement = line_.exchange(*requests[step], *codec_, nullptr);
    if (judgement.status) continue;
    const Error error = about(*requests[step], judgement.status.error());
    if (!line_.is_open()) lost_reason_ = error.message;
    return error;
  }
  return {};
}

Status DescribedTurntable::carry_out(TableOperation operation) {
  for (const Axis axis : axes_for(codec_->once(operation))) TRY(carry_out(operation, axis, moves_));
  return {};
}

Status DescribedTurntable::open(bool judge_positions) {
  connected_ = lost_ = enable_called_ = false;
  memory_ = {};
  way_ = {};
  targets_void_ = true;
  TRY(line_.open());
  const auto prepare = [&]() -> Status {
    TRY(carry_out(TableOperation::setup));
    // Every axis must answer with a plausible reading.
    for (const Axis axis : all_axes) {
      const AxisReading reading = TRY(read(axis, judge_positions && codec_->implausible() == nullptr));
      if (judge_positions && !believable(axis, reading.position_deg))
        return axis_error(axis, fmt::format("position {} is not plausible: expected {}", degrees(reading.position_deg),
                                            codec_->implausible()));
      moves_[index(axis)] = {reading.position_deg};
    }
    return {};
  };
  Status prepared = prepare();
  if (!prepared) line_.close();
  return prepared;
}

Status DescribedTurntable::connect() {
  TRY(open(true));
  connected_ = was_connected_ = true;
  return {};
}

Result<TableIdentity> DescribedTurntable::identify() {
  TRY(connected());
  std::string description = table_.name + " at " + link_.address;
  for (std::size_t step = 0; step < codec_->steps(TableOperation::identify); ++step) {
    const TableRequest request = TRY(codec_->encode(TableOperation::identify, Axis::heading, step, moves_));
    AxisReading answer;
    const Judgement judgement = line_.exchange(request, *codec_, &answer);
    if (!judgement.status) return about(request, judgement.status.error());
    description += ", " + answer.text;
  }
  if (!table_.verified_on_hardware) description += fmt::format(", {} not verified on hardware", codec_->kind());
  return TableIdentity{description, table_.simulated};
}

Status DescribedTurntable::enable() {
  TRY(commissioned());
  for (const Axis axis : all_axes) {
    const AxisStatus now = TRY(status(axis));
    if (now.emergency_stop) return axis_error(axis, "enable: emergency stop is pressed");
    if (now.fault) return axis_error(axis, "enable: drive fault: expected it cleared");
  }
  commanded_off_ = false;
  commanded_on_ = true;
  for (AxisMemory& memory : memory_) memory.drive_on.reset();
  TRY(carry_out(TableOperation::enable));
  enable_called_ = true;
  return {};
}

Status DescribedTurntable::home() {
  const bool searches = codec_->searches();
  if (searches) TRY(commissioned());
  for (const Axis axis : all_axes) TRY(ready(axis));
  way_ = {};
  for (AxisMemory& memory : memory_) memory.homing_began(searches);
  if (!searches) return {};
  targets_void_ = true;
  return carry_out(TableOperation::home);
}

Status DescribedTurntable::move_absolute(Axis axis, double position_deg, double rate_degps,
                                         double acceleration_degps2) {
  TRY(commissioned());
  // The arguments are checked before the device is asked anything.
  if (!(std::abs(position_deg) <= table_.plausible_deg))
    return axis_error(axis, fmt::format("move to {} deg: expected at most {}", format_number(position_deg),
                                        degrees(table_.plausible_deg)));
  if (!(rate_degps > 0.0 && rate_degps <= table_.plausible_rate_degps))
    return axis_error(axis, fmt::format("rate {} deg/s: expected above 0 and at most {}", format_number(rate_degps),
                                        format_number(table_.plausible_rate_degps)));
  if (!(acceleration_degps2 > 0.0) || !std::isfinite(acceleration_degps2))
    return axis_error(axis,
                      fmt::format("acceleration {} deg/s^2: expected above 0", format_number(acceleration_degps2)));
  const AxisStatus now = TRY(ready(axis));
  if (!now.homed) return axis_error(axis, "not homed");
  // A table that takes all three angles at once must not resume a stopped motion.
  if (targets_void_ && codec_->moves_all()) {
    for (const Axis other : all_axes) {
      if (other == axis) continue;
      const AxisStatus there = TRY(status(other));
      moves_[index(other)] = {there.position_deg, 0.0, rate_degps, acceleration_degps2};
    }
  }
  targets_void_ = false;
  memory_[index(axis)].arrived_seen = false;
  way_[index(axis)].reset();
  const MoveNumbers move{position_deg, position_deg - now.position_deg, rate_degps, acceleration_degps2};
  if (!codec_->scale(axis).shorter_way) return send_move(axis, move);
  way_[index(axis)] = move;
  return send_leg(axis, now.position_deg);
}

Status DescribedTurntable::send_leg(Axis axis, double from_deg) {
  // Cleared during sending: on an error send_move() reads the status, which must not send another leg.
  const std::optional<MoveNumbers> way = std::exchange(way_[index(axis)], {});
  const double left_deg = way->position_deg - from_deg;
  const double legs = std::ceil(std::abs(left_deg) / (longest_leg * codec_->scale(axis).modulo_deg));
  MoveNumbers leg = *way;
  if (legs > 1.0) leg.position_deg = from_deg + left_deg / legs;
  leg.distance_deg = leg.position_deg - from_deg;
  TRY(send_move(axis, leg));
  if (legs > 1.0) way_[index(axis)] = way;
  return {};
}

// REQUIRES: `report` is based on a reading of this axis.
Status DescribedTurntable::go_on(Axis axis, AxisStatus& report) {
  std::optional<MoveNumbers>& way = way_[index(axis)];
  if (!way) return {};
  if (refusal_of_state(report) && !report.moving) way.reset();  // a fault, an emergency stop, a disabled drive
  if (!way) return {};
  const bool done = report.in_position && !report.moving &&
                    std::abs(report.position_deg - moves_[index(axis)].position_deg) <= leg_done_deg;
  report.in_position = false;
  report.moving = true;
  return done ? send_leg(axis, report.position_deg) : Status{};
}

Status DescribedTurntable::send_move(Axis axis, const MoveNumbers& move) {
  Moves moves = moves_;
  for (MoveNumbers& other : moves) other.distance_deg = 0.0;
  moves[index(axis)] = move;
  const Status sent = carry_out(TableOperation::move, axis, moves);
  if (sent) {
    moves_ = moves;
    return {};
  }
  if (sent.error().kind == ErrorKind::aborted || !line_.is_open()) return sent;
  // An unacknowledged move is never repeated blindly: the error says what the axis was seen to do.
  const Result<AxisStatus> after = status(axis);
  const char* const state = !after ? "its state cannot be read" : after->moving ? "it moves" : "it stands";
  return Error{sent.error().kind, fmt::format("{}; {}", sent.error().message, state)};
}

Status DescribedTurntable::abort_all() {
  commanded_off_ = true;
  const Status status = halt(true);
  if (status) commanded_on_ = false;
  enable_called_ = false;
  return status;
}

Status DescribedTurntable::halt(bool off) {
  if (!was_connected_) return table_error("not connected");
  way_ = {};
  targets_void_ = true;
  const bool one =
      !codec_->once(off ? TableOperation::abort : TableOperation::stop) && !codec_->once(TableOperation::abort);
  const auto is_off = [&](Axis axis) {
    const auto read_off = [](const AxisMemory& memory) { return memory.drive_on == false; };
    return commanded_off_ || (one ? read_off(memory_[index(axis)]) : std::ranges::all_of(memory_, read_off));
  };
  const auto operation_of = [&](Axis axis) {
    return off || is_off(axis) ? TableOperation::abort : TableOperation::stop;
  };
  stop_.handled();
  if (!line_.is_open()) {
    enable_called_ = false;  // after reconnecting, the table is not enabled
    TRY(line_.open());
    lost_ = false;
  }
  // Each step goes to every axis before the next: later steps of one axis must not delay the first step of another.
  std::array<bool, 3> taken{true, true, true};
  for (std::size_t step = 0, more = 1; more != 0; ++step) {
    more = 0;
    double pause_s = 0.0;
    for (const Axis axis : all_axes) {
      const TableOperation operation = operation_of(axis);
      const std::size_t steps = codec_->steps(operation);
      if (step >= steps || (codec_->once(operation) && axis != Axis::heading)) continue;
      more += step + 1 < steps ? 1 : 0;
      const double own_pause_s = codec_->pause_s(operation, step);
      pause_s = std::max(pause_s, own_pause_s);
      if (own_pause_s > 0.0) continue;
      bool& so_far = taken[index(axis)];
      const Result<TableRequest> request = codec_->encode(operation, axis, step, moves_);
      so_far = request && line_.send_at_once(*request, *codec_, so_far).ok();
    }
    hold(pause_s);
  }
  Status first_failure;
  for (const Axis axis : all_axes) {
    if (taken[index(axis)]) continue;
    if (Status status = carry_out(operation_of(axis), axis, moves_); !status && first_failure.ok())
      first_failure = status;
  }
  return first_failure;
}

Status DescribedTurntable::clear_fault() {
  TRY(connected());
  return carry_out(TableOperation::clear_fault);
}

// ---- readings ----

Status DescribedTurntable::beat() {
  if (codec_->heartbeat_s() == 0.0) return {};
  const double now_s = clock_.now_s();
  Status first_failure;
  for (const Axis axis : axes_for(codec_->once(TableOperation::heartbeat))) {
    double& last_s = memory_[index(axis)].heartbeat_s;
    if (now_s - last_s < codec_->heartbeat_s()) continue;
    const Status status = carry_out(TableOperation::heartbeat, axis, moves_);
    if (status) last_s = now_s;
    if (first_failure) first_failure = status;
  }
  return first_failure;
}

Judgement DescribedTurntable::read_once(Axis axis, AxisReading& reading) {
  for (std::size_t step = 0; step < codec_->steps(TableOperation::status); ++step) {
    const TableRequest request = TRY(codec_->encode(TableOperation::status, axis, step, moves_));
    Judgement judgement = line_.exchange(request, *codec_, &reading);
    if (judgement.status) continue;
    judgement.status = about(request, judgement.status.error());
    return judgement;
  }
  return {};
}

bool DescribedTurntable::believable(Axis axis, double position_deg) const {
  return memory_[index(axis)].believable(position_deg, clock_.now_s(), table_.plausible_deg,
                                         table_.plausible_rate_degps);
}

Result<AxisReading> DescribedTurntable::read(Axis axis, bool believed_only) {
  const AxisMemory& memory = memory_[index(axis)];
  Error last;
  bool alive = false;
  for (int i = 0; i <= link_.read_retries; ++i) {
    AxisReading reading;
    const Judgement judgement = read_once(axis, reading);
    if (judgement.status) {
      const double circle_deg = codec_->scale(axis).modulo_deg;
      if (circle_deg > 0.0 && std::isfinite(reading.position_deg))
        reading.position_deg = unwrapped_deg(reading.position_deg, memory.position_deg.value_or(0.0), circle_deg);
      if (!believed_only || believable(axis, reading.position_deg)) return reading;
      last = axis_error(axis, fmt::format("position {} is not believed: expected one that can be reached from {}",
                                          degrees(reading.position_deg),
                                          memory.position_deg ? degrees(*memory.position_deg) : "here"));
      alive = true;
      continue;
    }
    last = judgement.status.error();
    alive = judgement.alive;
    if (last.kind != ErrorKind::aborted) lost_reason_ = last.message;
    if (last.kind == ErrorKind::aborted || !line_.is_open() || !judgement.again) return last;
    if (judgement.pause_s > 0.0 && !stop_.pause(judgement.pause_s)) return given_up(axis);
  }
  lost_ = !alive;
  return last;
}

AxisStatus DescribedTurntable::report_of(Axis axis, const AxisReading& reading) {
  using enum DriveBit;
  AxisMemory& memory = memory_[index(axis)];
  const AxisScale& scale = codec_->scale(axis);
  const auto says = [&](DriveBit bit) { return reading[bit].value_or(false); };
  AxisStatus report;
  report.time_s = clock_.now_s();
  report.position_deg = reading.position_deg;
  memory.note(reading.position_deg, report.time_s);
  report.rate_degps = reading.rate_degps.value_or(memory.rate_degps);
  report.rate_told = reading.rate_degps.has_value();
  report.moving =
      reading[moving].value_or(!(std::abs(report.rate_degps) <= table_.moving_rate_degps)) || !reading.known;
  report.drive_on = reading[enabled].value_or(commanded_on_) || (!reading.known && codec_->tells(enabled));
  memory.drive_on = report.drive_on;
  report.enabled = enable_called_ && reading.known && reading[enabled].value_or(true);
  report.in_position = says(in_position);
  if (scale.arrives_in_a_pulse) {
    memory.arrived_seen = memory.arrived_seen || report.in_position;
    report.in_position = memory.arrived_seen && !report.moving;
  }
  // A device with a circular scale has lost its turns after a lost link: it must be homed again.
  const bool turns_known = scale.modulo_deg == 0.0 || memory.home_called;
  bool is_homed = says(homed), unsettled = false;
  if (!codec_->searches()) {
    is_homed = memory.home_called;
  } else if (!codec_->tells(homed)) {
    // Without a homed flag, "arrived" may be stale: see AxisMemory.
    is_homed = memory.homed || (memory.home_called && report.in_position && !report.moving);
    unsettled = !report.in_position && !memory.homed;
  }
  report.homed = memory.judge_homed(is_homed && turns_known, report.moving || unsettled);
  report.limit = says(limit_positive) || says(limit_negative);
  report.fault = says(fault);
  report.emergency_stop = says(emergency_stop);
  report.remote = reading[remote].value_or(true);
  report.raw = reading.raw;
  report.text = reading.known ? reading.text : "unknown status";
  return report;
}

Result<AxisStatus> DescribedTurntable::status(Axis axis) {
  TRY(connected());
  // An unacknowledged heartbeat stays due; the reading tells whether the drive is there.
  const Status heartbeat = beat();
  const AxisReading reading = TRY(read(axis, true));
  if (!heartbeat && heartbeat.error().kind == ErrorKind::input) return heartbeat.error();
  AxisStatus report = report_of(axis, reading);
  TRY(go_on(axis, report));
  return report;
}

Status DescribedTurntable::commission(const AxisTriple& known_deg, double tolerance_deg) {
  if (!connected_) TRY(open(false));
  for (const Axis axis : all_axes) {
    const AxisReading reading = TRY(read(axis, false));
    const double circle_deg = codec_->scale(axis).modulo_deg;
    const auto fits = [&](double angle_deg) {
      if (circle_deg > 0.0 && std::isfinite(angle_deg))
        angle_deg = unwrapped_deg(angle_deg, known_deg[axis], circle_deg);
      return std::abs(angle_deg - known_deg[axis]) <= tolerance_deg;
    };
    std::string others;
    for (const OtherReading& other : codec_->other_readings(axis, reading))
      if (fits(other.position_deg)) others += (others.empty() ? "" : "; ") + other.settings;
    const std::string known = degrees(known_deg[axis]);
    std::string said;
    if (!fits(reading.position_deg)) {
      said = fmt::format("reads {}, stands at {}: expected {}", degrees(reading.position_deg), known,
                         others.empty() ? codec_->expected_scale() + (", or the axis at " + known) : others);
    } else if (!others.empty()) {
      said = fmt::format("at {} {}", known, codec_->expected_angle());
    }
    if (!said.empty()) return input_error(axis_error(axis, said).message);
  }
  return {};
}

}  // namespace turncal
