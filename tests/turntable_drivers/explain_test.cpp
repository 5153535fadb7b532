// What `check --explain` prints: the rows of maps, against what is known of them by hand.

#include "tests/said.h"
#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {
namespace {

// Of an axis and an operation, as explained.said has them: all rows, with " / " between, without the numbers of lines. leadshine_pr: 90 deg at 4000
// counts a degree; 10 deg/s are 240 rpm; 41667 ms over 20 deg/s^2. twin: with an offset of pitch and a fault that reads 0.
TEST(Explain, RegistersAndValuesOfAMap) {
  RegisterMap leadshine =
      expect_value(read_register_map(TURNCAL_SOURCE_DIR "/turntable_drivers/modbus/maps/leadshine_pr.map"));
  RegisterMap twin = expect_value(read_register_map(TURNCAL_SOURCE_DIR "/orchestrator/stations/twin.map"));
  twin.axis[1].address_offset = 0x100;
  twin.axis[1].bits[std::size_t(DriveBit::fault)]->active_high = false;
  expect_said("turntable_drivers/explained.said",
              [&](const std::string& map, const std::string& axis, const std::string& operation) {
                std::string text;
                for (const TableRow& row : explain(map == "twin" ? twin : leadshine)) {
                  if (row.operation != operation || row.axis != axis) continue;
                  text += (text.empty() ? "" : " / ") + row.sent + "|" + row.says + "|" + row.answer + "|" + row.source;
                }
                for (std::size_t at; (at = text.find("line ")) != std::string::npos;)
                  text.erase(at, text.find(' ', at + 5) + 1 - at);
                return text;
              });
}

}  // namespace
}  // namespace turncal
