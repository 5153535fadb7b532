#include "turntable_drivers/modbus/move_words.h"

#include <cmath>

#include "imu_io/base/format_number.h"

namespace turncal {

Result<std::vector<std::uint16_t>> words_of(const RegisterMap& map, const WriteStep& step, Axis axis,
                                            const Moves& moves) {
  std::vector<std::uint16_t> words;
  for (const WriteOperand& operand : step.operands) {
    const Axis which = operand.of_axis.value_or(axis);
    const MapAxis& scale = map.of(which);
    const MoveNumbers& numbers = moves[index(which)];
    double value = operand.constant;
    switch (operand.kind) {
      case WriteOperand::Kind::constant: break;
      case WriteOperand::Kind::axis: value = scale.code; break;
      case WriteOperand::Kind::position: value = counts_of(scale, numbers.position_deg); break;
      case WriteOperand::Kind::distance: value = scale.signed_counts_per_degree() * numbers.distance_deg; break;
      case WriteOperand::Kind::rate: value = scale.rate_scale * numbers.rate_degps; break;
      case WriteOperand::Kind::acceleration:
        value = map.acceleration_is_ramp_time ? scale.acceleration_scale / numbers.acceleration_degps2
                                              : scale.acceleration_scale * numbers.acceleration_degps2;
        break;
    }
    const std::optional<Words> encoded = encode_words(value, operand.type, map.layout);
    const bool of_motion = operand.kind == WriteOperand::Kind::rate || operand.kind == WriteOperand::Kind::acceleration;
    const bool vanishes = of_motion && !is_floating(operand.type) && std::round(value) == 0.0;
    if (!encoded || vanishes) {
      return input_error("the drive cannot be told " + format_number(value) + " in register " +
                         std::to_string(step.address));
    }
    words.insert(words.end(), encoded->span().begin(), encoded->span().end());
  }
  return words;
}

Status check_move(const RegisterMap& map, Axis axis, const Moves& moves) {
  for (const WriteStep& step : map.list(DriveOperation::move)) {
    if (const auto words = words_of(map, step, axis, moves); !words)
      return input_error("write.move: " + words.error().message);
  }
  const MapAxis& scale = map.of(axis);
  const MoveNumbers& numbers = moves[index(axis)];
  const auto reads = [&](const RegisterField& field, double value) {
    return encode_words(value, field.type, map.layout).has_value();
  };
  const double counts = counts_of(scale, numbers.position_deg), rate = scale.measured_rate_scale * numbers.rate_degps;
  if (scale.modulo_deg == 0.0 && !reads(scale.position, counts))
    return input_error("position.type: its register cannot read " + format_number(counts));
  if (scale.rate && !reads(*scale.rate, rate))
    return input_error("rate.type: its register cannot read " + format_number(rate));
  return {};
}

}  // namespace turncal
