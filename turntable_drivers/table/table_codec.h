// What a table's language has to do for the driver (described_turntable.h) and its line (table_line.h): make a request of a step, say
// where a reply ends, and judge what it says. Registers: turntable_drivers/modbus/register_codec.h; sentences:
// turntable_drivers/ascii/sentence_codec.h.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/axis.h"
#include "calib/types/status.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {

// A step of an operation, encoded.
struct TableRequest {
  TableOperation operation = TableOperation::status;
  Axis axis = Axis::heading;
  std::size_t step = 0;
  std::string body = {};   // without the frame
  std::string bytes = {};  // as it goes over the wire
  bool answered = true;    // else a stop waits for nothing
};

// What an axis says of itself at one reading.
struct AxisReading {
  double position_deg = std::numeric_limits<double>::quiet_NaN();  // not unwrapped
  std::optional<double> rate_degps;
  std::array<std::optional<bool>, drive_bit_count> flags;  // empty: the device does not tell
  bool known = true;                                       // false: a status that the description does not have
  std::uint32_t raw = 0;
  std::string text;
  std::optional<bool> operator[](DriveBit bit) const { return flags[index(bit)]; }
};

// What is made of a reply.
struct Judgement {
  Judgement() = default;
  Judgement(Error error) : status(std::move(error)) {}
  Status status;         // an error: not what was asked for
  bool stale = false;    // the line has to be read empty
  bool again = true;     // a reading may be repeated,
  double pause_s = 0.0;  // after this
  bool alive = false;    // the device answered: its link is not lost
};

// An angle that a reading would be if the description were otherwise.
struct OtherReading {
  double position_deg = 0.0;
  std::string settings;
};

// What a line (table_line.h) has to be told of a language, of whatever speaks it.
class LineCodec {
 public:
  virtual ~LineCodec() = default;
  // How many characters of `heard` are the reply; none: it is not whole yet. What belongs to earlier requests is taken off. at_once: whatever
  // stands before the acknowledgement of a stop may be taken off.
  virtual std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const = 0;
  // heard: what came after the reply. reading: what a status adds to; text of an identification.
  virtual Judgement decode(const TableRequest& request, const std::string& reply, std::string& heard,
                           AxisReading* reading) = 0;
  virtual bool acknowledges(const TableRequest& request, const std::string& reply) const = 0;  // a stop, at once
  // Whether something that no request asked for is there.
  virtual bool has_unexpected(std::string& heard) const = 0;
};

class TableCodec : public LineCodec {
 public:
  virtual std::size_t steps(TableOperation operation) const = 0;
  virtual bool once(TableOperation operation) const = 0;  // for the table, not for each axis
  virtual double pause_s(TableOperation, std::size_t /*step*/) const { return 0.0; }  // above 0: a step that is a pause
  virtual const AxisScale& scale(Axis axis) const = 0;
  virtual bool tells(DriveBit bit) const = 0;
  virtual bool moves_all() const = 0;                          // a move tells the targets of all axes
  virtual bool searches() const { return true; }               // its zero has to be looked for
  virtual double heartbeat_s() const { return 0.0; }           // how often; 0: none
  virtual const char* kind() const = 0;                        // "map", "dialect"
  virtual const char* implausible() const { return nullptr; }  // what a position beyond belief should make one look at

  // An error: the device cannot be told these numbers.
  virtual Result<TableRequest> encode(TableOperation operation, Axis axis, std::size_t step, const Moves& moves) = 0;
  // A message about a request; `whose`: "table NAME: AXIS: ".
  virtual std::string message(const TableRequest& request, const std::string& whose, const std::string& what) const = 0;
  // For commissioning: what else the last reading of the axis could be.
  virtual std::vector<OtherReading> other_readings(Axis axis, const AxisReading& reading) const = 0;
  virtual const char* expected_scale() const = 0;  // where none of them fits
  virtual const char* expected_angle() const = 0;  // where several fit
};

}  // namespace turncal
