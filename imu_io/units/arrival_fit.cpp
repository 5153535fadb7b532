#include "imu_io/units/arrival_fit.h"

#include <algorithm>
#include <cmath>

namespace turncal {
namespace {

constexpr double block_s = 1.0;
constexpr std::size_t most_points = 512;
constexpr std::size_t recent_blocks = 3;
constexpr double judged_after_s = 10.0;

}  // namespace

ArrivalFit::ArrivalFit() {
  hull_.reserve(most_points + 1);
  recent_.reserve(recent_blocks);
}

void ArrivalFit::restart() { *this = ArrivalFit(); }

void ArrivalFit::add(double unit_s, double host_s) {
  const Point point{unit_s, host_s - unit_s};
  if (line_) largest_delay_s_ = std::max(largest_delay_s_, point.late_s - (line_->offset_s + line_->skew * unit_s));
  if (have_block_ && unit_s - block_start_s_ >= block_s) close_block();
  if (!have_block_) {
    if (blocks_ == 0) first_unit_s_ = unit_s;
    have_block_ = true;
    block_start_s_ = unit_s;
    block_ = point;
  } else if (point.late_s < block_.late_s) {
    block_ = point;
  }
}

void ArrivalFit::close_block() {
  have_block_ = false;
  // Against what was known before it; then it joins the hull.
  if (line_ = estimate(); line_ && line_->span_s < judged_after_s) line_.reset();
  if (line_) {
    if (recent_.size() == recent_blocks) recent_.erase(recent_.begin());
    recent_.push_back(block_.late_s - (line_->offset_s + line_->skew * block_.unit_s));
    square_sum_ += recent_.back() * recent_.back();
    ++squares_;
    if (recent_.size() == recent_blocks) persistent_delay_s_ = *std::min_element(recent_.begin(), recent_.end());
  }
  const auto turns_right = [](const Point& a, const Point& b, const Point& c) {
    return (b.late_s - a.late_s) * (c.unit_s - a.unit_s) >= (c.late_s - a.late_s) * (b.unit_s - a.unit_s);
  };
  while (hull_.size() >= 2 && turns_right(hull_[hull_.size() - 2], hull_.back(), block_)) hull_.pop_back();
  hull_.push_back(block_);
  sum_unit_s_ += block_.unit_s;
  ++blocks_;
  if (hull_.size() > most_points) {
    // Every other inner corner goes; the hull stays on or above what it was.
    std::size_t kept = 1;
    for (std::size_t i = 2; i < hull_.size(); i += 2) hull_[kept++] = hull_[i];
    if (hull_.size() % 2 == 0) hull_[kept++] = hull_.back();
    hull_.resize(kept);
  }
}

std::optional<ArrivalEstimate> ArrivalFit::estimate() const {
  if (hull_.size() < 2 || blocks_ < 2) return {};
  const double mean = sum_unit_s_ / static_cast<double>(blocks_);
  std::size_t right = 1;
  while (right + 1 < hull_.size() && hull_[right].unit_s < mean) ++right;
  const Point& a = hull_[right - 1];
  const Point& b = hull_[right];
  ArrivalEstimate result;
  result.skew = (b.late_s - a.late_s) / (b.unit_s - a.unit_s);
  result.offset_s = a.late_s - result.skew * a.unit_s;
  result.span_s = hull_.back().unit_s - first_unit_s_;
  if (squares_ > 0) result.skew_uncertainty = std::sqrt(square_sum_ / static_cast<double>(squares_)) / result.span_s;
  result.largest_delay_s = largest_delay_s_;
  return result;
}

}  // namespace turncal
