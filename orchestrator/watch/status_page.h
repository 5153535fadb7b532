// A read-only page about a run: GET / and GET /status.json, nothing else, and nothing that changes anything.
//
// The page polls status.json once a second. When the program no longer answers it says so, with the time of its last answer: whether
// it has ended well cannot be known then. When it answers but its loop stands still, the age of the heartbeat says so.
//
// Served by a thread of its own with limits (page_server.h); the run's thread never waits for it.
#pragma once

#include <memory>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/watch/live_status.h"

namespace turncal {

class StatusPage {
 public:
  // "127.0.0.1:8080", "[::1]:8080"; port 0: any free one. The view must outlive the page.
  static Result<std::unique_ptr<StatusPage>> open(const std::string& address, const LiveStatus& run);
  ~StatusPage();
  StatusPage(const StatusPage&) = delete;
  StatusPage& operator=(const StatusPage&) = delete;

  std::string url() const;
  std::string warning() const;  // of an address that others reach; else empty
  // After LiveStatus::end: lets whoever is looking hear of it, for 3 s at most; nobody looking: at once.
  void say_goodbye();

 private:
  StatusPage();
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace turncal
