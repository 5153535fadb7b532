#include "calib/statistics/compression.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>

#include "calib/model/effects.h"
#include "calib/model/limits.h"
#include "calib/model/parameters.h"
#include "calib/statistics/clipping.h"
#include "calib/statistics/numerics.h"

namespace turncal {

namespace {

// In a segment called at rest the unit may still turn (a table that settles, a hand that lets go late). A block that
// turns faster than this against the median of its segment is no rest, nor are its neighbours.
constexpr double turning_radps = 0.003;

void leave_out_turning(const RecordingInfo& info, std::span<Block> blocks) {
  Eigen::Vector3d usual;
  std::vector<double> rates;
  for (int axis = 0; axis < 3; ++axis) {
    rates.clear();
    for (const Block& b : blocks)
      if (b.whole_second) rates.push_back(b.gyro[axis] / b.duration_s);
    if (rates.size() < 8) return;
    usual[axis] = median(rates);
  }
  const double limit = turning_radps / nominal_gyro_rad(info);
  std::vector<std::size_t> turning;
  for (std::size_t k = 0; k < blocks.size(); ++k)
    if ((blocks[k].gyro / blocks[k].duration_s - usual).norm() > limit) turning.push_back(k);
  if (turning.size() > blocks.size() / 4) return;  // noise that loud, or no rest at all: not decided here
  for (const std::size_t k : turning)
    for (std::size_t i = k > 0 ? k - 1 : k; i <= k + 1 && i < blocks.size(); ++i) blocks[i].whole_second = false;
}

// Neighbouring blocks of a turn at one rate are merged up to this: gravity is exact there to the fifth order (block_motion.h).
constexpr double steady_angle_rad = 0.05, steady_s = 0.5;

// Does the unit turn beside the next sample: in its segment, or in that of the last sample?
bool turns_beside(const CompressedRecording& recording, const Block& open) {
  if (recording.segments.back().kind == SegmentKind::rotate) return true;
  if (open.samples > 0 || recording.blocks.empty()) return false;
  return recording.rotates(recording.blocks.back());
}

bool at_one_rate(const Block& a, const Block& b) {
  // In a long block 4e-4 of the 2.8 m/s gained is of third order, and this part of it is unknown.
  constexpr double alike = 0.003;
  const Eigen::Vector3d rate = a.gyro / a.duration_s;
  return (b.gyro / b.duration_s - rate).norm() < alike * rate.norm();
}

void note_set_aside(std::int64_t counter, const Segment& segment, std::vector<DataEvent>& events) {
  const auto last =
      std::find_if(events.rbegin(), events.rend(), [](const DataEvent& e) { return e.axis == set_aside_axis; });
  if (last != events.rend() && last->sample >= segment.start_sample)
    last->count = counter + 1 - last->sample;
  else
    events.push_back({DataEvent::Kind::invalid, counter, 1, set_aside_axis, 0.0});
}

// Fills the temperature of blocks without a reading (the thermometer is read less often than blocks end): linear in
// time between the blocks that have one, constant before the first and after the last.
void fill_temperature(std::vector<Block>& blocks) {
  const auto measured = [&](std::size_t k) { return !std::isnan(blocks[k].temperature_c); };
  const auto middle = [&](std::size_t k) {
    return double(blocks[k].start_sample) + 0.5 * (blocks[k].samples + blocks[k].missing);
  };
  std::size_t before = blocks.size();  // none yet
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    if (measured(k)) {
      before = k;
      continue;
    }
    std::size_t after = k;
    while (after < blocks.size() && !measured(after)) ++after;
    if (after == blocks.size() && before == blocks.size()) return;
    for (; k < after; ++k) {
      if (before == blocks.size()) {
        blocks[k].temperature_c = blocks[after].temperature_c;
      } else if (after == blocks.size()) {
        blocks[k].temperature_c = blocks[before].temperature_c;
      } else {
        const double part = (middle(k) - middle(before)) / (middle(after) - middle(before));
        blocks[k].temperature_c =
            float((1.0 - part) * double(blocks[before].temperature_c) + part * double(blocks[after].temperature_c));
      }
    }
    before = after;
  }
}

// Sets dT/dt in the middle of each block: the slope of the quadratic fitted to the temperatures of two minutes about it (Savitzky
// and Golay, Anal. Chem. 36 (1964) 1627); at either end of the recording, to those of its first or last two minutes.
void add_temperature_rates(CompressedRecording& recording) {
  constexpr double half_s = 60.0;
  std::vector<Block>& blocks = recording.blocks;
  if (blocks.size() < 3 || std::isnan(blocks.front().temperature_c)) return;
  const auto middle_s = [&](std::size_t k) { return recording.middle_s(blocks[k]); };
  const double last_s = middle_s(blocks.size() - 1) - half_s;
  // Sums over [first, end), about the middle of block k: durations times powers of u, and those times the temperature.
  double m[5] = {};
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  std::size_t first = 0, end = 0;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const double at_s = middle_s(k), about_s = std::max(std::min(at_s, last_s), half_s);
    const auto take = [&](std::size_t i, double sign) {
      const double u = (middle_s(i) - at_s) / half_s, u2 = u * u, t = sign * blocks[i].duration_s;
      m[0] += t, m[1] += t * u, m[2] += t * u2, m[3] += t * u2 * u, m[4] += t * u2 * u2;
      right += t * (blocks[i].temperature_c - blocks.front().temperature_c) * Eigen::Vector3d(1.0, u, u2);
    };
    if (k > 0) {  // moves the sums to the new middle
      const double d = (middle_s(k - 1) - at_s) / half_s;
      for (int times = 1; times <= 4; ++times)
        for (int p = 4; p >= times; --p) m[p] += d * m[p - 1];
      for (int times = 1; times <= 2; ++times)
        for (int p = 2; p >= times; --p) right[p] += d * right[p - 1];
    }
    while (end < blocks.size() && (end < 3 || middle_s(end) <= about_s + half_s)) take(end++, 1.0);
    while (first + 3 < end && middle_s(first) < about_s - half_s) take(first++, -1.0);
    const Eigen::Matrix3d normal{{m[0], m[1], m[2]}, {m[1], m[2], m[3]}, {m[2], m[3], m[4]}};
    blocks[k].temperature_rate_c_per_h = float(normal.ldlt().solve(right)[1] / half_s * 3600.0);
  }
}

}  // namespace

