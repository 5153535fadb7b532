// What may misbehave in a run, drawn: class, manner, axis, size, from when to when. Times are seconds of the station.
// The draws are this file's own: std::mt19937_64 is the same everywhere, the distributions of the library are not.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace turncal {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  double uniform(double low, double high) { return low + (high - low) * double(random_() >> 11) * 0x1p-53; }
  double log_uniform(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
  bool chance(double p) { return uniform(0.0, 1.0) < p; }
  std::size_t pick(std::size_t count) { return std::size_t(random_() % count); }
  double sign() { return chance(0.5) ? 1.0 : -1.0; }

 private:
  std::mt19937_64 random_;
};

enum class FaultClass { position, motion, status, orders, answers, unit, pc };
inline constexpr std::array<std::string_view, 7> fault_classes = {"position", "motion", "status", "orders",
                                                                  "answers",  "unit",   "pc"};

struct Fault {
  FaultClass of = FaultClass::position;
  std::string_view manner;
  int axis = 3;       // 3: all of them
  double size = 0.0;  // what it means depends on the manner
  double other_size = 0.0;
  int which = 0;          // a bit of the status, an order, a channel, a position in a frame
  bool by_drive = false;  // of a position: the drive itself believes it
  double begin_s = 0.0, end_s = std::numeric_limits<double>::infinity();

  bool active(double time_s) const { return time_s >= begin_s && time_s < end_s; }
  bool of_axis(std::size_t i) const { return axis == 3 || axis == int(i); }
  std::string text() const {
    char buffer[200];
    std::snprintf(buffer, sizeof buffer, "%s %s axis %d size %.4g %.4g which %d%s, %.2f to %.2f s",
                  std::string(fault_classes[std::size_t(of)]).c_str(), std::string(manner).c_str(), axis, size,
                  other_size, which, by_drive ? " by the drive" : "", begin_s, end_s);
    return buffer;
  }
};

