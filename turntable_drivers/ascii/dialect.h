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
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "imu_io/base/crc.h"
#include "turntable_drivers/table/table_codec.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

// Sentences of an ASCII dialect: templates that are filled in or matched, checksums, and control characters written as \r \n.
// Pure functions.
//
// A template is literal text with placeholders in braces: ":DEM:POS {axis},{position}". Matching is anchored at both ends; a
// placeholder takes at least one character and no blank, comma or line break, {*} takes anything. {position:10} is exactly 10 characters
// wide: with blanks around it when it is matched, filled up with zeros after the sign when it is filled in. The same template is what the driver
// expects and what the twin says.

class SentenceTemplate {
 public:
  // Empty: a brace without its partner, an empty name, a width that is none, or a placeholder without a width right before another.
  static std::optional<SentenceTemplate> parse(std::string_view text);
  std::string fill(const std::function<std::string(const std::string& name)>& value) const;
  // The values by name; empty when it does not match.
  std::optional<std::map<std::string, std::string>> match(std::string_view sentence) const;
  bool has(std::string_view name) const;
  std::vector<std::string> names() const;
  std::size_t width_of(std::string_view name) const;  // 0: any
  const std::string& text() const { return text_; }
  int lines() const;  // of a sentence that matches

 private:
  struct Piece {
    std::string literal;
    std::string name;       // empty: literal
    std::size_t width = 0;  // 0: any
  };
  std::string text_;
  std::vector<Piece> pieces_;
};

enum class SentenceCheck { none, sum8, exclusive_or, crc16 };
// Two hexadecimal digits, four of a CRC, upper case, over all characters of the body.
std::string check_digits(std::string_view body, SentenceCheck check, const CrcParameters& crc = {});

// \r \n \t \\ as characters; empty for anything else after a backslash.
std::optional<std::string> unescaped(std::string_view text);

// ---- the dialect ----

struct DialectLink : TableLinkSettings {
  std::string terminator_out = "\r";
  std::string terminator_in = "\n";
  std::string prompt;                  // what the device says when it is ready; an answer ends with it
  bool echo = false;                   // the device repeats what it is sent, before its answer
  std::string echo_terminator = "\r";  // what the echo ends with
  std::string prefix;                  // before the body of every sentence, both ways
  SentenceCheck check = SentenceCheck::none;
  CrcParameters crc;             // of crc16
  std::string check_mark = "*";  // between body and check digits
};
// link.* of a file: serial or tcp.
void read_dialect_link(KeyValueFile& file, DialectLink& link);
// Prefix, body and check; without the terminator.
std::string frame_of(const DialectLink& link, const std::string& body);
// And back. An error: a wrong prefix, a wrong or missing check.
Result<std::string> body_of(const DialectLink& link, const std::string& frame);

struct Exchange {
  SentenceTemplate send;
  std::optional<SentenceTemplate> expect;
};

struct DialectSteps {
  bool each_axis = false;  // else once for the table; a move is always of one axis
  std::vector<Exchange> exchanges;
};
// What a dialect calls an operation.
std::string key_of(TableOperation operation);

struct DialectAxis : AxisScale {
  std::string name;
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
  std::array<DialectSteps, table_operation_count> steps;
  std::vector<std::string> errors;  // an answer that contains one of these is an error of the device
  DialectStatus status;

  const DialectSteps& of(TableOperation operation) const { return steps[index(operation)]; }
  const DialectAxis& of(Axis which) const { return axis[index(which)]; }
};

Result<Dialect> read_dialect(const std::string& path);
Result<Dialect> parse_dialect(const std::string& text, const std::string& file_name);

// What a user should know before a run although the dialect is good; empty: nothing.
std::string caution_of(const Dialect& dialect);

// The flags of a status word: true, false, or not told. Unknown: every flag that is told is false, moving and fault excepted.
AxisReading flags_of(const DialectStatus& status, const std::string& word);
// What a placeholder asks for, and of which axis.
struct Asked {
  std::optional<MoveQuantity> number;  // empty: it asks for none
  bool status = false;
  Axis axis = Axis::heading;
};
Asked asked_by(const std::string& name, Axis addressed);

// A sentence as it is sent to this axis.
std::string filled(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, const Moves& moves);
// An error: a number does not fit its column, or a rate or an acceleration rounds to nothing.
Status check_sentences(const Dialect& dialect, Axis axis, const Moves& moves);
// The same; and the angle is told, and can be read, to the tolerance.
Status check_move(const Dialect& dialect, Axis axis, const Moves& moves, double tolerance_deg);

// What the driver sends and reads, sentence by sentence.
std::vector<TableRow> explain(const Dialect& dialect);

// dialect_check.cpp: remembers in the file what a table could not work with, beyond what each key is checked for: its status, the width of its
// columns, its own words.
void check_dialect(KeyValueFile& file, const Dialect& dialect);

// Sentences that would do more than they are called: a `prepare`, `identify`, `status`, `stop`, `abort` or `clear_fault` that sends what
// enables a drive, homes or moves it, and axes that one move would move together.
//
// What starts something is the last sentence of `enable` and `home` that is no question (with a `?`), and of `move` that one and every
// sentence with {position} or {distance}. A sentence may hold several commands, with semicolons between them; each is compared, with the
// names of all axes filled in.
std::optional<Clash> sentence_clash(const Dialect& dialect);
// A move tells each axis its own place.
bool moves_all(const Dialect& dialect);

}  // namespace turncal
