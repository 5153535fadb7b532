#include "calib/joint/joint_estimate.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "calib/model/limits.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

std::string action_for(const Break& cut) {
  return cut.nothing_is_known() ? "turn set aside: attitude and velocity are estimated anew after it"
                                : "velocity is estimated anew after it";
}

std::string glitch_text(const DataEvent& event) {
  return std::string(event.kind == DataEvent::Kind::gyro_glitch ? "gyro" : "accelerometer") + " glitch on axis " +
         "xyz"[event.axis];
}

std::size_t block_of(const CompressedRecording& recording, std::int64_t sample) {
  const auto after = std::upper_bound(recording.blocks.begin(), recording.blocks.end(), sample,
                                      [](std::int64_t s, const Block& b) { return s < b.start_sample; });
  return after == recording.blocks.begin() ? 0 : std::size_t(after - recording.blocks.begin()) - 1;
}

constexpr double nothing_known_rad = 1.0;

constexpr char filled_in[] = "filled in between the samples beside it";

// Replaces the lines of many short gaps by one.
void gather_filled(std::vector<Fault>& faults) {
  const auto is_filled = [](const Fault& f) { return f.action == filled_in; };
  const auto first = std::ranges::find_if(faults, is_filled);
  const auto gaps = std::count_if(first, faults.end(), is_filled);
  if (gaps <= fault_limits.most_listed) return;
  Fault all = *first;
  std::int64_t samples = 0;
  for (auto f = first; f != faults.end(); ++f) {
    if (!is_filled(*f)) continue;
    samples += f->last_sample - f->first_sample + 1;
    all.last_sample = f->last_sample;
  }
  all.what = fmt::format("{} samples missing in {} gaps of at most {}", samples, gaps, fault_limits.most_filled);
  *first = all;
  faults.erase(std::remove_if(first + 1, faults.end(), is_filled), faults.end());
}

// Returns the segment that holds all samples of a gap, rests counted as one; -1 if the gap crosses the border of a turn.
int segment_of_gap(const CompressedRecording& recording, std::int64_t first, std::int64_t last) {
  int found = -1;
  for (std::size_t k = 0; k < recording.segments.size(); ++k) {
    const Segment& segment = recording.segments[k];
    if (segment.end_sample <= first || segment.start_sample > last) continue;
    if (found >= 0 && (segment.kind == SegmentKind::rotate || recording.segments[found].kind == SegmentKind::rotate))
      return -1;
    found = int(k);
  }
  return found;
}

// Returns twice the largest error of the rotation over `lost_s` at a block as interpolated from the rates on either side (linear_motion.h
// fills it in so). The interpolation is tried on nearby stretches of that length where the rotation was measured.
double fill_sigma_rad(const CompressedRecording& recording, std::size_t gap, double lost_s) {
  const std::vector<Block>& blocks = recording.blocks;
  const auto usable = [&](std::size_t k) {
    return k < blocks.size() && blocks[k].segment == blocks[gap].segment && blocks[k].missing == 0;
  };
  // Where a turn begins or ends, the rate on one side is no guide.
  if (!usable(gap + 1) || !usable(gap - 1)) return nothing_known_rad;
  const std::size_t window = std::max<std::size_t>(1, std::size_t(std::ceil(lost_s / blocks[gap + 1].duration_s)));
  const double si = nominal_gyro_rad(recording.info);
  const auto rate = [&](std::size_t k) -> Eigen::Vector3d { return blocks[k].gyro / blocks[k].duration_s; };
  double largest = 0.0;
  int tried = 0;
  const std::size_t reach = 6 * window + 4;
  for (std::size_t k = gap > reach ? gap - reach : 1; k <= gap + reach; ++k) {
    Eigen::Vector3d turned = Eigen::Vector3d::Zero();
    double t = 0.0;
    bool all = k > 0 && usable(k - 1) && usable(k + window);
    for (std::size_t i = k; all && i < k + window; ++i) {
      all = usable(i);
      turned += blocks[i].gyro;
      t += blocks[i].duration_s;
    }
    if (!all) continue;
    const Eigen::Vector3d guessed = 0.5 * t * (rate(k - 1) + rate(k + window));
    largest = std::max(largest, (turned - guessed).norm() * si * lost_s / t);
    ++tried;
  }
  const double sigma = 2.0 * largest;
  return tried >= fault_limits.fewest_trials && sigma < fault_limits.worst_fill_rad ? sigma : nothing_known_rad;
}

}  // namespace

void add_break(std::vector<Break>& breaks, const Break& cut) {
  const auto place = std::lower_bound(breaks.begin(), breaks.end(), cut.block,
                                      [](const Break& b, std::size_t block) { return b.block < block; });
  breaks.insert(place, cut);
}

