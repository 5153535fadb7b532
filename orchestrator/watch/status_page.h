// A read-only page about a run, GET / and GET /status.json, and its contents: the newest snapshot, every unit's state, the present dwell (of
// the first unit) second by second, the last transitions and the outcome.
//
// The run's thread fills it and the page's thread reads it, with limits (page_server.h): one lock, held for microseconds, guards every member.
// The page polls once a second. When the program no longer answers, the page says so, with the time of the last answer, because it cannot
// know whether the run ended well. When the program answers but its loop is stuck, the age of the heartbeat shows it.
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/run/run_observer.h"
#include "orchestrator/watch/operator_screen.h"
#include "orchestrator/watch/page_server.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

// The constant facts of a run.
struct LiveRun {
  std::string unit, station, sequence, folder;
  bool simulated = false;                 // table or unit is a rig or a twin
  bool by_hand = false;                   // a person turns the table
  std::vector<std::string> results = {};  // of earlier runs, shown unchanged
};

class LiveStatus : public RunObserver, public RunSink {
 public:
  // wall_s: seconds on a steady clock, for the age of the heartbeat.
  LiveStatus(LiveRun run, std::function<double()> wall_s);

  void on_transition(const TransitionRecord& record) override;
  void on_dropout(const Dropout& dropout) override;
  void on_progress(const RunSnapshot& snapshot) override;
  Status start(const RecordingInfo& info) override;
  Status begin_segment(const Segment& segment) override;
  Status add(std::span<const ImuSample> samples) override;
  // Shows the unit's sigmas against the needed ones; replaces the last ones.
  void show_known(const std::string& text, std::vector<NeededSigma> known);
  void show_operator(const OperatorScreen& screen);  // for a table turned by hand
  // Shows the end of the run: "Done: pass", "Paused: ...", or the error. `verification`: outcome for each verified unit.
  void end(const std::string& how, Tone tone, const std::vector<std::string>& verification = {});

  // Returns the status that the page polls. Degrees, deg/s, m/s^2, seconds.
  std::string json() const;

 private:
  // The state of the run in one line, with its colour.
  struct Headline {
    std::string text;
    Tone tone = Tone::good;
  };
  Headline headline() const;  // REQUIRES the lock

  using Channels = std::array<double, 6>;  // gyro x y z, accelerometer x y z
  mutable std::mutex mutex_;
  const LiveRun run_;
  std::function<double()> wall_s_;
  double heartbeat_s_ = 0.0;
  RunSnapshot snapshot_;
  std::string last_error_, pause_, ended_, known_text_;
  std::vector<NeededSigma> known_;
  std::optional<OperatorScreen> operator_;
  Tone ended_as_ = Tone::bad;
  std::vector<std::string> verification_;
  std::vector<std::string> transitions_;  // the newest last
  Channels per_count_{};                  // per count of a sum over one second
  std::array<double, 2> pulse_{};         // of gyro [arcsec] and accelerometer [mm/s]; 0: increments are not pulses
  std::size_t second_samples_ = 200;
  std::vector<Channels> dwell_;  // its one-second means: deg/s, m/s^2
  Channels sum_{};
  std::size_t in_sum_ = 0;
  bool dwelling_ = false;
  float temperature_c_ = 0.0F;
  bool has_temperature_ = false;
};

class StatusPage {
 public:
  // "127.0.0.1:8080", "[::1]:8080"; port 0: any free one. The view must outlive the page.
  static Result<std::unique_ptr<StatusPage>> open(const std::string& address, const LiveStatus& run);

  const PageServer& server() const { return *server_; }
  // Call it after LiveStatus::end: waits, for 3 s at most, until viewers have polled the end; without viewers it returns at once.
  void say_goodbye();

 private:
  explicit StatusPage(const LiveStatus& run) : run_(run) {}
  std::optional<PageText> page(std::string_view path);  // only the server's thread calls it

  const LiveStatus& run_;
  std::string json_;  // rendered only a few times a second, however often it is polled
  double rendered_s_ = -1e9;
  std::atomic<long> polls_{0};  // answered with a status newer than fresh_s_
  std::atomic<double> polled_s_{-1e9}, fresh_s_{-1e9};
  std::unique_ptr<PageServer> server_;  // destroyed first
};

}  // namespace turncal
