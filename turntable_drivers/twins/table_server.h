// TableServer: puts a DriveTwin on a line, Modbus TCP or (on a pseudo-terminal) RTU, for a rehearsal with real links (`turncal twin`)
// and for the tests of the driver. line_server.h says how it is run.
#pragma once

#include <functional>

#include "turntable_drivers/twins/drive_twin.h"
#include "turntable_drivers/twins/line_server.h"

namespace turncal {

class TableServer : public LineServer {
 public:
  explicit TableServer(DriveTwin& twin) : twin_(twin) {}  // the twin must outlive the server
  std::function<void(const ModbusRequest&, AnswerPlan&)> disturb;

 private:
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  void tick() override { twin_.tick(); }

  DriveTwin& twin_;
};

}  // namespace turncal
