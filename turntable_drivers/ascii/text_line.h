// One line to an ASCII device, serial or TCP: sentences framed as the dialect says, every wait with a deadline, trouble drained.
//
// - Frame: prefix + body + (check_mark + two check digits) + terminator. An answer with a wrong prefix, a wrong or missing check, or
//   more characters after it than there should be is an error.
// - What has arrived before a sentence is sent is thrown away, so that no old answer is taken for a new one; after trouble the
//   line is read empty until it has been quiet for quiet_s; one that talks on is closed (longest_drain).
// - An answer, echo and all its lines, must be there within reply_timeout_s, whatever comes in.
// - A pending stop ends every wait at once (kind aborted); send_at_once() is for the stop itself.
// One thread.
#pragma once

#include <optional>
#include <string>

#include "calib/types/status.h"
#include "imu_io/base/clock.h"
#include "imu_io/lines/serial_port.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/stop_signal.h"

namespace turncal {

// Prefix, body and check; without the terminator.
std::string frame_of(const DialectLink& link, const std::string& body);

class TextLine {
 public:
  TextLine(DialectLink link, const StopSignal& stop);  // `stop` must outlive the line
  ~TextLine();
  TextLine(const TextLine&) = delete;
  TextLine& operator=(const TextLine&) = delete;

  Status open();  // closes first
  void close();
  bool is_open() const { return descriptor_ >= 0; }
  // Sends the body, waits for an answer of so many lines and returns their bodies with \n between; 0: "" (after the prompt, if any).
  Result<std::string> exchange(const std::string& body, int lines);
  // The same for a stop: no drain, at most timeout_s, and answers that do not match are skipped.
  Status send_at_once(const std::string& body, const std::optional<SentenceTemplate>& expect, double timeout_s);

 private:
  Status write(const std::string& body);
  Result<std::string> read_until(const std::string& end, const Deadline& deadline, bool at_once);  // without the end
  Result<std::string> bodies_of(const std::string& frames, int lines);  // that stood before a prompt
  Result<std::string> body_of(std::string frame) const;
  Status receive_some(double wait_s, bool& any);  // into buffer_
  Status drain();
  Error failure(const std::string& what) const;
  Error given_up() const;
  Error hang_up(const std::string& what);

  DialectLink link_;
  const StopSignal& stop_;
  SerialPort port_;
  int descriptor_ = -1;  // of the port, or a socket of our own
  std::string buffer_;
  bool stale_ = false;
  double last_sent_s_ = 0.0;
};

}  // namespace turncal
