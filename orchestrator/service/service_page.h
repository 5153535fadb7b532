// The pages of `turncal serve`: GET / and GET /status.json, all stations; GET /metrics, for Prometheus; GET /unit/SERIAL, everything about a
// unit; GET /report/STATION/FOLDER/FILE, a page of a run. With a password file also POST /act.
//
// Three threads work ahead of the clients. One looks at the stations once a second, so that a slow disk holds up nothing else; the page shows
// the age of that look. One reads the results database every ten seconds. One makes pages of units and runs on request and
// keeps them for ten seconds; the first client is told to ask again.
//
// POST /act has Authorization: Basic, X-Turncal: 1, and a body of key = value lines with %xx: station, action, unit (station_view.h). It answers
// 200 with what was done, 401 for a wrong name or password, 409 with why it is not possible now, 429 when requested too soon. Posts are answered
// one at a time, with at most one new password in between_passwords_s. A stop never waits, so by stops passwords can be tried as
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
  // address: as in page_server.h. With a password file it must be loopback, because names and passwords are not encrypted.
  static Result<std::unique_ptr<ServicePage>> open(const std::string& address, const ServiceConfig& config,
                                                   std::function<double()> now_utc_s);
  virtual ~ServicePage() = default;

  virtual std::string url() const = 0;
  virtual bool loopback() const = 0;
};

// Runs a command for each alert (docs/production.md), with the event as JSON on standard input, in its own thread for which nobody waits. `unit` is
// an outcome. The others, `stopped`, `unreadable`, `silent` and `yield`, are conditions: they become events after standing for stands_s, and again
// after they have ended. Each event runs at most once: its line in the record is on disk before the command starts, and the record is
// read when serve begins. Whatever exists when a record is begun counts as known.
class Alerts {
 public:
  static constexpr double stands_s = 30.0;
  static constexpr std::size_t least_judged = 10;

  static Result<std::unique_ptr<Alerts>> open(const AlertConfig& config);  // locks the record
  ~Alerts() { over_ = true; }                                              // kills a running command

  // Call it once a second, from one thread. results: empty when unknown.
  void look(const std::vector<StationView>& stations, const std::optional<ResultsView>& results, double now_utc_s);
  std::string defect() const;             // why the last alert failed; empty: it went out
  void drain() const { queue_.drain(); }  // waits until all alerts are out, 10 s at most

 private:
  Alerts(AlertConfig config, LockFile lock) : config_(std::move(config)), lock_(std::move(lock)) {}
  Status write(const char* what, const std::string& key) const;  // adds a line to the record
  void tell(const HookCall& call, const std::string& key);

  const AlertConfig config_;
  const LockFile lock_;
  bool first_ = false;                   // the record was just begun
  std::set<std::string> known_;          // keys of events
  std::map<std::string, double> since_;  // of each condition
  mutable std::mutex mutex_;             // guards defect_
  std::string defect_;
  std::atomic<bool> over_{false};
  BackgroundQueue queue_{BackgroundQueue::By::thread};
};

}  // namespace turncal