void take_temperature(const Block& block, double reference_c, BlockState& state) {
  state.temperature_c = std::isnan(block.temperature_c) ? 0.0 : block.temperature_c - reference_c;
  state.temperature_rate_c_per_h = block.temperature_rate_c_per_h;
}

Block merge(const Block& a, const Block& b) {
  Block m = a;
  const double total = double(a.samples + b.samples);
  const auto mean = [&](float of_a, float of_b) {
    return float((double(of_a) * a.samples + double(of_b) * b.samples) / total);
  };
  m.samples += b.samples;
  m.missing += b.missing;
  if (std::isnan(a.temperature_c))
    m.temperature_c = b.temperature_c;
  else if (!std::isnan(b.temperature_c))
    m.temperature_c = mean(a.temperature_c, b.temperature_c);
  m.temperature_rate_c_per_h = mean(a.temperature_rate_c_per_h, b.temperature_rate_c_per_h);
  m.gyro_filled += b.gyro_filled;
  m.accel_filled += b.accel_filled;
  m.duration_s += b.duration_s;
  m.gyro += b.gyro;
  m.accel += b.accel;
  m.gyro_time += b.gyro_time + a.duration_s * b.gyro;
  m.accel_time += b.accel_time + a.duration_s * b.accel;
  m.coning += b.coning + a.gyro.cross(b.gyro);
  m.sculling += b.sculling + a.gyro * b.accel.transpose();
  return m;
}

