// Operates a chamber without ever waiting for it: gives its commands, finds its faults, and tells whether it has settled at its set point.
//
//   ChamberWatch    pure: readings and their times -> settled, a fault, the time left
//   ChamberKeeper   commands and readings, in a queue of their own (background_queue.h), so that a silent line holds nothing up
//
// Faults: the set point not read back within answer_s of the command; set or switched by somebody else; door open; alarm; no reading; a sensor out
// of the band that reads the same for dead_s plus the ramp of three grains; not settled within settle_limit_s; out of the band for settle_s
// after it had settled; the unit warmer than limit_unit_c by its own thermometer. Settled: every reading within the band of the set point for
// settle_s, and the warmest unit's own thermometer, where there is one, within a band of that width for as long.
// A sensor that fails within the band cannot be told from a good one; the unit's own thermometer guards against that.
//
// The command to switch off is repeated at every poll until the chamber reads off twice, or the caller gives up.
// Seconds on the station's clock, degrees Celsius. Not thread-safe.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "orchestrator/run/background_queue.h"
#include "orchestrator/station/station_config.h"
#include "turntable_drivers/chamber/chamber.h"

namespace turncal {

class ChamberWatch {
 public:
  static constexpr double answer_s = 15.0, dead_s = 180.0;

  ChamberWatch(const ChamberConfig& config, const ChamberLimits& limits) : config_(config), limits_(limits) {}
  void begin(double temperature_c, double ramp_c_per_min, double now_s);
  // Takes one reading. unit_c: the warmest unit's own temperature; empty: not yet known. Returns the fault; empty: none.
  std::string add(const ChamberStatus& now, std::optional<double> unit_c, double now_s);
  bool as_told(const ChamberStatus& now) const;  // on, and at the set point
  bool settled() const { return settled_; }
  double left_s(double now_s) const;  // until it can have settled

 private:
  ChamberConfig config_;
  ChamberLimits limits_;
  double target_c_ = 0.0, ramp_c_per_min_ = 1.0, began_s_ = 0.0;
  std::optional<double> in_band_s_, out_of_band_s_;  // since when
  double unit_c_ = 0.0, unit_since_s_ = 0.0;         // the unit has stayed within the band of this, since then
  double last_c_ = 0.0, changed_s_ = 0.0;
  bool told_ = false, settled_ = false;
};

class ChamberKeeper {
 public:
  // The chamber must outlive this object. By::caller: in simulated time, which stands still meanwhile.
  ChamberKeeper(Chamber& chamber, const ChamberConfig& config, BackgroundQueue::By by)
      : chamber_(chamber), watch_(config, chamber.limits()), queue_(by, stuck_s) {}

  Status connect();  // blocks, so call it before anything moves; an open door or an alarm is an error
  bool is_connected() const { return connected_; }
  // Starts towards a temperature, from whatever state it is in; a resumed run begins with this, too.
  void bring_to(double temperature_c, double ramp_c_per_min, double now_s);
  void switch_off();
  // Takes the last reading, and asks for the next when it is due. Returns the fault; empty: none.
  std::string look(std::optional<double> unit_c, double now_s);
  bool settled() const { return work_ == Work::hold && watch_.settled(); }
  bool is_off() const { return off_; }  // read twice, after the command
  double left_s(double now_s) const { return watch_.left_s(now_s); }
  std::string text() const;          // "chamber 35.2 of 40 C"; empty: nothing was read
  std::string not_verified() const;  // one line, for a chamber that was not seen off

  static constexpr double poll_s = 1.0, off_limit_s = 60.0;

 private:
  static constexpr double stuck_s = 60.0;  // wall time of one command and reading, retries included
  enum class Work { none, hold, off };
  struct Answer {
    Work work = Work::none;
    Result<ChamberStatus> status = ChamberStatus{};
  };
  void ask(double now_s);

  Chamber& chamber_;
  ChamberWatch watch_;
  Work work_ = Work::none;
  double temperature_c_ = 0.0, ramp_c_per_min_ = 1.0;
  bool connected_ = false, reads_off_ = false, off_ = false;
  std::optional<ChamberStatus> last_;
  std::string why_;  // why the last reading failed
  double next_s_ = 0.0;
  std::shared_ptr<Answer> answer_;  // shared with the queue's thread
  std::optional<PendingWrite> asked_;
  BackgroundQueue queue_;  // declared last: its thread ends first
};

// What bring_to() and leave_off() need of a caller's own loop.
struct ChamberTime {
  std::function<double()> now_s;
  std::function<void(double seconds)> wait;
  std::function<bool()> give_up;
  std::function<std::optional<double>()> unit_c;
  std::function<void(const std::string& text, double left_s)> progress;
};
Status bring_to(ChamberKeeper& chamber, double temperature_c, double ramp_c_per_min, const ChamberTime& time);
// Switches the chamber off. An error when it is not read off within off_limit_s.
Status leave_off(ChamberKeeper& chamber, const ChamberTime& time);

}  // namespace turncal
