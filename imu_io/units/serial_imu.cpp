#include "imu_io/units/serial_imu.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <utility>

#include "calib/types/value_text.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr double block_s = 1.0;
constexpr std::size_t most_points = 512;
constexpr std::size_t recent_blocks = 3;
constexpr double judged_after_s = 10.0;

}  // namespace

ArrivalFit::ArrivalFit() {
  hull_.reserve(most_points + 1);
  recent_.reserve(recent_blocks);
}

void ArrivalFit::restart() { *this = ArrivalFit(); }

void ArrivalFit::add(double unit_s, double host_s) {
  const Point point{unit_s, host_s - unit_s};
  if (line_) largest_delay_s_ = std::max(largest_delay_s_, point.late_s - (line_->offset_s + line_->skew * unit_s));
  if (have_block_ && unit_s - block_start_s_ >= block_s) close_block();
  if (!have_block_) {
    if (blocks_ == 0) first_unit_s_ = unit_s;
    have_block_ = true;
    block_start_s_ = unit_s;
    block_ = point;
  } else if (point.late_s < block_.late_s) {
    block_ = point;
  }
}

void ArrivalFit::close_block() {
  have_block_ = false;
  // The block's delay is taken relative to the line fitted before it; then the block joins the hull.
  if (line_ = estimate(); line_ && line_->span_s < judged_after_s) line_.reset();
  if (line_) {
    if (recent_.size() == recent_blocks) recent_.erase(recent_.begin());
    recent_.push_back(block_.late_s - (line_->offset_s + line_->skew * block_.unit_s));
    square_sum_ += recent_.back() * recent_.back();
    ++squares_;
    if (recent_.size() == recent_blocks) persistent_delay_s_ = *std::ranges::min_element(recent_);
  }
  const auto turns_right = [](const Point& a, const Point& b, const Point& c) {
    return (b.late_s - a.late_s) * (c.unit_s - a.unit_s) >= (c.late_s - a.late_s) * (b.unit_s - a.unit_s);
  };
  while (hull_.size() >= 2 && turns_right(hull_[hull_.size() - 2], hull_.back(), block_)) hull_.pop_back();
  hull_.push_back(block_);
  sum_unit_s_ += block_.unit_s;
  ++blocks_;
  if (hull_.size() > most_points) {
    // Drops every other inner corner. The hull stays on or above the former one.
    std::size_t kept = 1;
    for (std::size_t i = 2; i < hull_.size(); i += 2) hull_[kept++] = hull_[i];
    if (hull_.size() % 2 == 0) hull_[kept++] = hull_.back();
    hull_.resize(kept);
  }
}

std::optional<ArrivalEstimate> ArrivalFit::estimate() const {
  if (hull_.size() < 2 || blocks_ < 2) return {};
  const double mean = sum_unit_s_ / double(blocks_);
  std::size_t right = 1;
  while (right + 1 < hull_.size() && hull_[right].unit_s < mean) ++right;
  const Point& a = hull_[right - 1];
  const Point& b = hull_[right];
  ArrivalEstimate result;
  result.skew = (b.late_s - a.late_s) / (b.unit_s - a.unit_s);
  result.offset_s = a.late_s - result.skew * a.unit_s;
  result.span_s = hull_.back().unit_s - first_unit_s_;
  if (squares_ > 0) result.skew_uncertainty = std::sqrt(square_sum_ / double(squares_)) / result.span_s;
  result.largest_delay_s = largest_delay_s_;
  return result;
}

// ---- the unit ----

namespace {

constexpr double slice_s = 0.02;  // longest single wait
// The kernel returns at most 4095 bytes at once and delivers further bytes later, in pieces of any size. After a read of half as much
// the line counts as empty only after a short time without bytes.
constexpr std::size_t backlog_bytes = 2048;
constexpr double moved_up_s = 0.005;
constexpr double skew_judged_after_s = 10.0;
constexpr double gross_skew = 2e-3;       // a wrong sample rate: no clock is so inaccurate
constexpr double least_lateness_s = 0.1;  // a smaller delay may be due to a busy host

SerialSettings line_of(const FrameDescription& frame, const std::string& device) {
  SerialSettings line = frame.line;
  line.device = device;
  return line;
}

// Rejects a line that is too slow for the frames.
void check_baud(KeyValueFile& file, const FrameDescription& frame) {
  const SerialSettings& serial = frame.line;
  const int bits = 1 + serial.data_bits + (serial.parity == SerialParity::none ? 0 : 1) + serial.stop_bits;
  std::size_t bytes = frame.split ? 0 : frame.variants.front().length;
  for (const FrameVariant& variant : frame.variants)
    bytes = frame.split ? bytes + variant.length : std::min(bytes, variant.length);
  const double needed = double(bits) * double(bytes) / frame.sample_period_s;
  if (needed > double(serial.baud))
    file.reject(
        file.has("imu.baud") ? "imu.baud" : "imu.frame",
        fmt::format("a line of at least {} baud, for {} bytes each {} s; it has {}", format_number(std::ceil(needed)),
                    bytes, format_number(frame.sample_period_s), serial.baud));
}

// A failed write is ignored: a broken line shows when it is read.
void ask(const std::stop_token& ended, ByteLine& line, const std::vector<std::byte>& request, double period_s) {
  double next_s = monotonic_s();
  while (!ended.stop_requested()) {
    static_cast<void>(line.write_all(request, 0.0).ok());
    const double now_s = monotonic_s();
    next_s = std::max(next_s + period_s, now_s - period_s);  // missed requests are not made up for
    std::this_thread::sleep_for(std::chrono::duration<double>(std::max(next_s - now_s, 0.0)));
  }
}

}  // namespace