Compressor::Compressor(const RecordingInfo& info, const CompressionOptions& options)
    : options_(options), spikes_(info), filler_(info), glitches_(info, options.glitch) {
  recording_.info = info;
  static_block_samples_ = std::max(1, int(std::lround(options.static_block_s / info.sample_period_s)));
  static_counts_ = options.static_angle_rad / nominal_gyro_rad(info);
  rotation_counts_ = options.block_angle_rad / nominal_gyro_rad(info);
  square_of_even_rate_ = 11.0 / 60.0 * std::pow(nominal_gyro_rad(info), 2);
}

void Compressor::begin_segment(const Segment& segment) {
  assert(!in_segment_);
  in_segment_ = true;
  filler_.begin_segment();
  recording_.segments.push_back(segment);
}

void Compressor::end_segment(SegmentKind final_kind, std::int64_t end_sample) {
  assert(in_segment_);
  close_block();
  in_segment_ = false;
  Segment& segment = recording_.segments.back();
  segment.end_sample = end_sample;
  if (segment.kind != final_kind) {
    // A dwell that did not count: it may not be a rest, so no block of it is a static second.
    const int index = int(recording_.segments.size()) - 1;
    for (auto block = recording_.blocks.rbegin(); block != recording_.blocks.rend() && block->segment == index; ++block)
      block->whole_second = false;
    segment.kind = final_kind;
  } else if (final_kind != SegmentKind::rotate && options_.leaves_out_turning) {
    const std::int32_t index = std::int32_t(recording_.segments.size()) - 1;
    auto first = recording_.blocks.end();
    while (first != recording_.blocks.begin() && std::prev(first)->segment == index) --first;
    leave_out_turning(recording_.info, std::span(first, recording_.blocks.end()));
  }
}

void Compressor::add(std::span<const ImuSample> samples) {
  assert(in_segment_ || samples.empty());
  for (const ImuSample& sample : samples) add_one(sample);
}

void Compressor::add_one(const ImuSample& sample) {
  std::int64_t gap = 0;
  if (recording_.samples > 0 && sample.counter != next_counter_) {
    if (sample.counter < next_counter_) {  // a duplicate is not counted again
      recording_.events.push_back({DataEvent::Kind::duplicate, sample.counter, 1, -1, 0.0});
      return;
    }
    gap = sample.counter - next_counter_;
  }
  if (leave_out(sample)) return;
  const bool filled = gap > 0 && fill(sample, gap);
  if (gap > left_out_) recording_.events.push_back({DataEvent::Kind::gap, next_counter_, gap - left_out_, -1, 0.0});
  for (auto e = recording_.events.rbegin(); filled && e != recording_.events.rend() && e->sample >= next_counter_; ++e)
    e->filled = true;
  left_out_ = 0;
  const auto missing = filled ? 0 : std::int32_t(std::min<std::int64_t>(gap, 1 << 20));
  if ((sample.flags & sample_flag_invalid) != 0)
    recording_.events.push_back({DataEvent::Kind::invalid, sample.counter, 1, -1, 0.0});
  if ((sample.flags & sample_flag_set_aside) != 0)
    note_set_aside(sample.counter, recording_.segments.back(), recording_.events);
  // Across a gap in a turn the neighbours are unknown: the turn went on.
  if (gap > 0 && turns_beside(recording_, block_)) glitches_.forget_neighbours(sample);
  glitches_.add(sample, recording_.events);
  next_counter_ = sample.counter + 1;
  ++recording_.samples;

  const Eigen::Vector3d alpha(sample.gyro[0], sample.gyro[1], sample.gyro[2]);
  const Eigen::Vector3d beta(sample.accel[0], sample.accel[1], sample.accel[2]);
  open_block(sample.counter, missing);
  add_sums(alpha, beta, missing > 0);
  add_temperature(sample);
  filler_.add(channels_of(sample));
  close_full_block();
}

void Compressor::open_block(std::int64_t counter, std::int32_t missing) {
  if (block_.samples == 0) {
    block_.start_sample = counter - missing;
    block_.segment = std::int32_t(recording_.segments.size()) - 1;
  }
  block_.missing += missing;
}

