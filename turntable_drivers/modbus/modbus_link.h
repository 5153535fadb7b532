// One Modbus line (TCP or RTU) through libmodbus: requests with deadlines, every reply checked, trouble drained.
//
// libmodbus frames and checks CRCs; the waiting, the retries and the comparison of reply and request are here, because libmodbus
// accepts a late answer to another request as good, and does not let a stop interrupt a wait:
// - A reply must come from the unit, be of the function, and have exactly the length or the address asked for; over TCP it must
//   carry the request's transaction number too (frames of earlier ones are skipped). Bytes after it are trouble, but over TCP a
//   whole frame of a transaction before, which gateways send again: it is dropped. RTU has no number by which a repeated reading could be told from a new one.
// - After trouble (timeout, CRC, wrong reply) the line is read empty until it has been quiet for quiet_s; one that talks on is lost
//   (longest_drain).
// - Reads are repeated read_retries times, writes never. Exceptions 5 and 6 (busy) and 10 and 11 (gateway) count as failures;
//   1 to 3 are mistakes of the map (kind input), 4 is a fault of the drive.
// - A pending stop ends every wait at once with an error of kind aborted. write_at_once() is for the stop itself: it does not
//   drain first, and skips stale replies while it waits for its own.
// - Several drives on the line are told apart by unit, and reads by their lengths (register_map.h).
// MODBUS_ERROR_RECOVERY_LINK is not used: it does not return when the port has vanished. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "turntable_drivers/modbus/register_map.h"
#include "turntable_drivers/table/stop_signal.h"

struct _modbus;

namespace turncal {

class ModbusLink {
 public:
  // `stop` must outlive the link.
  ModbusLink(ModbusLinkSettings settings, const StopSignal& stop);
  ~ModbusLink();
  ModbusLink(const ModbusLink&) = delete;
  ModbusLink& operator=(const ModbusLink&) = delete;

  Status open();  // closes first: a descriptor is never leaked
  void close();
  bool is_open() const { return context_ != nullptr; }
  const ModbusLinkSettings& settings() const { return settings_; }

  // function 3 or 4. A failure that is not an exception and not a stop means that the link is lost.
  Status read(int unit, int function, int address, std::span<std::uint16_t> out);
  bool lost() const { return lost_; }
  const std::string& lost_reason() const { return lost_reason_; }
  // function 6 (one register) or 16. One try.
  Status write(int unit, int function, int address, std::span<const std::uint16_t> values);
  Status write_at_once(int unit, int function, int address, std::span<const std::uint16_t> values, double timeout_s);

 private:
  enum class Failure { none, timeout, garbled, exception, hang_up, interrupted };
  struct Reply {
    Failure failure = Failure::none;
    int exception = 0;
    std::string detail;
    std::vector<std::uint8_t> body;  // unit and PDU
  };
  Reply transact(std::span<const std::uint8_t> body, std::size_t reply_length, double timeout_s, bool at_once);
  Reply send(std::span<const std::uint8_t> body);
  Reply await(std::size_t bytes, double timeout_s, bool at_once);  // until that many are there, or silence after some
  Reply receive(std::span<const std::uint8_t> request);
  Reply drain();
  bool discard_pending();     // whether there was anything
  bool discard_unexpected();  // the same, but replies to what was asked before, once more, count as nothing over TCP
  Reply hang_up(const std::string& detail);
  Error error_of(const Reply& reply, const std::string& what) const;
  Status write_with(std::span<const std::uint8_t> body, double timeout_s, bool at_once, const std::string& what);

  ModbusLinkSettings settings_;
  const StopSignal& stop_;
  _modbus* context_ = nullptr;
  int descriptor_ = -1;
  std::uint16_t transaction_ = 0;
  bool stale_ = false;  // a late reply may still come
  bool lost_ = false;
  std::string lost_reason_;
  double last_activity_s_ = 0.0;
  double last_sent_s_ = 0.0;
};

}  // namespace turncal
