// The sums of a block against code that is as slow and as near to the definitions in compression.h as possible, and
// what the Compressor says about samples that are missing, double, marked or out of line.
#include "calib/statistics/compression.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "calib/model/parameters.h"
#include "tests/calib/compress.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Kind = DataEvent::Kind;

constexpr double dt = 0.005;

RecordingInfo pulses_info() {
  RecordingInfo info;
  info.sample_period_s = dt;
  info.accel_pulse_mps = 0.0005;
  return info;
}

// Samples of a unit at rest with one pulse of jitter: 14 gyro and 96 accelerometer pulses on y.
std::vector<ImuSample> quiet_samples(std::size_t count, unsigned seed = 7) {
  std::mt19937 random(seed);
  std::vector<ImuSample> samples(count);
  for (std::size_t i = 0; i < count; ++i) {
    samples[i].counter = static_cast<std::int64_t>(i);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      samples[i].gyro[axis] = static_cast<double>(random() % 3) - 1.0 + (axis == 1 ? 14.0 : 0.0);
      samples[i].accel[axis] = static_cast<double>(random() % 3) - 1.0 + (axis == 1 ? 96.0 : 0.0);
    }
  }
  return samples;
}

// A unit that turns about all axes: 180 pulses a sample is 10 deg/s.
std::vector<ImuSample> turning_samples(std::size_t count) {
  std::vector<ImuSample> samples = quiet_samples(count, 8);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * dt;
    samples[i].gyro[0] += std::round(180.0 * std::sin(3.0 * t));
    samples[i].gyro[1] += std::round(120.0 * std::cos(2.0 * t));
    samples[i].gyro[2] += std::round(90.0 * t);
    samples[i].accel[2] += std::round(40.0 * t);
  }
  return samples;
}

Segment segment(SegmentKind kind, std::int64_t start, std::int64_t end, int step = 1) {
  Segment s;
  s.step = step;
  s.kind = kind;
  s.start_sample = start;
  s.end_sample = end;
  return s;
}

Vector3d gyro_of(const ImuSample& s) { return {s.gyro[0], s.gyro[1], s.gyro[2]}; }
Vector3d accel_of(const ImuSample& s) { return {s.accel[0], s.accel[1], s.accel[2]}; }

// The definitions, term by term. `all`: without a gap.
Block naive(const std::vector<ImuSample>& all, std::size_t begin, std::size_t end) {
  Block b;
  const double rad = nominal_gyro_rad(pulses_info());
  const auto outer = [&](std::size_t i) -> Matrix3d {  // K of samples i and i + 1
    return gyro_of(all[i]) * accel_of(all[i + 1]).transpose() - gyro_of(all[i + 1]) * accel_of(all[i]).transpose();
  };
  const auto cross = [&](std::size_t i) -> Vector3d { return gyro_of(all[i]).cross(gyro_of(all[i + 1])); };
  for (std::size_t i = begin; i < end; ++i) {
    Vector3d theta = Vector3d::Zero();
    for (std::size_t j = begin; j < i; ++j) theta += gyro_of(all[j]);
    const Vector3d alpha = gyro_of(all[i]), beta = accel_of(all[i]);
    const double middle_s = (static_cast<double>(i - begin) + 0.5) * dt;
    const double k = 1.0 + 11.0 / 60.0 * (rad * alpha).squaredNorm();
    b.gyro += alpha;
    b.accel += beta;
    b.gyro_time += middle_s * alpha;
    b.accel_time += middle_s * beta;
    b.coning += theta.cross(alpha);
    b.sculling += (theta + alpha / 2.0) * beta.transpose();
    if (i > 0) b.coning += k * cross(i - 1) / 12.0, b.sculling += k * outer(i - 1) / 24.0;
    if (i + 1 < all.size()) b.coning += k * cross(i) / 12.0, b.sculling += k * outer(i) / 24.0;
  }
  b.samples = static_cast<std::int32_t>(end - begin);
  b.duration_s = static_cast<double>(end - begin) * dt;
  return b;
}

