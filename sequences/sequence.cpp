// Sequences as files, and one after another.
#include "sequences/sequence.h"

#include <algorithm>
#include <array>

#include "imu_io/base/posix_file.h"

namespace turncal {

namespace {

constexpr std::size_t largest_file_bytes = 1'000'000;

// From the inner axis outwards.
constexpr std::array<Axis, 3> approach_order = {Axis::roll, Axis::pitch, Axis::heading};

}  // namespace

std::vector<SequenceItem> approach(const AxisTriple& from_deg, const AxisTriple& to_deg, double rate_degps,
                                   double acceleration_degps2, int line) {
  std::vector<SequenceItem> moves;
  for (const Axis axis : approach_order) {
    if (from_deg[axis] == to_deg[axis]) continue;
    SequenceItem item;
    item.kind = SequenceItem::Kind::move;
    item.move = {axis, to_deg[axis], rate_degps, acceleration_degps2};
    item.line = line;
    item.positioning = true;
    moves.push_back(item);
  }
  return moves;
}

Result<Sequence> read_sequence(const std::string& path) {
  const Result<std::string> text = read_whole_file(path, largest_file_bytes);
  return text ? parse_sequence(*text, path) : text.error();
}

void append_steps(const Sequence& more, Sequence& sequence) {
  AxisTriple stands_deg = sequence.start_deg;
  int number = 0;
  for (const Step& step : sequence.steps) {
    number = std::max(number, step.number);
    for (const SequenceItem& item : step.items)
      if (item.kind == SequenceItem::Kind::move) stands_deg[item.move.axis] = item.move.target_deg;
  }
  for (const Step& step : more.steps) {
    sequence.steps.push_back(step);
    sequence.steps.back().number = ++number;
    sequence.steps.back().file = more.file;
    if (&step != &more.steps.front()) continue;
    const std::vector<SequenceItem> moves =
        approach(stands_deg, step.initial_deg, more.rate_degps, more.acceleration_degps2, step.line);
    std::vector<SequenceItem>& items = sequence.steps.back().items;
    items.insert(items.begin(), moves.begin(), moves.end());
  }
}

}  // namespace turncal
