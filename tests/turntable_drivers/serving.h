// Serves a line in a thread of its own, but while something about it is changed.
#pragma once

#include <atomic>
#include <functional>
#include <thread>

#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/twins/line_server.h"

namespace turncal {

inline Frame& bytes_of(AnswerPlan& plan) { return plan.pieces[0].bytes; }
// The reply in two pieces, the second later.
inline void cut(AnswerPlan& plan, std::ptrdiff_t at, double delay_s) {
  const Frame tail(bytes_of(plan).begin() + at, bytes_of(plan).end());
  bytes_of(plan).resize(std::size_t(at));
  plan.pieces.push_back({tail, delay_s});
}

class Serving {
 public:
  explicit Serving(LineServer& server) : server_(server) { start(); }
  ~Serving() { stop(); }
  void change(const std::function<void()>& how) {
    stop();
    how();
    start();
  }

 private:
  void start() {
    ended_ = false;
    thread_ = std::thread([this] {
      while (!ended_) server_.run_once(0.01);
    });
  }
  void stop() {
    ended_ = true;
    thread_.join();
  }
  LineServer& server_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

}  // namespace turncal
