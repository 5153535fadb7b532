// Alerts of `turncal serve` (docs/serve.md): a command is run with the event as JSON on its standard input, so that somebody hears of it
// who does not look at the page.
//
//   unit        a unit did not pass; one event for each outcome
//   stopped     nobody works on a queue with units in it, or a run was left in the middle
//   unreadable  a file of the station is missing or damaged
//   silent      a run goes on and writes nothing (StationView::silent_s)
//   yield       of the last 24 hours, below alert.least_yield; of least_judged attempts at least
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
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/posix_file.h"
#include "orchestrator/run/background_queue.h"
#include "orchestrator/service/station_view.h"
#include "orchestrator/station/fields.h"

namespace turncal {

struct Alert {
  std::string event, station, unit, outcome, message, time_utc, folder;
  bool simulated = false;
};

Fields fields_of(Alert& alert);  // the keys of the JSON

// What stands now. results: nothing where they are not known.
std::vector<Alert> alerts_in(const std::vector<StationView>& stations, const std::optional<ResultsView>& results,
                             const AlertConfig& config, double now_utc_s);

class Alerts {
 public:
  static constexpr double stands_s = 30.0;
  static constexpr std::size_t least_judged = 10;

  static Result<std::unique_ptr<Alerts>> open(const AlertConfig& config);  // holds the record
  ~Alerts();                                                               // kills the command that runs

  // Once a second; by one thread.
  void look(const std::vector<StationView>& stations, const std::optional<ResultsView>& results, double now_utc_s);
  void drain() const { queue_.drain(); }  // waits until all is told, 10 s at most
  std::string defect() const;             // of the last alert; empty: it went out
  std::vector<std::string> take_lines();  // of the record, new since the last call

 private:
  Alerts(AlertConfig config, LockFile lock) : config_(std::move(config)), lock_(std::move(lock)) {}
  bool write(const char* what, const std::string& key);  // a line of the record
  void tell(Alert alert, const std::string& key);

  const AlertConfig config_;
  const LockFile lock_;
  bool first_ = false;                   // of a record that was just begun
  std::set<std::string> known_;          // keys of events
  std::map<std::string, double> since_;  // of conditions
  mutable std::mutex mutex_;             // of what follows
  std::string defect_;
  std::vector<std::string> lines_;
  std::atomic<bool> over_{false};
  BackgroundQueue queue_{BackgroundQueue::By::thread};
};

}  // namespace turncal
