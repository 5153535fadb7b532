#include "orchestrator/run/chamber_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {

void ChamberWatch::begin(double temperature_c, double ramp_c_per_min, double now_s) {
  target_c_ = temperature_c;
  ramp_c_per_min_ = ramp_c_per_min;
  began_s_ = changed_s_ = unit_since_s_ = now_s;
  in_band_s_.reset();
  out_of_band_s_.reset();
  told_ = settled_ = false;
}

bool ChamberWatch::as_told(const ChamberStatus& now) const {
  return now.on && std::abs(now.set_point_c - target_c_) <= 0.51 * limits_.grain_c;
}

std::string ChamberWatch::add(const ChamberStatus& now, std::optional<double> unit_c, double now_s) {
  if (unit_c && *unit_c > config_.limit_unit_c)
    return fmt::format("the unit is at {:.1f} C by its own thermometer, above chamber.limit_unit_c = {}", *unit_c,
                       format_number(config_.limit_unit_c));
  if (now.door_open.value_or(false)) return "its door is open";
  if (now.alarm.value_or(false)) return "it shows an alarm";
  if (as_told(now)) {
    told_ = true;
  } else if (told_ || now_s > began_s_ + answer_s) {
    const std::string is =
        fmt::format("it is {} with a set point of {} C", now.on ? "on" : "off", format_number(now.set_point_c));
    return is + (told_ ? ": somebody else switched or set it"
                       : fmt::format(": it was told to hold {} C", format_number(target_c_)));
  } else {
    return "";
  }
  if (now.actual_c != last_c_) changed_s_ = now_s;
  last_c_ = now.actual_c;
  if (unit_c && std::abs(*unit_c - unit_c_) > config_.band_c) {
    unit_c_ = *unit_c;
    unit_since_s_ = now_s;
  }
  const bool in_band = std::abs(now.actual_c - target_c_) <= config_.band_c;
  if (in_band) {
    if (!in_band_s_) in_band_s_ = now_s;
    out_of_band_s_.reset();
    settled_ = settled_ || now_s - std::max(*in_band_s_, unit_since_s_) >= config_.settle_s - 1e-6;
  }
  if (!settled_ && now_s > began_s_ + config_.settle_limit_s)
    return fmt::format("it has not settled at {} C within chamber.settle_limit_s = {}: it reads {:.1f} C{}",
                       format_number(target_c_), format_number(config_.settle_limit_s), now.actual_c,
                       in_band && unit_c ? fmt::format(", and the unit {:.1f} C", *unit_c) : "");
  if (in_band) return "";
  if (!out_of_band_s_) out_of_band_s_ = now_s;
  in_band_s_.reset();
  if (now_s - changed_s_ > dead_s + 180.0 * limits_.grain_c / ramp_c_per_min_)
    return fmt::format("its sensor has read {:.1f} C for {:.0f} s, and it should be on its way to {} C: dead?",
                       now.actual_c, now_s - changed_s_, format_number(target_c_));
  if (settled_ && now_s - *out_of_band_s_ > config_.settle_s)
    return fmt::format("it had settled at {} C and reads {:.1f} C", format_number(target_c_), now.actual_c);
  return "";
}

double ChamberWatch::left_s(double now_s) const {
  if (settled_) return 0.0;
  if (in_band_s_) return std::max(0.0, config_.settle_s - (now_s - std::max(*in_band_s_, unit_since_s_)));
  return config_.settle_s + (told_ ? 60.0 * std::abs(target_c_ - last_c_) / ramp_c_per_min_ : 0.0);
}

Status ChamberKeeper::connect() {
  TRY(chamber_.connect());
  connected_ = true;
  const ChamberStatus now = TRY(chamber_.status());
  last_ = now;
  if (now.door_open.value_or(false)) return device_error(chamber_.identity() + ": its door is open");
  if (now.alarm.value_or(false)) return device_error(chamber_.identity() + ": it shows an alarm");
  return {};
}

