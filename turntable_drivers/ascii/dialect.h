// An ASCII table described in configuration: how sentences are framed, what is sent for each operation, what answer is expected, and
// what a status word means. docs/tables.md lists the keys; turntable_drivers/ascii/dialects/ has some dialects.
//
// Every operation is a list of exchanges, done once for the table or for each axis in turn. An exchange is a sentence
// and, if the device answers, a template of the answer; any other answer is an error. Placeholders: {axis}; for the axis
// addressed {position} {distance} {rate} {acceleration} {status}; for a given axis {position.heading} and so on, if the table takes or
// reports all three axes in one sentence.
// An unknown status means not enabled, not arrived, moving.
//
// An answer may have several lines (\n in OP.N.expect), each in a frame of its own.
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
// A template is literal text with placeholders in braces: ":DEM:POS {axis},{position}". Matching is anchored at both ends. A
// placeholder takes one or more characters except blanks, commas and line breaks; {*} takes anything. {position:10} is exactly 10 characters
// wide: it is matched with blanks around the number, and filled in with zeros after the sign. Driver and twin share the
// templates.

class SentenceTemplate {
 public:
  // Empty: an unbalanced brace, an empty name, an invalid width, or a placeholder without a width directly before another.
  static std::optional<SentenceTemplate> parse(std::string_view text);
  std::string fill(const std::function<std::string(const std::string& name)>& value) const;
  // Returns the values by name; empty when the sentence does not match.
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
// Returns two upper-case hexadecimal digits (four for a CRC) over all characters of the body.
std::string check_digits(std::string_view body, SentenceCheck check, const CrcParameters& crc = {});

// Replaces \r \n \t \\ by the characters; empty for anything else after a backslash.
std::optional<std::string> unescaped(std::string_view text);

// ---- the dialect ----

struct DialectLink : TableLinkSettings {
  std::string terminator_out = "\r";
  std::string terminator_in = "\n";
  std::string prompt;                  // sent by the device when it is ready, at the end of every answer
  bool echo = false;                   // the device repeats each sentence before its answer
  std::string echo_terminator = "\r";  // end of the echo
  std::string prefix;                  // before the body of every sentence, both ways
  SentenceCheck check = SentenceCheck::none;
  CrcParameters crc;             // for crc16
  std::string check_mark = "*";  // between body and check digits
};
// Reads the keys link.*: serial or tcp.
void read_dialect_link(KeyValueFile& file, DialectLink& link);
// Returns prefix, body and check, without the terminator.
std::string frame_of(const DialectLink& link, const std::string& body);
// Returns the body of a frame. An error: a wrong prefix, a wrong or missing check.
Result<std::string> body_of(const DialectLink& link, const std::string& frame);

struct Exchange {
  SentenceTemplate send;
  std::optional<SentenceTemplate> expect;
};

struct DialectSteps {
  bool each_axis = false;  // false: once for the table; a move is always for one axis
  std::vector<Exchange> exchanges;
};
// Returns the dialect's key of an operation.
std::string key_of(TableOperation operation);

struct DialectAxis : AxisScale {
  std::string name;
};

// The flags of a status, by code or by bit.
struct DialectStatus {
  bool by_bits = false;
  int base = 10;  // base of the number that holds the bits
  std::map<std::string, std::vector<DriveBit>> codes;
  std::array<std::uint32_t, drive_bit_count> mask{};  // any bit of it sets the flag; 0: not reported
  std::array<bool, drive_bit_count> active_low{};
  // True if the device reports the flag at all; otherwise it follows from what was commanded.
  bool reports(DriveBit bit) const;
};

struct Dialect : TableDescription {
  DialectLink link;
  std::array<DialectAxis, 3> axis;
  int decimals = 4;
  bool plus = false;  // numbers >= 0 have a sign, too
  std::array<DialectSteps, table_operation_count> steps;
  std::vector<std::string> errors;  // an answer that contains one of these is a device error
  DialectStatus status;

  const DialectSteps& of(TableOperation operation) const { return steps[index(operation)]; }
  const DialectAxis& of(Axis which) const { return axis[index(which)]; }
};

Result<Dialect> read_dialect(const std::string& path);
Result<Dialect> parse_dialect(const std::string& text, const std::string& file_name);

// Returns what a user should know about a valid dialect before a run; empty if nothing.
std::string caution_of(const Dialect& dialect);

// Returns the flags of a status word: true, false, or not reported. For an unknown word moving is true, other reported flags are false.
AxisReading flags_of(const DialectStatus& status, const std::string& word);
// The quantity that a placeholder stands for, and its axis.
struct Asked {
  std::optional<MoveQuantity> number;  // empty: not a quantity
  bool status = false;
  Axis axis = Axis::heading;
};
Asked asked_by(const std::string& name, Axis addressed);

// Returns a number with so many decimals; -0 has no sign.
std::string sentence_number(double value, int decimals, bool plus = false);
// Returns the sentence as it is sent to this axis.
std::string filled(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, const Moves& moves);
// Returns an error when a number does not fit its width, or a rate or acceleration is rounded too coarsely.
Status check_sentences(const Dialect& dialect, Axis axis, const Moves& moves);
// Checks the same, and that the angle is sent, and can be read, to within the tolerance.
Status check_move(const Dialect& dialect, Axis axis, const Moves& moves, double tolerance_deg);

// Returns what the driver sends and reads, sentence by sentence.
std::vector<TableRow> explain(const Dialect& dialect);

// dialect_check.cpp: rejects in the file what a table could not work with, beyond the checks of each key: its status, the width of its
// columns, its texts.
void check_dialect(KeyValueFile& file, const Dialect& dialect);

// Finds sentences with an unintended effect: a `prepare`, `identify`, `status`, `stop`, `abort` or `clear_fault` that sends what
// enables, homes or moves a drive, and axes that one move would move together.
//
// The trigger of `enable` and `home` is their last sentence that is not a question (no `?`). `move` has that one and every
// sentence with {position} or {distance}. A sentence may hold several commands separated by semicolons; each one is compared, with the
// names of all axes filled in.
std::optional<Clash> sentence_clash(const Dialect& dialect);
// True if a move sends every axis its own target.
bool moves_all(const Dialect& dialect);

}  // namespace turncal