// Counts are whole numbers, and what is not sums only a few thousand terms: rounding is far below 1e-12 of the size.
template <class A, class B>
void expect_same(const A& value, const B& expected, const char* what) {
  EXPECT_LE((value - expected).norm(), 1e-12 * (1.0 + expected.norm())) << what;
}
void expect_same_sums(const Block& block, const Block& expected) {
  expect_same(block.gyro, expected.gyro, "gyro");
  expect_same(block.accel, expected.accel, "accel");
  expect_same(block.gyro_time, expected.gyro_time, "gyro_time");
  expect_same(block.accel_time, expected.accel_time, "accel_time");
  expect_same(block.coning, expected.coning, "coning");
  expect_same(block.sculling, expected.sculling, "sculling");
  EXPECT_EQ(block.samples, expected.samples);
  EXPECT_DOUBLE_EQ(block.duration_s, expected.duration_s);
}

TEST(Compression, SumsOfStaticSecondsAreThoseOfTheDefinition) {
  const std::vector<ImuSample> samples = quiet_samples(1000);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  ASSERT_EQ(r.blocks.size(), 5u);
  for (std::size_t k = 0; k < 5; ++k) {
    EXPECT_TRUE(r.blocks[k].whole_second);
    EXPECT_EQ(r.blocks[k].start_sample, static_cast<std::int64_t>(200 * k));
    expect_same_sums(r.blocks[k], naive(samples, 200 * k, 200 * k + 200));
  }
  EXPECT_EQ(r.samples, 1000);
  EXPECT_TRUE(r.events.empty());
}

TEST(Compression, SumsOfRotationsAreThoseOfTheDefinition) {
  const std::vector<ImuSample> samples = turning_samples(1500);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::rotate, 0, 1500)}, samples);
  std::size_t begin = 0;
  for (const Block& block : r.blocks) {
    const std::size_t end = begin + static_cast<std::size_t>(block.samples);
    expect_same_sums(block, naive(samples, begin, end));
    EXPECT_FALSE(block.whole_second);
    // closed by the twentieth sample or by the one that took it over 0.012 rad = 2653.2 pulses of 0.93292 arcsec; of a moment of even
    // rate two or more together
    const bool together = block.samples > 20 || block.gyro.norm() > 4000.0;
    if (!together) {
      EXPECT_LT(naive(samples, begin, end - 1).gyro.norm(), 2653.3);
    }
    if (block.samples < 20 && end < 1500) {
      EXPECT_GT(block.gyro.norm(), 2653.1);
    }
    begin = end;
  }
  EXPECT_EQ(begin, 1500u);
}

// 10 deg/s about x: 57 samples are 0.05 rad. Where the rate changes blocks stay short.
TEST(Compression, ASteadyTurnHasLongBlocks) {
  std::vector<ImuSample> samples = quiet_samples(2000);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].gyro[0] = i < 200 ? std::round(0.965 * static_cast<double>(i)) : 193.0;
    samples[i].gyro[1] = samples[i].gyro[2] = 0.0;
  }
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::rotate, 0, 2000)}, samples);
  std::size_t begin = 0, longest_of_rise = 0, shortest_of_turn = samples.size();
  for (const Block& block : r.blocks) {
    const std::size_t length = static_cast<std::size_t>(block.samples), end = begin + length;
    expect_same_sums(block, naive(samples, begin, end));
    EXPECT_LT(block.gyro.norm(), 11055.1);  // 0.05 rad
    if (end < 200) longest_of_rise = std::max(longest_of_rise, length);
    if (begin > 250 && end < 2000) shortest_of_turn = std::min(shortest_of_turn, length);
    begin = end;
  }
  EXPECT_EQ(begin, 2000u);
  EXPECT_LE(longest_of_rise, 20u);
  EXPECT_GE(shortest_of_turn, 42u);  // three of 14 samples, 2702 pulses each
}

TEST(Compression, MergedBlocksAreTheBlockOfBoth) {
  const std::vector<ImuSample> samples = turning_samples(40);
  CompressionOptions long_blocks;
  long_blocks.block_samples = 40;
  long_blocks.block_angle_rad = 1.0;
  const Segments segments = {segment(SegmentKind::rotate, 0, 40)};
  const CompressedRecording one = compress(pulses_info(), segments, samples, long_blocks);
  const CompressedRecording parts = compress(pulses_info(), segments, samples);
  ASSERT_EQ(one.blocks.size(), 1u);
  ASSERT_GE(parts.blocks.size(), 2u);
  Block merged = parts.blocks[0];
  for (std::size_t k = 1; k < parts.blocks.size(); ++k) merged = merge(merged, parts.blocks[k]);
  expect_same_sums(merged, one.blocks[0]);
}

