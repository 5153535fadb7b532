// The page of `turncal serve`: all stations, GET / and GET /status.json, GET /metrics for Prometheus; GET /unit/SERIAL and
// GET /report/STATION/FOLDER/FILE for what there is of a unit and of a run. With a password file POST /act, too.
//
// A thread of its own looks at the stations once a second, so that what a client asks for is there already, and a slow disk holds up
// nobody but that thread; the page shows how old the look is. Another reads the results database every ten seconds, if there is one. Pages of
// units and runs are made by a third when they are asked for, and kept for ten seconds: whoever asks first is told to ask again. Posts are answered one after the other, at most one password in
// between_passwords_s: guessing is slow. A name and password that were right once do not wait, nor does a stop: its password is looked at whatever
// others do, so that by stops passwords can be tried as fast as crypt(5) hashes.
//
// POST /act: Authorization: Basic, X-Turncal: 1, and a body of key = value lines: station, action, unit (station_view.h), values with %xx. Answers: 200 and what
// was done; 401 name or password; 409 what cannot be done now, and why; 429 too soon.
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
#include "orchestrator/station/hooks.h"

namespace turncal {

class ServicePage {
 public:
  // address: as of page_server.h. With a password file only a loopback one: names and passwords are not encrypted.
  static Result<std::unique_ptr<ServicePage>> open(const std::string& address, const ServiceConfig& config,
                                                   std::function<double()> now_utc_s);
  ~ServicePage();
  ServicePage(const ServicePage&) = delete;
  ServicePage& operator=(const ServicePage&) = delete;

  std::string url() const;
  bool loopback() const;

 private:
  ServicePage();
  struct State;
  std::unique_ptr<State> state_;
};

// Alerts of `turncal serve` (docs/serve.md): a command is run with the event as JSON on its standard input, so that somebody hears of it
// who does not look at the page.
// Events: `unit`, of an outcome, and `stopped`, `unreadable`, `silent`, `yield`, of a station.
//
// All but `unit` are conditions: an event once they have stood for stands_s, and again when they have been over. An event is run once at
// most: the record has its line on disk before the command is started, and is read when serve begins. What is there when a record
// is begun is known, and no event.
//
// A thread of its own runs the commands, one after the other; each has alert.time_s. Whoever looks at stations waits for none of it.
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
