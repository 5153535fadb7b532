// LineServer: the line of a twin, a TCP port or a pseudo-terminal, with any number of clients (a pseudo-terminal has one). The
// twin defines the protocol (modbus_twin.h: Modbus; dialect_twin.h: ASCII).
//
//   twin.listen_tcp(0);                     // or open_pty("table.link")
//   while (going_on) twin.run_once(0.05);   // serves what has arrived, waits at most this long, calls tick()
//
// The twin's `disturb` creates faults. It sees every request with the pieces of its answer before they are sent, and may change
// them: other bytes, a delay before a piece, no pieces, or a hang-up. A delay holds up everything else that has arrived,
// as on a real line.
// Single-threaded. `mutex` is held while the twin (and the table behind it) is used, so that another thread may let time pass meanwhile.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/lines/unit_end.h"

namespace turncal {

struct AnswerPiece {
  std::vector<std::uint8_t> bytes;
  double delay_s = 0.0;  // before the piece
};
struct AnswerPlan {
  std::vector<AnswerPiece> pieces;
  bool hang_up = false;  // after the pieces
};

class LineServer {
 public:
  LineServer() = default;
  virtual ~LineServer();
  LineServer(const LineServer&) = delete;
  LineServer& operator=(const LineServer&) = delete;

  Status listen_tcp(int port, bool every_address = false);  // 0: any free port
  Status open_pty(const std::string& link_path);            // "": no link
  int port() const { return port_; }
  // Returns the value of link.address in a map or dialect for this line: "127.0.0.1:PORT", or the device.
  std::string address() const;
  void run_once(double timeout_s);
  void hang_up();  // all clients, or the pseudo-terminal

  std::mutex mutex;

 protected:
  // Removes the next complete request from the front and answers it; empty: there is none yet.
  virtual std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) = 0;
  virtual void tick() {}  // called with the mutex held
  bool tcp() const { return listener_ >= 0; }

 private:
  struct Client {
    int descriptor = -1;
    std::vector<std::uint8_t> bytes;
  };
  bool serve(Client& client);  // false: the client has gone
  bool send(const Client& client, const AnswerPlan& plan);

  int listener_ = -1;
  int port_ = 0;
  Pty pty_;
  std::vector<Client> clients_;
};

}  // namespace turncal