TEST(Compression, BlocksEndAtSegmentBorders) {
  const std::vector<ImuSample> samples = quiet_samples(1000);
  const Segments segments = {segment(SegmentKind::align, 0, 250), segment(SegmentKind::rotate, 250, 305),
                             segment(SegmentKind::still, 305, 1000)};
  const CompressedRecording r = compress(pulses_info(), segments, samples);
  // 200 + 50 | 20 + 20 + 15 | 200 + 200 + 200 + 95
  const std::vector<int> lengths = {200, 50, 20, 20, 15, 200, 200, 200, 95};
  const std::vector<int> owners = {0, 0, 1, 1, 1, 2, 2, 2, 2};
  ASSERT_EQ(r.blocks.size(), lengths.size());
  for (std::size_t k = 0; k < lengths.size(); ++k) {
    EXPECT_EQ(r.blocks[k].samples, lengths[k]) << k;
    EXPECT_EQ(r.blocks[k].segment, owners[k]) << k;
    EXPECT_EQ(r.blocks[k].whole_second, lengths[k] == 200) << k;
  }
}

TEST(Compression, ChunksOfAnySizeGiveTheSame) {
  const std::vector<ImuSample> samples = turning_samples(1000);
  const Segments segments = {segment(SegmentKind::still, 0, 400), segment(SegmentKind::rotate, 400, 707),
                             segment(SegmentKind::still, 707, 1000)};
  const CompressedRecording whole = compress(pulses_info(), segments, samples);
  for (const std::size_t size : {1u, 7u, 200u, 307u, 999u}) {
    Compressor compressor(pulses_info());
    SegmentedFeed feed(compressor, segments);
    for (std::size_t i = 0; i < samples.size(); i += size)
      feed.add(std::span(samples).subspan(i, std::min(size, samples.size() - i)));
    feed.finish();
    const CompressedRecording r = compressor.take();
    ASSERT_EQ(r.blocks.size(), whole.blocks.size()) << size;
    EXPECT_EQ(r.segments.size(), 3u);
    for (std::size_t k = 0; k < r.blocks.size(); ++k) {
      EXPECT_EQ(r.blocks[k].coning, whole.blocks[k].coning);  // the same operations: the same bits
      EXPECT_EQ(r.blocks[k].sculling, whole.blocks[k].sculling);
    }
  }
}

TEST(Compression, SamplesOutsideTheSegmentsAreLeftOut) {
  const std::vector<ImuSample> samples = quiet_samples(900);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 600)}, samples);
  EXPECT_EQ(r.samples, 600);
}

TEST(Compression, ADwellThatDidNotCountHasNoStaticSecond) {
  const std::vector<ImuSample> samples = quiet_samples(800);
  Compressor compressor(pulses_info());
  compressor.begin_segment(segment(SegmentKind::still, 0, 400));
  compressor.add(std::span(samples).first(400));
  compressor.end_segment(SegmentKind::rotate, 400);
  compressor.begin_segment(segment(SegmentKind::still, 400, 800));
  compressor.add(std::span(samples).subspan(400));
  compressor.end_segment(SegmentKind::still, 800);
  const CompressedRecording r = compressor.take();
  ASSERT_EQ(r.blocks.size(), 4u);
  EXPECT_EQ(r.segments[0].kind, SegmentKind::rotate);
  EXPECT_FALSE(r.blocks[0].whole_second);
  EXPECT_FALSE(r.blocks[1].whole_second);
  EXPECT_TRUE(r.blocks[2].whole_second);
  EXPECT_TRUE(r.blocks[3].whole_second);
}