Status judge_clock(const ArrivalFit& fit, double max_ppm) {
  const std::optional<ArrivalEstimate> estimate = fit.estimate();
  if (!estimate || estimate->skew_uncertainty == 0.0) return {};
  if (std::abs(estimate->skew) - 3.0 * estimate->skew_uncertainty <= 1e-6 * max_ppm) return {};
  return device_error("the unit's clock is off by " + format_number(std::round(-1e7 * estimate->skew) / 10.0) +
                      " ppm against the host's: expected at most imu.clock_max_ppm = " + format_number(max_ppm));
}

SerialImu::SerialImu(const FrameDescription& frame, const SerialImuSettings& settings)
    : frame_(frame), settings_(settings), decoder_(frame) {}

Status SerialImu::open() {
  close();
  port_ = TRY(ByteLine::open(line_of(frame_, settings_.device)));
  if (!frame_.request.empty())
    requests_ =
        std::jthread(ask, std::ref(port_), std::cref(frame_.request), frame_.request_period_s / settings_.speedup);
  decoder_.rejoin();
  fit_.restart();
  restarted_ = false;
  empty_s_ = line_checked_s_ = monotonic_s();
  backlog_ = false;
  line_at_open_ = port_.line_errors();
  line_errors_ = {};
  return {};
}

void SerialImu::close() {
  requests_ = {};
  port_.close();
}

Result<ImuIdentity> SerialImu::identify() {
  if (!port_.is_open()) return device_error(settings_.device + ": identify before open");
  return ImuIdentity{settings_.unit_serial, frame_.name + " on " + describe_line(line_of(frame_, settings_.device))};
}

void SerialImu::describe(RecordingInfo& info) const {
  frame_.describe(info);
  info.simulated = settings_.simulated;
}

Error SerialImu::lost(const std::string& why) {
  close();
  return device_error(settings_.device + ": " + why);
}

std::size_t SerialImu::read_decoded(std::span<ImuSample> out) {
  std::size_t count = 0;
  while (count < out.size()) {
    const auto next = decoder_.next(out[count]);
    if (next == FrameDecoder::Next::sample) {
      ++count;
      continue;
    }
    restarted_ = next == FrameDecoder::Next::restarted;
    // All received bytes are decoded, so the last sample is the one that arrived last.
    if (count > 0) {
      const double unit_s = double(out[count - 1].counter) * frame_.sample_period_s;
      fit_.add(unit_s, decoder_.arrival().latest_s);
    }
    break;
  }
  if (count > 0) last_counter_ = out[count - 1].counter;
  return count;
}

Result<std::size_t> SerialImu::receive(double timeout_s) {
  const double began_s = monotonic_s();
  const auto room = decoder_.space();
  const std::size_t count = TRY(port_.read(room, timeout_s));
  const double now_s = monotonic_s();
  count_line_errors(now_s);
  if (count == 0) {
    backlog_ = backlog_ && now_s - backlog_s_ < moved_up_s;
    if (backlog_) return std::size_t{0};
    empty_s_ = began_s + timeout_s;
    decoder_.idle(empty_s_ * settings_.speedup);
    return std::size_t{0};
  }
  decoder_.added(count, {empty_s_ * settings_.speedup, now_s * settings_.speedup});
  if (count >= std::min(backlog_bytes, room.size())) {
    backlog_ = true;
    backlog_s_ = now_s;
  } else if (!backlog_) {
    empty_s_ = began_s;
  }
  return count;
}

void SerialImu::count_line_errors(double now_s) {
  if (!line_at_open_ || now_s - line_checked_s_ < 1.0) return;
  line_checked_s_ = now_s;
  if (const auto now = port_.line_errors()) {
    line_errors_ = {now->overrun - line_at_open_->overrun, now->framing - line_at_open_->framing,
                    now->parity - line_at_open_->parity};
  }
}

