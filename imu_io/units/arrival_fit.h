// The unit's clock against the host's, from when samples arrived.
//
// A sample of unit time t (counter x period) arrives at host time a = offset + (1 + skew) t + delay with delay >= 0: the line, the
// adapter and the host only ever add. So the line  offset + (1 + skew) t  lies below all points and touches the fastest, and the
// best one is the edge of their lower convex hull over the mean of t (Moon, Skelly and Towsley, "Estimation and removal of clock
// skew from network delay measurements", INFOCOM 1999: it has the least sum of delays of all lines below the points).
// Streaming: the smallest delay of each second is kept, and of these the hull. Memory is bounded.
// What is constant in the delay cannot be told from offset. Not modelled: a skew that changes (NTP slews by up to 500 ppm).
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace turncal {

struct ArrivalEstimate {
  double offset_s = 0.0;  // host time of unit time 0, less the smallest delay's worth
  double skew = 0.0;      // host seconds a unit second, less 1
  // What the fastest samples of each second scatter by, over the span: about how far off skew may be. 0: not known yet (10 s).
  double skew_uncertainty = 0.0;
  double largest_delay_s = 0.0;  // of a sample, beyond the fastest; counted from the first 10 s on
  double span_s = 0.0;           // unit time that was fitted
};

class ArrivalFit {
 public:
  ArrivalFit();
  void add(double unit_s, double host_s);  // unit_s must not go back
  // Empty before 2 s.
  std::optional<ArrivalEstimate> estimate() const;
  // By how much the samples of at least the last 3 s were later than the estimate of all before them, at the least; 0 when
  // there is too little to tell. A unit that lost time for good shows here.
  double persistent_delay_s() const { return persistent_delay_s_; }
  void restart();

 private:
  struct Point {
    double unit_s;
    double late_s;  // host - unit
  };
  void close_block();

  std::vector<Point> hull_;  // left to right, slopes rising
  double sum_unit_s_ = 0.0;
  std::size_t blocks_ = 0;
  bool have_block_ = false;
  double block_start_s_ = 0.0;
  double first_unit_s_ = 0.0;
  Point block_{};
  std::vector<double> recent_;  // delays of the last blocks, against the estimate before each
  double persistent_delay_s_ = 0.0;
  std::optional<ArrivalEstimate> line_;  // as of the last second, once it spans 10 s
  double square_sum_ = 0.0;              // of the seconds' delays, against the line before each
  std::size_t squares_ = 0;
  double largest_delay_s_ = 0.0;
};

}  // namespace turncal
