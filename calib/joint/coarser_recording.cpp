#include "calib/joint/joint_filter.h"

#include <algorithm>

namespace turncal {
namespace {

class Merger {
 public:
  Merger(const CompressedRecording& recording, const Coarseness& coarseness, const FilterSetup& setup)
      : blocks_(recording.blocks),
        coarseness_(coarseness),
        setup_(setup),
        turn_counts_(coarseness.turn_rad / nominal_gyro_rad(recording.info)) {}

  // Returns the end of the merged block that begins at `first`.
  std::size_t end_of(std::size_t first) {
    if (first >= rest_end_ && blocks_[first].whole_second) find_rest(first);
    Eigen::Vector3d turned = blocks_[first].gyro;
    double length_s = blocks_[first].duration_s;
    const double longest_s = blocks_[first].whole_second ? longest_at(first) : longest_turn_s;
    std::size_t end = first + 1;
    for (; end < blocks_.size() && may_join(first, end); ++end) {
      const Block& next = blocks_[end];
      if (length_s + next.duration_s > longest_s + 0.5 * next.duration_s) break;
      if (!next.whole_second && (turned + next.gyro).norm() > turn_counts_) break;
      turned += next.gyro;
      length_s += next.duration_s;
    }
    return end;
  }

 private:
  static constexpr double longest_turn_s = 0.5;

  bool may_join(std::size_t first, std::size_t next) {
    while (cut_ < setup_.breaks.size() && setup_.breaks[cut_].block <= first) ++cut_;
    const Block& a = blocks_[first];
    const Block& b = blocks_[next];
    return b.segment == a.segment && b.whole_second == a.whole_second && a.missing == 0 && b.missing == 0 &&
           (cut_ == setup_.breaks.size() || setup_.breaks[cut_].block > next) &&
           (setup_.unobserved.empty() || setup_.unobserved[next] == setup_.unobserved[first]);
  }

  void find_rest(std::size_t first) {
    rest_begin_ = rest_end_ = first;
    while (rest_end_ < blocks_.size() && blocks_[rest_end_].whole_second) ++rest_end_;
  }

  // Blocks at rest are equally long, so their number gives the time since the last turn and to the next.
  double longest_at(std::size_t first) const {
    const double block_s = blocks_[first].duration_s;
    const double since = double(first - rest_begin_) * block_s;
    const double left = double(rest_end_ - first) * block_s;
    return std::clamp(std::min(since, 0.5 * left), block_s, std::max(coarseness_.rest_s, block_s));
  }

  const std::vector<Block>& blocks_;
  const Coarseness coarseness_;
  const FilterSetup& setup_;
  const double turn_counts_;
  std::size_t cut_ = 0;
  std::size_t rest_begin_ = 0, rest_end_ = 0;
};

}  // namespace

CompressedRecording coarser(const CompressedRecording& recording, const Coarseness& coarseness, FilterSetup& setup) {
  CompressedRecording result{recording.info,    recording.segments,          {}, {},
                             recording.samples, recording.mean_temperature_c};
  const FilterSetup of_all = setup;
  setup.unobserved.clear();
  Merger merger(recording, coarseness, of_all);
  std::size_t cut = 0;
  for (std::size_t first = 0; first < recording.blocks.size();) {
    const std::size_t end = merger.end_of(first);
    for (; cut < setup.breaks.size() && setup.breaks[cut].block < end; ++cut)
      setup.breaks[cut].block = result.blocks.size();
    if (!of_all.unobserved.empty()) setup.unobserved.push_back(of_all.unobserved[first]);
    Block block = recording.blocks[first];
    for (std::size_t k = first + 1; k < end; ++k) block = merge(block, recording.blocks[k]);
    result.blocks.push_back(block);
    first = end;
  }
  return result;
}

}  // namespace turncal