void ChamberKeeper::bring_to(double temperature_c, double ramp_c_per_min, double now_s) {
  work_ = Work::hold;
  temperature_c_ = temperature_c;
  ramp_c_per_min_ = ramp_c_per_min;
  off_ = false;
  watch_.begin(temperature_c, ramp_c_per_min, now_s);
  next_s_ = now_s;
}

void ChamberKeeper::switch_off() {
  if (work_ == Work::off) return;
  work_ = Work::off;
  off_ = reads_off_ = false;
  next_s_ = -1e300;
}

void ChamberKeeper::ask(double now_s) {
  next_s_ = now_s + poll_s;
  answer_ = std::make_shared<Answer>(Answer{work_});
  const bool tell = work_ == Work::hold && !(last_ && watch_.as_told(*last_));
  asked_.emplace(queue_,
                 [&chamber = chamber_, answer = answer_, tell, c = temperature_c_, ramp = ramp_c_per_min_]() -> Status {
                   Status told;
                   if (answer->work == Work::off) {
                     told = chamber.off();
                     if (!told && chamber.connect()) told = chamber.off();
                   } else if (tell) {
                     told = chamber.set(c, ramp);
                     if (told) told = chamber.on();
                   }
                   answer->status = chamber.status();
                   if (!told && answer->status) answer->status = told.error();
                   return {};
                 });
}

std::string ChamberKeeper::look(std::optional<double> unit_c, double now_s) {
  if (work_ == Work::none) return "";
  std::string fault;
  if (!queue_.status()) why_ = queue_.status().error().message;
  if (asked_ && asked_->done()) {
    const Answer answer = *answer_;
    asked_.reset();
    why_ = answer.status ? "" : answer.status.error().message;
    if (answer.status) last_ = *answer.status;
    if (work_ == Work::off && answer.work == Work::off) {
      const bool reads_off = answer.status && !answer.status->on;
      off_ = reads_off && reads_off_;  // twice: one reading may be another's
      reads_off_ = reads_off;
    }
    if (work_ == Work::hold && answer.work == Work::hold && answer.status) fault = watch_.add(*last_, unit_c, now_s);
  }
  if (!asked_ && !off_ && now_s >= next_s_ - 1e-6) ask(now_s);
  if (work_ == Work::off) return "";
  return !why_.empty() ? why_ : fault.empty() ? "" : chamber_.identity() + ": " + fault;
}

std::string ChamberKeeper::text() const {
  if (!last_) return "";
  if (work_ != Work::hold) return fmt::format("chamber {:.1f} C{}", last_->actual_c, last_->on ? "" : ", off");
  return fmt::format("chamber {:.1f} of {} C", last_->actual_c, format_number(temperature_c_));
}

std::string ChamberKeeper::not_verified() const {
  return "THAT THE CHAMBER IS OFF COULD NOT BE VERIFIED: " + (!why_.empty()        ? why_
                                                              : last_ && last_->on ? "it was told, and reads on"
                                                                                   : "it does not answer");
}

Status bring_to(ChamberKeeper& chamber, double temperature_c, double ramp_c_per_min, const ChamberTime& time) {
  chamber.bring_to(temperature_c, ramp_c_per_min, time.now_s());
  while (!chamber.settled()) {
    if (time.give_up && time.give_up()) return Error{ErrorKind::aborted, "stopped by the operator"};
    if (const std::string fault = chamber.look(time.unit_c ? time.unit_c() : std::nullopt, time.now_s());
        !fault.empty())
      return device_error(fault);
    if (time.progress) time.progress(chamber.text(), chamber.left_s(time.now_s()));
    time.wait(0.1);
  }
  return {};
}

Status leave_off(ChamberKeeper& chamber, const ChamberTime& time) {
  chamber.switch_off();
  for (const double until_s = time.now_s() + ChamberKeeper::off_limit_s; !chamber.is_off(); time.wait(0.1)) {
    if (time.now_s() > until_s) return device_error(chamber.not_verified());
    static_cast<void>(chamber.look(std::nullopt, time.now_s()));
  }
  return {};
}

}  // namespace turncal