// length_s: of the undisturbed run.
inline Fault draw_fault(Draw& draw, FaultClass of, double length_s) {
  Fault fault;
  fault.of = of;
  if (!draw.chance(0.15)) fault.begin_s = draw.uniform(0.0, length_s);
  if (!draw.chance(0.4)) fault.end_s = fault.begin_s + draw.log_uniform(0.05, 2.0 * length_s);
  fault.axis = draw.chance(0.5) ? 3 : int(draw.pick(3));
  const auto manner = [&]<std::size_t n>(const std::array<std::string_view, n>& among) {
    fault.manner = among[draw.pick(n)];
    return fault.manner;
  };
  switch (of) {
    case FaultClass::position: {
      constexpr std::array<std::string_view, 7> among = {"latency", "alias",  "quantised", "drift",
                                                         "frozen",  "offset", "scaled"};
      const std::string_view how = manner(among);
      fault.by_drive = draw.chance(0.3);
      if (how == "latency") fault.size = draw.log_uniform(0.02, 60.0);
      if (how == "alias") fault.size = 360.0 * draw.sign() * (draw.chance(0.8) ? 1.0 : 2.0);
      if (how == "quantised") fault.size = draw.log_uniform(1e-4, 10.0);
      if (how == "drift") fault.size = draw.sign() * draw.log_uniform(1e-4, 5.0);
      if (how == "frozen") fault.which = int(draw.pick(2));  // 1: the rate reads 0 as well
      if (how == "offset") fault.size = draw.sign() * draw.log_uniform(1e-3, 180.0);
      if (how == "scaled") fault.size = draw.chance(0.1) ? -1.0 : 1.0 + draw.sign() * draw.log_uniform(1e-4, 0.9);
      break;
    }
    case FaultClass::motion: {
      constexpr std::array<std::string_view, 2> among = {"factors", "runaway"};
      if (draw.chance(0.3)) {
        fault.manner = among[1];
        fault.axis = int(draw.pick(3));
        fault.size = draw.sign() * draw.log_uniform(0.01, 3000.0);
        fault.other_size = draw.log_uniform(0.001, 100.0);
      } else {
        fault.manner = among[0];
        fault.size = draw.chance(0.8) ? draw.log_uniform(0.1, 15.0) : 1.0;
        fault.other_size = fault.size == 1.0 || draw.chance(0.4) ? draw.log_uniform(0.1, 15.0) : 1.0;
      }
      break;
    }
    case FaultClass::status: {
      constexpr std::array<std::string_view, 5> among = {"early", "late", "stuck on", "stuck off", "flickering"};
      const std::string_view how = manner(among);
      fault.which = int(draw.pick(how == "early" ? 2 : 7));
      fault.size = how == "flickering" ? draw.log_uniform(0.02, 20.0) : draw.log_uniform(0.1, 120.0);
      fault.other_size = draw.uniform(0.05, 0.95);  // share of the time in which a flickering bit is wrong
      break;
    }
    case FaultClass::orders: {
      constexpr std::array<std::string_view, 3> among = {"ignored", "refused", "late"};
      manner(among);
      fault.which = int(draw.pick(5));
      fault.size = draw.log_uniform(0.1, 60.0);
      break;
    }
    case FaultClass::answers: {
      constexpr std::array<std::string_view, 11> among = {"late",        "doubled",    "cut",         "split",
                                                          "junk before", "junk after", "flipped bit", "foreign",
                                                          "exception",   "silence",    "hang-up"};
      manner(among);
      fault.size = draw.log_uniform(0.003, 1.5);                                 // seconds of the wall: of a link
      fault.other_size = draw.chance(0.4) ? 1.0 : draw.log_uniform(0.002, 1.0);  // share of the answers
      fault.which = int(draw.pick(1000));
      break;
    }
    case FaultClass::unit: {
      constexpr std::array<std::string_view, 15> among = {
          "sample rate",  "counter reset", "frozen",    "one frozen", "another unit",
          "axes swapped", "sign reversed", "saturated", "glitches",   "lost samples",
          "lost, hidden", "damaged bytes", "silence",   "hang-up",    "invalid"};
      const std::string_view how = manner(among);
      fault.which = int(draw.pick(6));  // gyro x to accelerometer z
      if (how == "sample rate") fault.size = 1.0 + draw.sign() * draw.log_uniform(1e-4, 0.5);
      if (how == "counter reset") fault.size = draw.chance(0.5) ? 0.0 : std::floor(draw.log_uniform(1.0, 4e9));
      if (how == "another unit") fault.size = draw.uniform(1.0, 1e6);
      if (how == "saturated") fault.size = draw.log_uniform(0.01, 2.0);  // of one g, or of 10 deg/s
      if (how == "glitches")
        fault.size = draw.sign() * draw.log_uniform(1.0, 1e6), fault.other_size = draw.log_uniform(1e-5, 0.1);
      if (how == "lost samples" || how == "lost, hidden" || how == "damaged bytes")
        fault.other_size = draw.log_uniform(1e-5, 0.5);
      if (how == "another unit" && fault.begin_s == 0.0) fault.begin_s = draw.uniform(5.0, length_s);
      break;
    }
    case FaultClass::pc: {
      constexpr std::array<std::string_view, 8> among = {"sync hangs",        "write hangs",   "write fails",
                                                         "disk full",         "clock stepped", "memory short",
                                                         "descriptors short", "files short"};
      const std::string_view how = manner(among);
      fault.begin_s = std::max(fault.begin_s, 20.0);  // the program is loaded by then
      fault.end_s = std::max(fault.end_s, fault.begin_s + 1.0);
      if (how == "clock stepped") fault.size = draw.sign() * draw.log_uniform(0.5, 3e7);
      if (how == "memory short") fault.size = draw.log_uniform(1.0, 3e7);                // bytes more than it has
      if (how == "descriptors short") fault.size = std::floor(draw.uniform(0.0, 24.0));  // in all
      if (how == "files short") fault.size = draw.log_uniform(1e3, 5e6);                 // bytes
      break;
    }
  }
  return fault;
}

// None, one or two. `only`: of this class, the first one.
inline std::vector<Fault> draw_faults(Draw& draw, double length_s, int only) {
  std::vector<Fault> faults;
  const double count = draw.uniform(0.0, 1.0);
  const std::size_t wanted = count < 0.05 && only < 0 ? 0 : count < 0.7 ? 1 : 2;
  while (faults.size() < wanted) {
    const auto drawn = static_cast<FaultClass>(draw.pick(fault_classes.size()));
    const FaultClass of = only >= 0 && faults.empty() ? static_cast<FaultClass>(only) : drawn;
    if (of == FaultClass::pc && !faults.empty() && faults[0].of == of) continue;  // one disk, one clock
    faults.push_back(draw_fault(draw, of, length_s));
  }
  return faults;
}

}  // namespace turncal
