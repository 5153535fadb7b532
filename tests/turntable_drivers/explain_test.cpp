// What `check --explain` prints: the rows of maps, against what is known of them by hand.

#include "tests/turntable_drivers/served_twin.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {
namespace {

std::string text_of(const TableRow& row) {
  return row.operation + "|" + row.axis + "|" + row.sent + "|" + row.says + "|" + row.answer + "|" + row.source;
}

// All rows of an operation of an axis, a line each.
std::string rows_of(const std::vector<TableRow>& rows, const std::string& operation, const std::string& axis) {
  std::string text;
  for (const TableRow& row : rows)
    if (row.operation == operation && row.axis == axis) text += text_of(row) + "\n";
  return text;
}

std::string without_lines(std::string text) {
  for (std::size_t at = text.find("line "); at != std::string::npos; at = text.find("line ", at))
    text.erase(at, text.find(' ', at + 5) + 1 - at);
  return text;
}

TEST(Explain, RegistersAndValuesOfAMap) {
  const Result<RegisterMap> map =
      good(read_register_map(TURNCAL_SOURCE_DIR "/turntable_drivers/modbus/maps/leadshine_pr.map"));
  const std::vector<TableRow> rows = explain(*map);
  EXPECT_EQ(without_lines(rows_of(rows, "enable", "pitch")),
            "enable|pitch|unit 2, function 6, register 15 (0x000F)|u16 1 (0x0001)|the same|[manual]\n");
  // 90 deg at 4000 counts a degree; 10 deg/s are 240 rpm; 41667 ms over 20 deg/s^2.
  EXPECT_EQ(without_lines(rows_of(rows, "move", "roll")),
            "move|roll|unit 3, function 16, register 25088 (0x6200), 8 registers|u16 1 (0x0001)|unit 3, function 16, "
            "register 25088 (0x6200), 8 registers|[manual]\n"
            "move|roll|  its register 25089 (0x6201)|s32 360000 (0x0005 0x7E40), position: 4000 per deg, 0 at 0 "
            "deg||[manual]\n"
            "move|roll|  its register 25091 (0x6203)|u16 240 (0x00F0), rate: 24 per deg/s||[manual]\n"
            "move|roll|  its register 25092 (0x6204)|u16 2083 (0x0823), acceleration: 41667 / (deg/s^2), a ramp "
            "time||[manual]\n"
            "move|roll|  its register 25093 (0x6205)|u16 2083 (0x0823), acceleration: 41667 / (deg/s^2), a ramp "
            "time||[manual]\n"
            "move|roll|  its register 25094 (0x6206)|u16 0 (0x0000)||[manual]\n"
            "move|roll|  its register 25095 (0x6207)|u16 16 (0x0010)||[manual]\n");
  const std::string status = rows_of(rows, "status", "heading");
  EXPECT_SAYS(status, "unit 1, function 3, register 4099 (0x1003)||2 bytes");
  EXPECT_SAYS(status, "register 4099 (0x1003)|enabled: mask 0x0002, set|");
  for (const char* const operation : {"home", "stop", "abort", "fault reset"})
    EXPECT_FALSE(rows_of(rows, operation, "heading").empty()) << operation;
}

TEST(Explain, HeartbeatOffsetAndPolarity) {
  const Result<RegisterMap> read = good(read_register_map(TURNCAL_SOURCE_DIR "/orchestrator/stations/twin.map"));
  RegisterMap map = *read;
  map.axis[1].address_offset = 0x100;
  map.axis[1].bits[std::size_t(DriveBit::fault)]->active_high = false;
  const std::vector<TableRow> rows = explain(map);
  EXPECT_SAYS(rows_of(rows, "heartbeat", "pitch"), "register 320 (0x0140)|u16, another number each time, every 2 s");
  EXPECT_SAYS(rows_of(rows, "status", "pitch"), "register 272 (0x0110)|fault: mask 0x0010, clear|");
}

}  // namespace
}  // namespace turncal