void Compressor::add_sums(const Eigen::Vector3d& alpha, const Eigen::Vector3d& beta, bool behind_a_gap) {
  Block& b = block_;
  const bool goes_on = have_previous_ && !behind_a_gap;
  if (b.samples == 0) b.gyro_at_start = goes_on ? (0.5 * (previous_gyro_ + alpha)).eval() : alpha;
  // The motion within this sample and the one before it, as far as the two determine it.
  double within = 0.0;
  if (goes_on) {
    within = within_sample(alpha);
    if (b.samples > 0)
      within += within_sample(previous_gyro_);
    else
      add_to_closed_block(alpha, beta);
  }
  have_previous_ = true;
  const double s = (double(b.samples + b.missing) + 0.5) * recording_.info.sample_period_s;
  const Eigen::Vector3d before = within * previous_gyro_;
  b.coning += (b.gyro + 2.0 * before).cross(alpha);
  b.sculling += (b.gyro + 0.5 * alpha + before) * beta.transpose() - (within * alpha) * previous_accel_.transpose();
  b.gyro += alpha;
  b.accel += beta;
  b.gyro_time += s * alpha;
  b.accel_time += s * beta;
  ++b.samples;
  previous_gyro_ = alpha;
  previous_accel_ = beta;
}

void Compressor::close_full_block() {
  const bool still = recording_.segments.back().kind != SegmentKind::rotate;
  const double most_counts = still ? static_counts_ : rotation_counts_;
  if (block_.samples + block_.missing >= (still ? static_block_samples_ : options_.block_samples) ||
      block_.gyro.squaredNorm() > most_counts * most_counts)
    close_block();
}

// Adds what this sample tells of the motion within the one before it, in a closed block.
void Compressor::add_to_closed_block(const Eigen::Vector3d& alpha, const Eigen::Vector3d& beta) {
  const double within = within_sample(previous_gyro_);
  Block& before = recording_.blocks.back();
  before.coning += 2.0 * within * previous_gyro_.cross(alpha);
  before.sculling += within * (previous_gyro_ * beta.transpose() - alpha * previous_accel_.transpose());
}

// Fills no gap at the border of a segment: an interrupted run resumes behind one, and the unit may have been moved.
bool Compressor::fill(const ImuSample& next, std::int64_t gap) {
  if (gap > fault_limits.most_filled || !filler_.can_fill()) return false;
  const bool at_rest = recording_.segments.back().kind != SegmentKind::rotate;
  const GapFill between = filler_.fill(next, gap, at_rest, glitches_.mean_square());
  const Eigen::Matrix<float, 6, 1> variance = (between.variance / double(gap)).cast<float>();
  Channels x = between.first;
  for (int k = 0; k < gap; ++k, x += between.step) {
    open_block(next_counter_ + k, 0);
    add_sums(x.head<3>(), x.tail<3>(), false);
    block_.gyro_filled += variance.head<3>();
    block_.accel_filled += variance.tail<3>();
    close_full_block();
  }
  return true;
}

bool Compressor::leave_out(const ImuSample& sample) {
  const std::optional<std::size_t> channel = spikes_.spike_in(sample);
  if (!channel) return false;
  const auto kind = *channel < 3 ? DataEvent::Kind::gyro_glitch : DataEvent::Kind::accel_glitch;
  recording_.events.push_back({kind, sample.counter, 1, int(*channel % 3), channel_of(sample, *channel), true});
  ++left_out_;
  return true;
}

void Compressor::add_temperature(const ImuSample& sample) {
  if (std::isnan(sample.temperature_c)) return;
  if (!temperature_can_be(sample.temperature_c)) {
    if (impossible_temperature_ < 0) {
      impossible_temperature_ = std::ssize(recording_.events);
      recording_.events.push_back({DataEvent::Kind::temperature, sample.counter, 0, -1, sample.temperature_c});
    }
    ++recording_.events[impossible_temperature_].count;
    return;
  }
  temperature_sum_ += sample.temperature_c;
  temperature_total_ += sample.temperature_c;
  ++temperature_count_;
  block_.temperature_c += 1.0F;  // while the block is open: how many samples have a temperature
}

