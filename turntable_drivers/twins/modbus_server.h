// ModbusServer: puts a ModbusTwin on a line, Modbus TCP or (on a pseudo-terminal) RTU, for a rehearsal with real links (`turncal twin`)
// and for the tests of the driver. line_server.h says how it is run.
#pragma once

#include <functional>

#include "turntable_drivers/twins/line_server.h"
#include "turntable_drivers/twins/modbus_twin.h"

namespace turncal {

class ModbusServer : public LineServer {
 public:
  explicit ModbusServer(ModbusTwin& twin) : twin_(twin) {}  // the twin must outlive the server
  std::function<void(const ModbusRequest&, AnswerPlan&)> disturb;

 private:
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  void tick() override { twin_.tick(); }

  ModbusTwin& twin_;
};

}  // namespace turncal
