// For a run under systemd (or whoever set NOTIFY_SOCKET): says where it is (`systemctl status`), and is watched while the table may move.
//
// The protocol is sd_notify(3): datagrams of `KEY=value` lines to the socket that the variable names. As long as the run's loop goes on it
// says so every second; a loop that is stuck for watch_s is ended by systemd (docs/package.md). Nothing is watched while the table
// rests with its drives off: an estimate may take minutes. Without the variable this does nothing; what cannot be sent is not sent again.
#pragma once

#include <string>

#include "orchestrator/run/run_observer.h"

namespace turncal {

class ServiceWatch : public RunObserver {
 public:
  static constexpr int watch_s = 30;

  ServiceWatch();
  ~ServiceWatch() override;
  ServiceWatch(const ServiceWatch&) = delete;
  ServiceWatch& operator=(const ServiceWatch&) = delete;
  void on_transition(const TransitionRecord& record) override;
  void on_progress(const RunSnapshot& snapshot) override;

 private:
  void tell(const std::string& what) const;
  void disarm();
  int socket_ = -1;
  bool armed_ = false;
  double last_ping_s_ = -1e9;
};

}  // namespace turncal