std::string SerialImu::summary() const {
  const ImuLinkCounters link = decoder_.counters();
  std::string text =
      fmt::format("{}, {} lost, {}, {}, {} flagged, {}, {}; ", counted(link.samples, "sample"), link.lost_samples,
                  counted(link.duplicates, "duplicate"), counted(decoder_.strays(), "stray"), decoder_.invalid(),
                  counted(link.bad_frames, "bad frame"), counted(link.resyncs, "resync"));
  text += line_at_open_ ? fmt::format("line errors: {} overrun, {} framing, {} parity", line_errors_.overrun,
                                      line_errors_.framing, line_errors_.parity)
                        : "line errors not counted by the port";
  const std::optional<ArrivalEstimate> arrival = fit_.estimate();
  if (!arrival || arrival->skew_uncertainty == 0.0) return text;
  // A slow unit takes more host time: its clock error has the opposite sign of skew.
  return text + fmt::format("; the unit's clock against the host's {} ppm, largest arrival delay {:.1f} ms",
                            plus_minus(-1e6 * arrival->skew, 1e6 * arrival->skew_uncertainty),
                            1e3 * arrival->largest_delay_s);
}

Status SerialImu::judge_arrivals() const {
  if (settings_.speedup != 1.0) return {};
  const auto estimate = fit_.estimate();
  if (!estimate || estimate->span_s < skew_judged_after_s) return {};
  if (std::abs(estimate->skew) > gross_skew) {
    return device_error(fmt::format("samples come every {} s, the frame description says every {} s",
                                    significant(frame_.sample_period_s * (1.0 + estimate->skew), 7),
                                    format_number(frame_.sample_period_s)));
  }
  TRY(judge_clock(fit_, settings_.clock_max_ppm));
  const double late_s = fit_.persistent_delay_s();
  if (late_s > std::max(0.5 * decoder_.wrap_s(), least_lateness_s))
    return device_error("samples come " + format_number(late_s) +
                        " s later than before: more were lost than the unit's counter can tell");
  return {};
}

Result<std::size_t> SerialImu::read(std::span<ImuSample> out, double timeout_s) {
  if (!port_.is_open()) return device_error(settings_.device + ": read before open");
  if (out.empty()) return std::size_t{0};
  const Deadline deadline(std::min(timeout_s / settings_.speedup, slice_s));
  for (;;) {
    if (const std::size_t count = read_decoded(out); count > 0) {
      if (Status status = judge_arrivals(); !status) return lost(status.error().message);
      return count;
    }
    if (restarted_)
      return lost(decoder_.restart_reason() + " after sample " + std::to_string(last_counter_) +
                  ": it was switched off or reset, or samples were lost while its line was behind");
    const auto received = receive(deadline.left_s());
    if (!received) {
      const Error& error = received.error();
      close();
      return error;
    }
    if (*received == 0 && deadline.passed()) return std::size_t{0};
  }
}

Result<SerialImuConfig> read_serial_imu_config(KeyValueFile& file) {
  SerialImuConfig config;
  config.settings.device = file.text("imu.device");
  const std::string& device = config.settings.device;
  const std::optional<LineAddress> line = parse_line(device);
  if (!line && !device.empty())
    file.reject(
        "imu.device",
        "a serial device such as /dev/serial/by-id/..., tcp:HOST:PORT, udp:PORT, udp:ADDRESS:PORT or udp_to:HOST:PORT");
  std::string name = file.text("imu.frame");
  const bool is_file = name.find('/') != std::string::npos || name.ends_with(".frame");
  if (is_file) name = file.file_named("imu.frame");
  KeyTable keys(file);
  keys.text("imu.unit_serial", config.settings.unit_serial);
  keys.flag("imu.simulated", config.settings.simulated);
  keys.number("imu.clock_max_ppm", config.settings.clock_max_ppm, between(0.1, 2000.0));
  keys.number("imu.speedup", config.settings.speedup, between(0.01, 1000.0));
  if (config.settings.speedup != 1.0 && !config.settings.simulated)
    file.reject("imu.speedup", "1 unless imu.simulated is true");
  TRY(file.status());
  auto frame = find_frame(name);
  if (!frame && !is_file) file.reject("imu.frame", "a built-in frame or a file: " + frame.error().message);
  TRY(file.status());
  if (!frame) return frame.error();
  config.frame = std::move(*frame);
  if (line && line->kind == LineKind::udp) {
    if (!config.frame.variants.front().counter)
      file.reject("imu.device", "a frame with a counter: only it tells of datagrams that were lost");
    if (!config.frame.request.empty() && !line->asks)
      file.reject("imu.device", "a serial line, tcp: or udp_to:HOST:PORT: the frame has a request to send");
    if (config.frame.request.empty() && line->asks)
      file.reject("imu.device", "udp:PORT, or a frame with a request: without one nothing is sent there");
  }
  if (line && line->kind != LineKind::serial && file.has("imu.baud"))
    file.reject("imu.baud", "no such key unless the device is a serial line");
  keys.whole("imu.baud", config.frame.line.baud, 50u, 20'000'000u);
  if (file.has("imu.accel_pulse_mps") && config.frame.accel_pulse_mps == 0.0)
    file.reject("imu.accel_pulse_mps", "no such key: the frame's accelerometers do not send pulses");
  keys.number("imu.accel_pulse_mps", config.frame.accel_pulse_mps, between(1e-9, 1.0));
  if (line && line->kind == LineKind::serial) check_baud(file, config.frame);
  TRY(file.status());
  return config;
}

}  // namespace turncal
