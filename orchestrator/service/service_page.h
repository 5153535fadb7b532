// The pages of `turncal serve`: GET / and GET /status.json, all stations; GET /metrics, for Prometheus; GET /unit/SERIAL, all there is of a
// unit; GET /report/STATION/FOLDER/FILE, a page of a run. With a password file also POST /act.
//
// Three threads work ahead of the clients. One looks at the stations once a second, so that a slow disk holds up nobody else; the page shows
// how old its look is. One reads the results database every ten seconds. One makes the pages of units and runs when they are asked for and
// keeps them for ten seconds; whoever asks first is told to ask again.
//
// POST /act has Authorization: Basic, X-Turncal: 1, and a body of key = value lines with %xx: station, action, unit (station_view.h). It answers
// 200 with what was done, 401 for a wrong name or password, 409 with why it cannot be done now, 429 when asked too soon. Posts are answered
// one after the other, with at most one new password in between_passwords_s. A stop never waits: by stops alone passwords can be tried as
// fast as crypt(5) hashes.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "calib/types/status.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/service/station_view.h"
#include "orchestrator/station/child_program.h"

namespace turncal {

class ServicePage {
 public:
  // address: as of page_server.h. With a password file only a loopback one: names and passwords are not encrypted.
  static Result<std::unique_ptr<ServicePage>> open(const std::string& address, const ServiceConfig& config,
                                                   std::function<double()> now_utc_s);
  virtual ~ServicePage() = default;

  virtual std::string url() const = 0;
  virtual bool loopback() const = 0;
};

// Alerts (docs/production.md): a command is run with the event as JSON on its standard input, by a thread of its own that nobody waits for. `unit` is
// an outcome. The others, `stopped`, `unreadable`, `silent` and `yield`, are conditions: events once they have stood for stands_s, and again when
// they have been over. An event is run once at most: its line in the record is on disk before the command is started, and the record is
// read when serve begins. What is there when a record is begun is known, and no event.
class Alerts {
 public:
  static constexpr double stands_s = 30.0;
  static constexpr std::size_t least_judged = 10;

  static Result<std::unique_ptr<Alerts>> open(const AlertConfig& config);  // holds the record
  ~Alerts() { over_ = true; }                                              // kills the command that runs

  // Once a second, by one thread. results: nothing where they are not known.
  void look(const std::vector<StationView>& stations, const std::optional<ResultsView>& results, double now_utc_s);
  std::string defect() const;             // of the last alert; empty: it went out
  void drain() const { queue_.drain(); }  // waits until all is told, 10 s at most

 private:
  Alerts(AlertConfig config, LockFile lock) : config_(std::move(config)), lock_(std::move(lock)) {}
  Status write(const char* what, const std::string& key) const;  // a line of the record
  void tell(const HookCall& call, const std::string& key);

  const AlertConfig config_;
  const LockFile lock_;
  bool first_ = false;                   // of a record that was just begun
  std::set<std::string> known_;          // keys of events
  std::map<std::string, double> since_;  // of conditions
  mutable std::mutex mutex_;             // of defect_
  std::string defect_;
  std::atomic<bool> over_{false};
  BackgroundQueue queue_{BackgroundQueue::By::thread};
};

}  // namespace turncal