// block_motion.h is good for a tenth of a radian: a unit that is turned in a dwell must not make longer blocks.
TEST(Compression, AUnitMovedInADwellMakesShortBlocks) {
  std::vector<ImuSample> samples = quiet_samples(400);
  for (std::size_t i = 0; i < 200; ++i) samples[i].gyro[2] += 190.0;  // 10 deg/s
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 400)}, samples);
  EXPECT_LT(r.blocks[0].gyro.norm() * 4.51e-6, 0.102);
  EXPECT_FALSE(r.blocks[0].whole_second);
}

TEST(Compression, MeanTemperature) {
  RecordingInfo info = pulses_info();
  info.has_temperature = true;
  std::vector<ImuSample> samples = quiet_samples(400);
  for (std::size_t i = 0; i < 400; ++i) samples[i].temperature_c = i < 200 ? 24.0F : 26.0F;
  const CompressedRecording r = compress(info, {segment(SegmentKind::still, 0, 400)}, samples);
  EXPECT_FLOAT_EQ(r.blocks[0].temperature_c, 24.0F);
  EXPECT_FLOAT_EQ(r.blocks[1].temperature_c, 26.0F);
  EXPECT_NEAR(r.mean_temperature_c, 25.0, 1e-12);
}

TEST(Compression, TemperatureNotMeasuredIsNotZero) {
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 200)}, quiet_samples(200));
  EXPECT_TRUE(std::isnan(r.blocks[0].temperature_c));
  EXPECT_TRUE(std::isnan(r.mean_temperature_c));
}

// ---- what is wrong with the data

TEST(CompressionEvents, AGapIsSeenAndMakesTheBlockLonger) {
  std::vector<ImuSample> samples = quiet_samples(1000);
  samples.erase(samples.begin() + 250, samples.begin() + 257);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  ASSERT_EQ(r.events.size(), 1u);
  EXPECT_EQ(r.events[0].kind, Kind::gap);
  EXPECT_EQ(r.events[0].sample, 250);
  EXPECT_EQ(r.events[0].count, 7);
  EXPECT_FALSE(r.events[0].filled);
  ASSERT_EQ(r.blocks.size(), 5u);
  EXPECT_EQ(r.blocks[1].missing, 7);
  EXPECT_EQ(r.blocks[1].samples, 193);
  EXPECT_DOUBLE_EQ(r.blocks[1].duration_s, 1.0);
  EXPECT_FALSE(r.blocks[1].whole_second);
  EXPECT_TRUE(r.blocks[2].whole_second);
  EXPECT_EQ(r.blocks[2].start_sample, 400);  // the grid of seconds goes on
}

TEST(CompressionEvents, AFewLostSamplesAreFilledInWithTheirVariance) {
  std::vector<ImuSample> samples = quiet_samples(1000);
  const CompressedRecording whole = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  samples.erase(samples.begin() + 250, samples.begin() + 253);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  ASSERT_EQ(r.events.size(), 1u);
  EXPECT_EQ(r.events[0].count, 3);
  EXPECT_TRUE(r.events[0].filled);
  ASSERT_EQ(r.blocks.size(), whole.blocks.size());
  const Block &filled = r.blocks[1], &was = whole.blocks[1];
  EXPECT_EQ(filled.missing, 0);
  EXPECT_EQ(filled.samples, 200);
  EXPECT_TRUE(filled.whole_second);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_LE(std::abs(filled.gyro[axis] - was.gyro[axis]), 4.0 * std::sqrt(filled.gyro_filled[axis]) + 1e-9);
    EXPECT_LE(std::abs(filled.accel[axis] - was.accel[axis]), 4.0 * std::sqrt(filled.accel_filled[axis]) + 1e-9);
  }
  EXPECT_EQ(r.blocks[2].gyro_filled, Eigen::Vector3f(Eigen::Vector3f::Zero()));
}

// A run that was interrupted goes on behind a gap of one sample at the beginning of a segment: the unit may have been moved meanwhile.
TEST(CompressionEvents, NothingIsFilledInAtTheBorderOfASegment) {
  for (const std::ptrdiff_t lost : {199, 200, 201}) {
    std::vector<ImuSample> samples = quiet_samples(1000);
    samples.erase(samples.begin() + lost);
    const CompressedRecording r = compress(
        pulses_info(), {segment(SegmentKind::still, 0, 200), segment(SegmentKind::rotate, 200, 1000)}, samples);
    ASSERT_EQ(r.events.size(), 1u) << lost;
    EXPECT_FALSE(r.events[0].filled) << lost;
  }
}

