// TableServer: puts a DriveTwin on a line, Modbus TCP (a port of 127.0.0.1 or of every address) or RTU (a pseudo-terminal), for a
// rehearsal with real links (`turncal twin`) and for the tests of the driver.
//
//   TableServer server(twin);
//   server.listen_tcp(0);                     // or open_pty("table.link")
//   while (going_on) server.run_once(0.05);   // serves what has arrived, waits at most this long, ticks the watchdog
//
// Faults: `disturb` sees every request with the pieces of its answer before they are sent, and may change them: other bytes, a delay
// before a piece, none at all, or a hang-up. A delay holds up whatever else has arrived, as on a real line.
// One thread; `mutex` is held while the twin (and with it the table) is used, so that another may let time pass meanwhile.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "calib/status.h"
#include "imu_io/pty.h"
#include "turntable_drivers/drive_twin.h"

namespace turncal {

struct AnswerPiece {
  Frame bytes;
  double delay_s = 0.0;  // before it
};
struct AnswerPlan {
  std::vector<AnswerPiece> pieces;
  bool hang_up = false;  // after the pieces
};

class TableServer {
 public:
  explicit TableServer(DriveTwin& twin) : twin_(twin) {}  // the twin must outlive the server
  ~TableServer();
  TableServer(const TableServer&) = delete;
  TableServer& operator=(const TableServer&) = delete;

  Status listen_tcp(int port, bool every_address = false);  // 0: any free port
  Status open_pty(const std::string& link_path);            // "" : no link
  int port() const { return port_; }
  // What the map's link.address says of this line: "127.0.0.1:PORT", or the device.
  std::string address() const;
  void run_once(double timeout_s);
  void hang_up();  // all clients, or the pseudo-terminal

  std::mutex mutex;
  std::function<void(const ModbusRequest&, AnswerPlan&)> disturb;

 private:
  struct Client {
    int descriptor = -1;
    std::vector<std::uint8_t> bytes;
  };
  bool serve(Client& client);  // false: it has gone
  bool answer(Client& client, const ModbusRequest& request);
  bool tcp() const { return listener_ >= 0; }

  DriveTwin& twin_;
  int listener_ = -1;
  int port_ = 0;
  Pty pty_;
  std::vector<Client> clients_;  // of the pseudo-terminal: one
};

}  // namespace turncal
