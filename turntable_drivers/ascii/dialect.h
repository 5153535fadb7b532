// An ASCII table described in configuration: how sentences are framed, what is sent for each operation, what is expected back, and
// what a status word means. docs/tables.md lists the keys; turntable_drivers/ascii/dialects/ has some.
//
// Every operation is a list of exchanges, done for the table as a whole or for one axis after another. An exchange is a sentence
// and, where the device answers, what the answer must look like; anything else is an error. Placeholders: {axis}; of the axis
// addressed {position} {distance} {rate} {acceleration} {status}; of any axis {position.heading} and so on, for tables that take or tell all
// three in one sentence.
// A status that the map does not know means: not enabled, not arrived, moving.
//
// An answer may have several lines (\n in OP.N.expect), each framed as one.
// Not modelled: binary answers, unsolicited messages.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/lines/serial_port.h"
#include "turntable_drivers/ascii/sentence.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

struct DialectLink {
  bool tcp = false;
  std::string address;
  SerialSettings serial;  // of a serial line: rate, bits, parity
  std::string terminator_out = "\r";
  std::string terminator_in = "\n";
  std::string prompt;                  // what the device says when it is ready; an answer ends with it
  bool echo = false;                   // the device repeats what it is sent, before its answer
  std::string echo_terminator = "\r";  // what the echo ends with
  std::string prefix;                  // before the body of every sentence, both ways
  SentenceCheck check = SentenceCheck::none;
  CrcParameters crc;             // of crc16
  std::string check_mark = "*";  // between body and check digits
  double reply_timeout_s = 1.0;
  double quiet_s = 0.5;
  double gap_s = 0.0;  // between a sentence and the next
  int read_retries = 2;
};

struct Exchange {
  SentenceTemplate send;
  std::optional<SentenceTemplate> expect;
};
enum class DialectOperation { prepare, identify, enable, home, move, status, stop, abort, clear_fault };
inline constexpr int dialect_operation_count = 9;
const char* to_string(DialectOperation operation);

struct DialectSteps {
  bool each_axis = false;  // else once for the table; a move is always of one axis
  std::vector<Exchange> exchanges;
};

struct DialectAxis {
  std::string name;
  int sign = 1;
  double zero_deg = 0.0;
  double units_per_degree = 1.0;
  double modulo_deg = 0.0;  // 0: positions are cumulative; 360: the device tells a circle only
  bool shorter_way =
      false;  // of a circle: it takes positions of the circle and goes there the shorter way; else distances
  double rate_scale = 1.0;  // units of a commanded rate for 1 deg/s
  double measured_rate_scale = 1.0;
  double acceleration_scale = 1.0;
};

// Flags of a status: by value, or by bit.
struct DialectStatus {
  bool by_bits = false;
  int base = 10;  // of bits, when parsed as a number
  std::map<std::string, std::vector<DriveBit>> codes;
  std::array<std::uint32_t, drive_bit_count> mask{};  // any bit of it says the flag; 0: not told
  std::array<bool, drive_bit_count> active_low{};
  // What the device can tell at all; the rest is known from what was commanded.
  bool reports(DriveBit bit) const;
};

struct Dialect : TableDescription {
  DialectLink link;
  std::array<DialectAxis, 3> axis;
  int decimals = 4;
  bool plus = false;  // numbers that are not negative have a sign, too
  std::array<DialectSteps, dialect_operation_count> steps;
  std::vector<std::string> errors;  // an answer that contains one of these is an error of the device
  DialectStatus status;

  const DialectSteps& of(DialectOperation operation) const { return steps[static_cast<std::size_t>(operation)]; }
  const DialectAxis& of(Axis which) const { return axis[static_cast<std::size_t>(which)]; }
};

Result<Dialect> read_dialect(const std::string& path);
Result<Dialect> parse_dialect(const std::string& text, const std::string& file_name);

// What a user should know before a run although the dialect is good; empty: nothing.
std::string caution_of(const Dialect& dialect);

// The flags of a status word: true, false, or not told. Unknown: every flag that is told is false, moving and fault excepted.
struct DialectFlags {
  std::array<std::optional<bool>, drive_bit_count> flag;
  bool known = true;
  std::uint32_t raw = 0;
  std::optional<bool> operator[](DriveBit bit) const { return flag[static_cast<std::size_t>(bit)]; }
};
DialectFlags flags_of(const DialectStatus& status, const std::string& word);
// The other way round, for the twin: the word that says these flags, or comes closest.
std::string word_of(const DialectStatus& status, const std::array<bool, drive_bit_count>& flags);

}  // namespace turncal