// The time of each sample is that of the counter: after a gap it jumps.
TEST(CompressionEvents, MomentsAreTakenAtTheTimeOfTheCounter) {
  std::vector<ImuSample> samples = quiet_samples(200);
  samples.erase(samples.begin() + 10, samples.begin() + 60);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 200)}, samples);
  Vector3d expected = Vector3d::Zero();
  for (const ImuSample& s : samples) expected += (static_cast<double>(s.counter) + 0.5) * dt * gyro_of(s);
  expect_same(r.blocks[0].gyro_time, expected, "gyro_time");
}

TEST(CompressionEvents, AGapAcrossABorderBelongsToTheSegmentAfterIt) {
  std::vector<ImuSample> samples = quiet_samples(600);
  samples.erase(samples.begin() + 195, samples.begin() + 205);
  const Segments segments = {segment(SegmentKind::rotate, 0, 200), segment(SegmentKind::still, 200, 600)};
  const CompressedRecording r = compress(pulses_info(), segments, samples);
  const auto first = std::find_if(r.blocks.begin(), r.blocks.end(), [](const Block& b) { return b.segment == 1; });
  EXPECT_EQ(first->missing, 10);
  EXPECT_EQ(first->start_sample, 195);  // which is how one sees that part of it was lost before the border
}

TEST(CompressionEvents, ADuplicateIsSeenAndNotCounted) {
  std::vector<ImuSample> samples = quiet_samples(400);
  const CompressedRecording clean = compress(pulses_info(), {segment(SegmentKind::still, 0, 400)}, samples);
  samples.insert(samples.begin() + 130, samples[129]);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 400)}, samples);
  ASSERT_EQ(r.events.size(), 1u);
  EXPECT_EQ(r.events[0].kind, Kind::duplicate);
  EXPECT_EQ(r.events[0].sample, 129);
  EXPECT_EQ(r.samples, 400);
  EXPECT_EQ(r.blocks[0].gyro, clean.blocks[0].gyro);
  EXPECT_EQ(r.blocks[1].sculling, clean.blocks[1].sculling);
}

TEST(CompressionEvents, AMarkedSampleIsListed) {
  std::vector<ImuSample> samples = quiet_samples(400);
  samples[77].flags = sample_flag_invalid;
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 400)}, samples);
  ASSERT_EQ(r.events.size(), 1u);
  EXPECT_EQ(r.events[0].kind, Kind::invalid);
  EXPECT_EQ(r.events[0].sample, 77);
}

TEST(CompressionEvents, AGlitchIsListedOnceWithPlaceAxisAndSize) {
  std::vector<ImuSample> samples = quiet_samples(1000);
  samples[500].gyro[2] += 221.0;   // 1 mrad
  samples[700].accel[0] += 100.0;  // 0.05 m/s
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  ASSERT_EQ(r.events.size(), 2u);
  EXPECT_EQ(r.events[0].kind, Kind::gyro_glitch);
  EXPECT_EQ(r.events[0].sample, 500);
  EXPECT_EQ(r.events[0].axis, 2);
  EXPECT_NEAR(r.events[0].size, 221.0, 3.0);
  EXPECT_EQ(r.events[1].kind, Kind::accel_glitch);
  EXPECT_EQ(r.events[1].sample, 700);
  EXPECT_EQ(r.events[1].axis, 0);
  EXPECT_NEAR(r.events[1].size, 100.0, 3.0);
}

TEST(CompressionEvents, GlitchesOfSeveralSensorsAtOnceAreSeveral) {
  std::vector<ImuSample> samples = quiet_samples(1000);
  samples[500].gyro[2] += 221.0;
  samples[500].gyro[0] -= 150.0;
  samples[500].accel[2] += 100.0;
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 1000)}, samples);
  ASSERT_EQ(r.events.size(), 3u);
  for (const DataEvent& event : r.events) EXPECT_EQ(event.sample, 500);
}

