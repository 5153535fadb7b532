#include "turntable_drivers/twins/modbus_server.h"

#include <algorithm>

namespace turncal {

std::optional<AnswerPlan> ModbusServer::next_answer(std::vector<std::uint8_t>& bytes) {
  const bool header = tcp() && !twin_.map().link.rtu_frames;
  const std::optional<ModbusRequest> request = next_request(bytes, header);
  if (!request) return {};
  const auto& axes = twin_.map().axis;
  const bool ours =
      std::any_of(axes.begin(), axes.end(), [&](const MapAxis& axis) { return axis.unit == request->unit; });
  if (!ours) return AnswerPlan();  // another drive on the bus: silence
  ModbusTwin::Answer answer;
  {
    const std::lock_guard lock(mutex);
    answer = twin_.handle(*request);
  }
  const bool is_read = request->function == 3 || request->function == 4;
  AnswerPlan plan;
  plan.pieces.push_back({answer.exception != 0 ? exception_reply(*request, answer.exception, header)
                         : is_read             ? read_reply(*request, answer.values, header)
                                               : write_reply(*request, header),
                         0.0});
  if (disturb) disturb(*request, plan);
  return plan;
}

}  // namespace turncal
