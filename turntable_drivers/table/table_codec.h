// A codec: the protocol of a table for its driver (described_turntable.h) and its line (table_line.h). It encodes steps as requests, finds
// the end of a reply, and judges it. Registers: turntable_drivers/modbus/register_codec.h; sentences:
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

// An encoded step of an operation.
struct TableRequest {
  TableOperation operation = TableOperation::status;
  Axis axis = Axis::heading;
  std::size_t step = 0;
  std::string body = {};   // without the frame
  std::string bytes = {};  // as sent over the line
  bool answered = true;    // false: a stop does not wait for an answer
};

// What one reading of an axis reports.
struct AxisReading {
  double position_deg = std::numeric_limits<double>::quiet_NaN();  // not unwrapped
  std::optional<double> rate_degps;
  std::array<std::optional<bool>, drive_bit_count> flags;  // empty: not reported
  bool known = true;                                       // false: the description does not have this status
  std::uint32_t raw = 0;
  std::string text;
  std::optional<bool> operator[](DriveBit bit) const { return flags[index(bit)]; }
};

// The judgement of a reply.
struct Judgement {
  Judgement() = default;
  Judgement(Error error) : status(std::move(error)) {}
  Status status;         // an error: not a valid reply to the request
  bool stale = false;    // the line must be drained
  bool again = true;     // a reading may be repeated
  double pause_s = 0.0;  // wait before repeating
  bool alive = false;    // the device answered: its link is not lost
};
inline Judgement garbled(const std::string& what) {
  Judgement judgement = device_error(what);
  judgement.stale = true;
  return judgement;
}

// The angle that a reading would give with other settings of the description.
struct OtherReading {
  double position_deg = 0.0;
  std::string settings;
};

// The part of a protocol that a line (table_line.h) needs, for any device.
class LineCodec {
 public:
  virtual ~LineCodec() = default;
  // Returns the length of the reply at the front of `heard`; none: it is incomplete. Removes what belongs to earlier requests. at_once:
  // may also remove anything before the acknowledgement of a stop.
  virtual std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const = 0;
  // heard: the bytes after the reply. reading: receives the values of a status; its text that of an identification.
  virtual Judgement decode(const TableRequest& request, const std::string& reply, std::string& heard,
                           AxisReading* reading) = 0;
  virtual bool acknowledges(const TableRequest& request, const std::string& reply) const = 0;  // for a stop sent now
  // True if there is something that no request asked for.
  virtual bool has_unexpected(std::string& heard) const = 0;
};

class TableCodec : public LineCodec {
 public:
  virtual std::size_t steps(TableOperation operation) const = 0;
  virtual bool once(TableOperation operation) const = 0;  // once for the table, not for each axis
  virtual double pause_s(TableOperation, std::size_t /*step*/) const { return 0.0; }  // > 0: the step is a pause
  virtual const AxisScale& scale(Axis axis) const = 0;
  virtual bool tells(DriveBit bit) const = 0;
  virtual bool moves_all() const = 0;                          // a move sends the targets of all axes
  virtual bool searches() const { return true; }               // homing must search for the zero
  virtual double heartbeat_s() const { return 0.0; }           // period in s; 0: none
  virtual const char* kind() const = 0;                        // "map", "dialect"
  virtual const char* implausible() const { return nullptr; }  // what to check after an implausible position

  // Encodes a step. An error: the device cannot take these numbers.
  virtual Result<TableRequest> encode(TableOperation operation, Axis axis, std::size_t step, const Moves& moves) = 0;
  // Returns a message about a request; `whose`: "table NAME: AXIS: ".
  virtual std::string message(const TableRequest& request, const std::string& whose, const std::string& what) const = 0;
  // For commissioning: other meanings that the last reading of the axis could have.
  virtual std::vector<OtherReading> other_readings(Axis axis, const AxisReading& reading) const = 0;
  virtual const char* expected_scale() const = 0;  // advice if none of them fits
  virtual const char* expected_angle() const = 0;  // advice if several fit
};

}  // namespace turncal
