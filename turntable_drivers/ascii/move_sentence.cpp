#include "turntable_drivers/ascii/move_sentence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "imu_io/base/format_number.h"

namespace turncal {
namespace {

std::string fixed(double value, int decimals, bool plus) {
  std::array<char, 400> text{};  // the largest double has 309 digits
  std::snprintf(text.data(), text.size(), plus ? "%+.*f" : "%.*f", decimals, value);
  // "-0.0000" confuses some parsers.
  const std::string number = text.data();
  const bool zero = number.find_first_not_of("-0.") == std::string::npos;
  return zero && number[0] == '-' ? (plus ? "+" : "") + number.substr(1) : number;
}

double grain(int decimals) { return std::pow(10.0, -decimals); }

// From 0 to below a turn, as it is written with so many decimals.
double on_circle(double units, double turn, int decimals) {
  const double remainder = grain(decimals) * std::round((units - turn * std::floor(units / turn)) / grain(decimals));
  return remainder >= turn ? 0.0 : remainder;
}

// What a placeholder asks for, and of which axis.
struct Asked {
  std::string quantity;
  Axis axis;
};
Asked asked_by(const std::string& name, Axis addressed) {
  for (const Axis other : all_axes) {
    const std::string suffix = std::string(".") + to_string(other);
    if (name.ends_with(suffix)) return {name.substr(0, name.size() - suffix.size()), other};
  }
  return {name, addressed};
}

double units_of(const Dialect& dialect, const Asked& asked, const Moves& moves) {
  const DialectAxis& scale = dialect.of(asked.axis);
  const MoveNumbers& move = moves[index(asked.axis)];
  if (asked.quantity == "position") {
    const double units = scale.sign * scale.units_per_degree * (move.position_deg - scale.zero_deg);
    return scale.shorter_way ? on_circle(units, scale.units_per_degree * scale.modulo_deg, dialect.decimals) : units;
  }
  if (asked.quantity == "distance") return scale.sign * scale.units_per_degree * move.distance_deg;
  if (asked.quantity == "rate") return scale.rate_scale * move.rate_degps;
  return scale.acceleration_scale * move.acceleration_degps2;
}

bool is_number(const std::string& quantity) {
  return quantity == "position" || quantity == "distance" || quantity == "rate" || quantity == "acceleration";
}

}  // namespace

std::string filled(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, const Moves& moves) {
  return sentence.fill([&](const std::string& name) -> std::string {
    if (name == "axis") return dialect.of(axis).name;
    const Asked asked = asked_by(name, axis);
    return is_number(asked.quantity) ? fixed(units_of(dialect, asked, moves), dialect.decimals, dialect.plus) : "";
  });
}

Status check_sentences(const Dialect& dialect, Axis axis, const Moves& moves) {
  for (const Exchange& exchange : dialect.of(DialectOperation::move).exchanges) {
    const std::string body = filled(dialect, exchange.send, axis, moves);
    const auto cannot = [&](const std::string& expected) {
      return input_error("the device cannot be told '" + visible(body) + "': expected " + expected);
    };
    if (!exchange.send.match(body)) return cannot("numbers that fit '" + exchange.send.text() + "'");
    for (const std::string& name : exchange.send.names()) {
      const Asked asked = asked_by(name, axis);
      if (asked.axis != axis || (asked.quantity != "rate" && asked.quantity != "acceleration")) continue;
      const double units = units_of(dialect, asked, moves);
      if (!(std::abs(units) >= 0.5 * grain(dialect.decimals)))
        return cannot("number.decimals or a scale with which the " + asked.quantity + " " + format_number(units) +
                      " is not 0");
    }
  }
  return {};
}

Status check_move(const Dialect& dialect, Axis axis, const Moves& moves, double tolerance_deg) {
  TRY(check_sentences(dialect, axis, moves));
  const double scale = dialect.of(axis).units_per_degree;
  for (const Exchange& exchange : dialect.of(DialectOperation::move).exchanges) {
    for (const std::string& name : exchange.send.names()) {
      const Asked asked = asked_by(name, axis);
      if (asked.axis != axis || (asked.quantity != "position" && asked.quantity != "distance")) continue;
      const double units = units_of(dialect, asked, moves);
      const double told = parse_number(fixed(units, dialect.decimals, false)).value_or(0.0);
      if (!(std::abs(told - units) <= tolerance_deg * scale))
        return input_error("number.decimals = " + std::to_string(dialect.decimals) + ": tells " + format_number(units) +
                           " as " + format_number(told) + ": expected an angle told to motion.position_tolerance_deg");
    }
  }
  for (const Exchange& exchange : dialect.of(DialectOperation::status).exchanges) {
    for (const std::string& name : exchange.expect ? exchange.expect->names() : std::vector<std::string>()) {
      const Asked asked = asked_by(name, axis);
      const auto width = static_cast<int>(exchange.expect->width_of(name));
      if (asked.quantity != "position" || asked.axis != axis || width == 0) continue;
      const DialectAxis& circle = dialect.of(axis);
      const double units = circle.modulo_deg > 0.0 ? circle.modulo_deg * scale : units_of(dialect, asked, moves);
      const int whole = static_cast<int>(fixed(units, 0, dialect.plus).size());
      const int decimals = std::max(0, width - whole - 1);  // at most
      if (whole > width || !(0.5 * grain(decimals) <= tolerance_deg * scale))
        return input_error("{" + name + ":" + std::to_string(width) + "} in an answer to status cannot show " +
                           format_number(units) + " to motion.position_tolerance_deg: expected more columns");
    }
  }
  return {};
}

}  // namespace turncal
