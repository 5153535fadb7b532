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

#include <poll.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <string>

#include "calib/types/status.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/serial_port.h"
#include "turntable_drivers/table/table_codec.h"

namespace turncal {

// How a request to stop cuts a wait for a device short: the station counts requests (from a signal handler), a driver looks at the
// count while it waits, gives the wait up, and is back in the station's loop within milliseconds. Sending the stop handles it.
// The same waits let the station look at what else goes on meanwhile (Turntable::set_meanwhile).
class StopSignal {
 public:
  StopSignal() = default;  // never asked
  explicit StopSignal(const std::atomic<int>* requests)
      : requests_(requests), handled_(requests ? requests->load() : 0) {}
  bool pending() const { return requests_ != nullptr && requests_->load() != handled_; }
  void handled() {
    if (requests_ != nullptr) handled_ = requests_->load();
  }
  void set_meanwhile(std::function<void()> meanwhile) { meanwhile_ = std::move(meanwhile); }
  // Once in every turn of a wait.
  void look_away() const {
    if (meanwhile_) meanwhile_();
  }
  // For waits elsewhere: to be asked in every turn of one.
  std::function<bool()> giving_up() const {
    return [this] {
      look_away();
      return pending();
    };
  }
  // Waits so long, rounded up to milliseconds. False: given up for a stop.
  bool pause(double seconds) const {
    for (const Deadline deadline(seconds); !deadline.passed();) {
      if (pending()) return false;
      look_away();
      ::poll(nullptr, 0, std::min(deadline.left_ms(), longest_look_away_ms));
    }
    return !pending();
  }

  static constexpr int longest_look_away_ms = 10;

 private:
  const std::atomic<int>* requests_ = nullptr;
  int handled_ = 0;
  std::function<void()> meanwhile_;
};

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
  Judgement exchange(const TableRequest& request, LineCodec& codec, AxisReading* reading);
  // awaits: its acknowledgement.
  Status send_at_once(const TableRequest& request, LineCodec& codec, bool awaits);

 private:
  Status send(const std::string& bytes);
  Result<std::string> await(const TableRequest& request, const LineCodec& codec, const Deadline& deadline,
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