std::vector<Fault> faults_from_events(const CompressedRecording& recording, std::vector<Break>& breaks) {
  std::vector<Fault> faults;
  std::vector<DataEvent> events = recording.events;
  const std::vector<DataEvent> clipped = clipped_turns(recording);
  events.insert(events.end(), clipped.begin(), clipped.end());
  for (const DataEvent& event : events) {
    Fault fault;
    fault.first_sample = event.sample;
    fault.last_sample = event.sample + std::max<std::int64_t>(event.count, 1) - 1;
    fault.block = block_of(recording, event.sample);
    bool rotating = recording.rotates(recording.blocks[fault.block]);
    Break cut;
    cut.block = fault.block;
    const bool glitch = event.kind == DataEvent::Kind::gyro_glitch || event.kind == DataEvent::Kind::accel_glitch;
    if (event.kind == DataEvent::Kind::duplicate) {
      fault.what = "sample counted twice by the unit";
      fault.action = "the second copy dropped";
    } else if (event.kind == DataEvent::Kind::temperature) {
      fault.what = fmt::format("{} temperature(s) that cannot be, the first {:.6g} C", event.count, event.size);
      fault.action = "not used";
    } else if (event.kind == DataEvent::Kind::gap || event.left_out) {
      fault.what = glitch ? fmt::format("{} gave {:.6g}, which cannot be", glitch_text(event), event.size)
                          : fmt::format("gap of {} sample(s) in the unit's counter", event.count);
      const int segment = segment_of_gap(recording, fault.first_sample, fault.last_sample);
      rotating = segment < 0 || recording.segments[segment].kind == SegmentKind::rotate;
      const double lost_s = double(event.count) * recording.info.sample_period_s;
      if (segment >= 0) cut.attitude_sigma_rad = fill_sigma_rad(recording, fault.block, lost_s);
    } else if (event.axis == set_aside_axis) {
      fault.what = "rest that disagreed with all the others and was made again";
    } else if (event.kind == DataEvent::Kind::invalid) {
      fault.what =
          event.axis < 0 ? "sample marked invalid by the unit" : clipped_text(recording.info, event.axis, event.size);
    } else {
      const bool gyro = event.kind == DataEvent::Kind::gyro_glitch;
      const bool counted =
          (gyro ? recording.info.gyro_increment : recording.info.accel_increment) == IncrementKind::pulses;
      fault.what = glitch_text(event) + (counted ? fmt::format(", {:.0f} counts off its neighbours", event.size)
                                                 : fmt::format(", {:.3g} off its neighbours", event.size));
      // Twice the deviation of the sample: half of it may lie in its neighbours.
      cut.attitude_sigma_rad = gyro ? 2.0 * std::abs(event.size) * nominal_gyro_rad(recording.info) : 0.0;
    }
    if (event.filled && fault.action.empty()) fault.action = filled_in;
    if (!fault.action.empty()) {  // nothing is cut
      faults.push_back(fault);
      continue;
    }
    fault.action =
        event.axis == set_aside_axis ? "set aside: attitude and velocity are estimated anew after it" : action_for(cut);
    if (!faults.empty() && faults.back().block == fault.block && faults.back().what == fault.what) {
      faults.back().last_sample = fault.last_sample;
      continue;
    }
    add_break(breaks, cut);
    // A second's mean velocity depends on when in it the glitch was: nothing learned from that second is kept.
    if (!rotating && event.kind != DataEvent::Kind::gap && !event.left_out &&
        fault.block + 1 < recording.blocks.size()) {
      ++cut.block;
      add_break(breaks, cut);
    }
    faults.push_back(fault);
  }
  gather_filled(faults);
  return faults;
}

bool cut_worst_fault(const CompressedRecording& recording, const std::vector<Innovation>& innovations,
                     std::vector<Fault>& faults, std::vector<Break>& breaks) {
  // Usual size of the first seconds after a rotation.
  std::vector<double> after_rotation;
  for (const Innovation& i : innovations)
    if (i.block > 0 && !recording.blocks[i.block - 1].whole_second)
      after_rotation.push_back(i.normalised.squaredNorm());
  double usual = 0.0;
  if (after_rotation.size() >= 10) {
    const double share = fault_limits.usual_share * double(after_rotation.size());
    usual = value_at_rank(after_rotation, std::size_t(share));
  }
  const double limit = std::max(fault_limits.chi_square, fault_limits.of_usual * usual);
  const Innovation* worst = nullptr;
  for (const Innovation& i : innovations)
    if (i.normalised.squaredNorm() > limit && (!worst || i.normalised.squaredNorm() > worst->normalised.squaredNorm()))
      worst = &i;
  if (!worst) return false;

  // The fault lies between the last observed second before it and this one.
  std::size_t first = worst->block;
  while (first > 0 && !recording.blocks[first - 1].whole_second) --first;
  const bool in_rotation = first != worst->block;
  Break cut;
  cut.block = first;
  if (!in_rotation) cut.attitude_sigma_rad = 0.02;
  for (const Break& b : breaks)
    if (b.block == cut.block && b.attitude_sigma_rad >= cut.attitude_sigma_rad)
      return false;  // cut there already: the chain is not the cause
  Fault fault;
  fault.block = first;
  fault.first_sample = recording.blocks[first].start_sample;
  fault.last_sample = recording.blocks[worst->block].start_sample + recording.blocks[worst->block].samples - 1;
  const double step = worst->velocity_mps.y();
  const double of_one_sample = recording.info.gravity_mps2 * recording.info.sample_period_s;
  const double ratio = step / of_one_sample;
  if (in_rotation && std::abs(std::abs(ratio) - std::round(std::abs(ratio))) < 0.1 && std::abs(ratio) > 0.9 &&
      std::abs(ratio) < 20.0)
    fault.what = fmt::format("{:.0f} sample(s) of gravity {}", std::abs(std::round(ratio)),
                             ratio < 0.0 ? "missing (velocity step down)" : "too many (velocity step up)");
  else
    fault.what = fmt::format("velocity step of {:.3g} m/s that no noise explains", worst->velocity_mps.norm());
  fault.action = action_for(cut);
  fault.step_mps = worst->velocity_mps.norm();
  faults.push_back(fault);
  add_break(breaks, cut);
  return true;
}

}  // namespace turncal
