// A read-only page about a run, GET / and GET /status.json, and what it shows: the newest snapshot, every unit's state, the running dwell (of
// the first unit) second by second, the last transitions and how it ended.
//
// Fed by the run's thread and read by the page's, which has limits (page_server.h): every member is behind one lock, held for microseconds.
// The page polls once a second. When the program no longer answers it says so, with the time of its last answer: whether it has ended well
// cannot be known then. When it answers but its loop stands still, the age of the heartbeat says so.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
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

// What does not change while it goes on.
struct LiveRun {
  std::string unit, station, sequence, folder;
  bool simulated = false;                 // a rig or twins, at one end at least
  bool by_hand = false;                   // a person turns the table
  std::vector<std::string> results = {};  // of earlier runs, shown as they are
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
  // How well the unit is known against how well it has to be; replaces what was shown.
  void show_known(const std::string& text, std::vector<NeededSigma> known);
  void show_operator(const OperatorScreen& screen);  // of a table turned by hand
  // After the run: "Done: pass", "Paused: ...", or the error. `verification`: of each unit that was verified, its outcome.
  void end(const std::string& how, Tone tone, const std::vector<std::string>& verification = {});

  // The page polls this. Numbers in degrees, deg/s, m/s^2, seconds.
  std::string json() const;

 private:
  // Where the run is, in one line, and how that looks.
  struct Headline {
    std::string text;
    Tone tone = Tone::good;
  };
  Headline headline() const;  // REQUIRES: the lock is held

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
  Channels per_count_{};                  // of a sum over one second
  std::array<double, 2> pulse_{};         // of gyro [arcsec] and accelerometer [mm/s]; 0: the increments are no pulses
  std::size_t second_samples_ = 200;
  std::vector<Channels> dwell_;  // means of its seconds: deg/s, m/s^2
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
  // After LiveStatus::end: lets whoever is looking hear of it, for 3 s at most; nobody looking: at once.
  void say_goodbye();

 private:
  explicit StatusPage(const LiveStatus& run) : run_(run) {}
  std::optional<PageText> page(std::string_view path);  // called by the server's thread alone

  const LiveStatus& run_;
  std::string json_;  // locked and written out a few times a second, however often it is asked for
  double rendered_s_ = -1e9;
  std::atomic<long> polls_{0};  // answered with what is newer than fresh_s_
  std::atomic<double> polled_s_{-1e9}, fresh_s_{-1e9};
  std::unique_ptr<PageServer> server_;  // goes first
};

}  // namespace turncal
