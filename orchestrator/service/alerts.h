// Alerts of `turncal serve` (docs/serve.md): a command is run with the event as JSON on its standard input, so that somebody hears of it
// who does not look at the page.
// Events: `unit`, of an outcome, and `stopped`, `unreadable`, `silent`, `yield`, of a station.
//
// All but `unit` are conditions: an event once they have stood for stands_s, and again when they have been over. An event is run once at
// most: the record has its line on disk before the command is started, and is read when serve begins. What is there when a record
// is begun is known, and no event.
//
// A thread of its own runs the commands, one after the other; each has alert.time_s. Whoever looks at stations waits for none of it.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <set>

#include "orchestrator/run/background_queue.h"
#include "orchestrator/service/station_view.h"
#include "orchestrator/station/hooks.h"

namespace turncal {

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
