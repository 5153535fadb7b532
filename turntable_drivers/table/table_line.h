// The line to a table, serial or TCP: one request and its reply at a time. Every wait has a deadline; after trouble the line is drained.
//
// - The codec (table_codec.h) recognises a reply and judges it.
// - A reply must be complete within reply_timeout_s, whatever else arrives, and must not contain a silence of byte_timeout_s.
// - After trouble (a time-out, a wrong reply, something unexpected) the line is drained until it has been quiet for quiet_s. A line that
//   does not fall silent is closed.
// - A pending stop ends every wait at once (kind aborted). send_at_once() is for the stop itself: it does not drain first, waits at most
//   stop_ack_s, and skips anything but its acknowledgement.
// Single-threaded.
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

// How a stop request interrupts a wait for a device. The station counts requests (in a signal handler). A driver checks the
// count while it waits, gives up, and returns to the station's loop within milliseconds. Sending the stop handles the request.
// The same waits let the station do other checks meanwhile (Turntable::set_meanwhile).
class StopSignal {
 public:
  StopSignal() = default;  // never asked to stop
  explicit StopSignal(const std::atomic<int>* requests)
      : requests_(requests), handled_(requests ? requests->load() : 0) {}
  bool pending() const { return requests_ != nullptr && requests_->load() != handled_; }
  void handled() {
    if (requests_ != nullptr) handled_ = requests_->load();
  }
  void set_meanwhile(std::function<void()> meanwhile) { meanwhile_ = std::move(meanwhile); }
  // To call in every turn of a wait.
  void look_away() const {
    if (meanwhile_) meanwhile_();
  }
  // Returns a predicate for waits elsewhere, to be asked in every turn.
  std::function<bool()> giving_up() const {
    return [this] {
      look_away();
      return pending();
    };
  }
  // Waits for `seconds`, rounded up to milliseconds. False: given up for a stop.
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

inline constexpr double stop_ack_s = 0.025;  // per axis: three axes and all else are within 100 ms of the request

class TableLine {
 public:
  TableLine(TableLinkSettings settings, const StopSignal& stop);  // `stop` must outlive the line
  ~TableLine() { close(); }
  TableLine(const TableLine&) = delete;
  TableLine& operator=(const TableLine&) = delete;

  Status open();  // closes first, so that no descriptor leaks
  void close();
  bool is_open() const { return descriptor_ >= 0; }
  Judgement exchange(const TableRequest& request, LineCodec& codec, AxisReading* reading);
  // Sends a stop; awaits: waits for its acknowledgement.
  Status send_at_once(const TableRequest& request, LineCodec& codec, bool awaits);

 private:
  Status send(const std::string& bytes);
  Result<std::string> await(const TableRequest& request, const LineCodec& codec, const Deadline& deadline,
                            bool at_once);
  Result<bool> receive(double wait_s);  // false: nothing came
  Status drain();
  Error failure(const std::string& what) const;
  Error given_up() const;
  Error hang_up(const std::string& what);

  TableLinkSettings settings_;
  const StopSignal& stop_;
  SerialPort port_;
  int descriptor_ = -1;  // of the port, or our own socket
  std::string heard_;
  bool stale_ = false;  // a late reply may still come
  double last_sent_s_ = 0.0, last_activity_s_ = 0.0;
};

}  // namespace turncal