void Compressor::close_block() {
  if (block_.samples == 0) return;
  block_.duration_s = double(block_.samples + block_.missing) * recording_.info.sample_period_s;
  block_.whole_second = recording_.segments.back().kind != SegmentKind::rotate && block_.missing == 0 &&
                        block_.samples >= static_block_samples_;
  const auto measured = double(block_.temperature_c);
  block_.temperature_c = measured > 0.0 ? float(temperature_sum_ / measured) : std::numeric_limits<float>::quiet_NaN();
  Block* const last = recording_.blocks.empty() ? nullptr : &recording_.blocks.back();
  const double most_counts = steady_angle_rad / nominal_gyro_rad(recording_.info);
  if (last != nullptr && recording_.segments.back().kind == SegmentKind::rotate && last->segment == block_.segment &&
      last->missing == 0 && block_.missing == 0 && last->duration_s + block_.duration_s <= steady_s &&
      (last->gyro + block_.gyro).squaredNorm() < most_counts * most_counts && at_one_rate(*last, block_))
    *last = merge(*last, block_);
  else
    recording_.blocks.push_back(block_);
  block_ = Block{};
  temperature_sum_ = 0.0;
}

CompressedRecording Compressor::take() {
  close_block();
  fill_temperature(recording_.blocks);
  add_temperature_rates(recording_);
  if (temperature_count_ == 0) recording_.info.has_temperature = false;
  recording_.mean_temperature_c = temperature_count_ > 0 ? temperature_total_ / double(temperature_count_)
                                                         : std::numeric_limits<double>::quiet_NaN();
  return std::move(recording_);
}

void SegmentedFeed::add(std::span<const ImuSample> samples) {
  while (!samples.empty() && index_ < segments_.size()) {
    const Segment& segment = segments_[index_];
    if (!open_) {
      compressor_.begin_segment(segment);
      open_ = true;
    }
    // Duplicates keep their counter, so the border is searched in the chunk rather than computed.
    const auto border =
        std::ranges::find_if(samples, [&](const ImuSample& s) { return s.counter >= segment.end_sample; });
    const std::size_t count = std::size_t(border - samples.begin());
    compressor_.add(samples.first(count));
    samples = samples.subspan(count);
    if (samples.empty()) return;
    compressor_.end_segment(segment.kind, segment.end_sample);
    open_ = false;
    ++index_;
  }
}

void SegmentedFeed::finish() {
  if (open_) compressor_.end_segment(segments_[index_].kind, segments_[index_].end_sample);
  open_ = false;
}

GapFill GapFiller::fill(const ImuSample& next, std::int64_t lost, bool at_rest, const Channels& mean_square) const {
  const auto n = double(lost);
  Channels first, step, variance;
  if (at_rest && seen_ >= memory) {
    Channels square = Channels::Zero();
    first.setZero();
    for (const Channels& sample : samples_) first += sample / double(memory);
    for (const Channels& sample : samples_) square += (sample - first).cwiseAbs2() / double(memory - 1);
    step.setZero();
    for (int k = 0; k < 6; ++k) {
      const double part = n * first[k] - std::floor(n * first[k]);
      constexpr double of_rounding = 1.0 / 6.0;  // at both ends of a noisy count
      variance[k] = n * square[k];
      if (counted_[k / 3]) variance[k] = std::min(variance[k], std::max(part * (1.0 - part), of_rounding));
      variance[k] += n * n * square[k] / double(memory);
    }
  } else {
    constexpr double corner = 20.0;  // one in 300 of white noise, whose changes of slope have a mean square of 7/3 D
    const Channels& last = samples_[(seen_ - 1) % memory];
    const Channels& before = samples_[(seen_ - 2) % memory];
    step = (channels_of(next) - last) / (n + 1.0);
    first = last + step;
    const Channels change = (step - (last - before)).cwiseAbs2();
    for (int k = 0; k < 6; ++k)
      variance[k] =
          (n + 0.5 * n * n) * mean_square[k] / 1.5 + (change[k] > corner * mean_square[k] ? n * n * change[k] : 0.0);
  }
  return {first, step, variance};
}

}  // namespace turncal
