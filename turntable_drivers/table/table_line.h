// One line to a table, serial or TCP: a request goes out and its reply comes in, every wait has a deadline, trouble is drained.
//
// - What a reply looks like and whether it is the right one is for the codec to say (table_codec.h).
// - A reply must be there within reply_timeout_s, whatever comes in, and without a silence of byte_timeout_s in it.
// - After trouble (a time-out, a wrong reply, something unexpected) the line is read empty until it has been quiet for quiet_s; one that
//   talks on is closed.
// - A pending stop ends every wait at once (kind aborted); send_at_once() is for the stop itself: it drains nothing first, waits at most
//   stop_ack_s, and skips what is not its acknowledgement.
// One thread.
#pragma once

#include <optional>
#include <string>

#include "calib/types/status.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/serial_port.h"
#include "turntable_drivers/table/stop_signal.h"
#include "turntable_drivers/table/table_codec.h"

namespace turncal {

inline constexpr double stop_ack_s = 0.025;  // three axes: within 100 ms of the request with all else

class TableLine {
 public:
  TableLine(TableLinkSettings settings, const StopSignal& stop);  // `stop` must outlive the line
  ~TableLine() { close(); }
  TableLine(const TableLine&) = delete;
  TableLine& operator=(const TableLine&) = delete;

  Status open();  // closes first: a descriptor is never leaked
  void close();
  bool is_open() const { return descriptor_ >= 0; }
  Verdict exchange(const TableRequest& request, TableCodec& codec, AxisReading* reading);
  // awaits: its acknowledgement.
  Status send_at_once(const TableRequest& request, TableCodec& codec, bool awaits);

 private:
  Status send(const std::string& bytes);
  Result<std::string> await(const TableRequest& request, const TableCodec& codec, const Deadline& deadline,
                            bool at_once);
  Result<bool> receive(double wait_s);  // whether anything came
  Status drain();
  Error failure(const std::string& what) const;
  Error given_up() const;
  Error hang_up(const std::string& what);

  TableLinkSettings settings_;
  const StopSignal& stop_;
  SerialPort port_;
  int descriptor_ = -1;  // of the port, or a socket of our own
  std::string heard_;
  bool stale_ = false;  // a late reply may still come
  double last_sent_s_ = 0.0, last_activity_s_ = 0.0;
};

}  // namespace turncal