TEST(CompressionEvents, AGlitchInMidTurnIsSeenAndTheTurnItselfIsNot) {
  std::vector<ImuSample> samples = turning_samples(4000);
  samples[1800].gyro[1] -= 221.0;
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::rotate, 0, 4000)}, samples);
  ASSERT_EQ(r.events.size(), 1u);
  EXPECT_EQ(r.events[0].sample, 1800);
  EXPECT_EQ(r.events[0].axis, 1);
}

// A table that begins and ends to accelerate at once, wherever in a sample, and a unit that counts finely: 20 to 900 pulses at each corner.
TEST(CompressionEvents, TheCornersOfATrapezoidAreNoGlitches) {
  std::mt19937_64 random(5);
  for (int turn = 0; turn < 50; ++turn) {
    const auto between = [&](double a, double b) { return std::uniform_real_distribution<>(a, b)(random); };
    const double slope = std::exp(between(std::log(80.0), std::log(4000.0))) * (between(-1.0, 1.0) < 0.0 ? -1.0 : 1.0);
    const double corner[] = {1000.0 + between(0.0, 1.0), 1400.0 + between(0.0, 1.0), 2400.0 + between(0.0, 1.0),
                             2800.0 + between(0.0, 1.0)};
    const auto angle = [&](double t) {
      double sum = 0.0;
      for (int k = 0; k < 4; ++k)
        sum += (k == 0 || k == 3 ? 0.5 : -0.5) * slope * std::pow(std::max(0.0, t - corner[k]), 2);
      return sum;
    };
    std::vector<ImuSample> samples = quiet_samples(4000, 7);
    for (std::size_t i = 0; i < samples.size(); ++i)
      samples[i].gyro[1] += angle(static_cast<double>(i) + 1.0) - angle(static_cast<double>(i));
    const Segments segments = {segment(SegmentKind::rotate, 0, 4000)};
    EXPECT_TRUE(compress(pulses_info(), segments, samples).events.empty()) << turn;
    const auto place = static_cast<std::size_t>(between(1010.0, 1390.0));
    samples[place].gyro[1] += 1.0 * std::abs(slope) + 100.0;
    const CompressedRecording r = compress(pulses_info(), segments, samples);
    ASSERT_EQ(r.events.size(), 1u) << turn;
    EXPECT_EQ(r.events[0].sample, static_cast<std::int64_t>(place));
  }
}

// Gravity goes from one axis to another by 2 pulses a sample; after half a second that was lost it is elsewhere, which is no glitch.
TEST(CompressionEvents, AGapInATurnIsNoGlitch) {
  for (const std::size_t border : {4000u, 1850u}) {  // the turn ends in the gap, too
    std::vector<ImuSample> samples = quiet_samples(4000, 9);
    for (std::size_t i = 0; i < samples.size(); ++i)
      samples[i].accel[0] += 2.0 * static_cast<double>(std::min(i, border));
    samples.erase(samples.begin() + 1800, samples.begin() + 1900);
    const auto at = static_cast<std::int64_t>(border);
    const CompressedRecording r =
        compress(pulses_info(), {segment(SegmentKind::rotate, 0, at), segment(SegmentKind::still, at, 4000)}, samples);
    ASSERT_EQ(r.events.size(), 1u) << border;
    EXPECT_EQ(r.events[0].kind, Kind::gap);
  }
}

// At rest nothing goes on in a gap: what stands out beside it is a glitch.
TEST(CompressionEvents, AGlitchBesideAGapAtRestIsSeen) {
  std::vector<ImuSample> samples = quiet_samples(4000, 9);
  samples[1900].accel[0] += 100.0;
  samples.erase(samples.begin() + 1800, samples.begin() + 1900);
  const CompressedRecording r = compress(pulses_info(), {segment(SegmentKind::still, 0, 4000)}, samples);
  ASSERT_EQ(r.events.size(), 2u);
  EXPECT_EQ(r.events[0].kind, Kind::gap);
  EXPECT_EQ(r.events[1].kind, Kind::accel_glitch);
}

TEST(CompressionEvents, KindsHaveNames) {
  EXPECT_STREQ(to_string(Kind::gap), "gap");
  EXPECT_STREQ(to_string(Kind::accel_glitch), "accelerometer glitch");
}

}  // namespace
}  // namespace turncal
