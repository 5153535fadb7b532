// The sums of a block against code that is as slow and as near to the definitions in compression.h as possible, and
// what the Compressor says about samples that are missing, double, marked or out of line.
#include "calib/statistics/compression.h"

#include "tests/test.h"

#include <rapidcheck/gtest.h>

#include "calib/model/parameters.h"
#include "tests/calib/compress.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Kind = DataEvent::Kind;

// Samples of a unit at rest with one pulse of jitter: 14 gyro and 96 accelerometer pulses on y.
std::vector<ImuSample> quiet_samples(std::size_t count, unsigned seed = 7) {
  std::mt19937 random(seed);
  std::vector<ImuSample> samples(count);
  for (std::size_t i = 0; i < count; ++i) {
    samples[i].counter = std::int64_t(i);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      samples[i].gyro[axis] = double(random() % 3) - 1.0 + (axis == 1 ? 14.0 : 0.0);
      samples[i].accel[axis] = double(random() % 3) - 1.0 + (axis == 1 ? 96.0 : 0.0);
    }
  }
  return samples;
}

// A unit that turns about all axes: 180 pulses a sample is 10 deg/s.
std::vector<ImuSample> turning_samples(std::size_t count) {
  std::vector<ImuSample> samples = quiet_samples(count, 8);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = double(i) * dt;
    samples[i].gyro[0] += std::round(180.0 * std::sin(3.0 * t));
    samples[i].gyro[1] += std::round(120.0 * std::cos(2.0 * t));
    samples[i].gyro[2] += std::round(90.0 * t);
    samples[i].accel[2] += std::round(40.0 * t);
  }
  return samples;
}

Segment segment(SegmentKind kind, std::int64_t start, std::int64_t end) {
  return {.step = 1, .kind = kind, .start_sample = start, .end_sample = end};
}

Vector3d gyro_of(const ImuSample& s) { return {s.gyro[0], s.gyro[1], s.gyro[2]}; }
Vector3d accel_of(const ImuSample& s) { return {s.accel[0], s.accel[1], s.accel[2]}; }

// The definitions, term by term, of samples [begin, end) of which the first counter is `start`; neighbours across a gap tell nothing.
Block naive(const std::vector<ImuSample>& all, std::size_t begin, std::size_t end, std::int64_t start) {
  Block b;
  const double rad = nominal_gyro_rad(pulses_info());
  const auto adjacent = [&](std::size_t i) { return i + 1 < all.size() && all[i + 1].counter == all[i].counter + 1; };
  const auto outer = [&](std::size_t i) -> Matrix3d {  // K of samples i and i + 1
    return gyro_of(all[i]) * accel_of(all[i + 1]).transpose() - gyro_of(all[i + 1]) * accel_of(all[i]).transpose();
  };
  const auto cross = [&](std::size_t i) -> Vector3d { return gyro_of(all[i]).cross(gyro_of(all[i + 1])); };
  Vector3d theta = Vector3d::Zero();
  for (std::size_t i = begin; i < end; ++i) {
    const Vector3d alpha = gyro_of(all[i]), beta = accel_of(all[i]);
    const double middle_s = (double(all[i].counter - start) + 0.5) * dt;
    const double k = 1.0 + 11.0 / 60.0 * (rad * alpha).squaredNorm();
    b.gyro += alpha;
    b.accel += beta;
    b.gyro_time += middle_s * alpha;
    b.accel_time += middle_s * beta;
    b.coning += theta.cross(alpha);
    b.sculling += (theta + alpha / 2.0) * beta.transpose();
    if (i > 0 && adjacent(i - 1)) b.coning += k * cross(i - 1) / 12.0, b.sculling += k * outer(i - 1) / 24.0;
    if (adjacent(i)) b.coning += k * cross(i) / 12.0, b.sculling += k * outer(i) / 24.0;
    theta += alpha;
  }
  b.samples = std::int32_t(end - begin);
  b.duration_s = double(all[end - 1].counter + 1 - start) * dt;
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

// Whatever the segments, gaps, duplicates and chunks: the blocks tile the recording, each in its segment, and their sums are those of the
// definition; what was lost or came twice is listed.
RC_GTEST_PROP(Compression, SumsAreThoseOfTheDefinition, ()) {
  const auto count = *rc::gen::inRange<std::int64_t>(300, 1500);
  std::vector<ImuSample> samples = *rc::gen::arbitrary<bool>() ? turning_samples(count) : quiet_samples(count);
  Segments segments;
  for (std::int64_t at = 0; at < count;) {
    const std::int64_t end = std::min(count, at + *rc::gen::inRange<std::int64_t>(30, 700));
    segments.push_back(
        segment(*rc::gen::element(SegmentKind::align, SegmentKind::still, SegmentKind::rotate), at, end));
    at = end;
  }
  std::vector<std::pair<std::int64_t, std::int64_t>> lost;  // counter, samples: more than are filled in
  for (std::int64_t at = 20; at + 200 < count; at += 200)
    if (*rc::gen::arbitrary<bool>()) lost.emplace_back(at + *rc::gen::inRange(0, 60), *rc::gen::inRange(6, 60));
  std::erase_if(samples, [&](const ImuSample& s) {
    return std::ranges::any_of(
        lost, [&](const auto& gap) { return s.counter >= gap.first && s.counter < gap.first + gap.second; });
  });
  std::vector<ImuSample> fed = samples;
  const auto twice = *rc::gen::inRange<std::size_t>(1, samples.size());
  const bool has_twice = *rc::gen::arbitrary<bool>();
  if (has_twice) fed.insert(fed.begin() + std::ptrdiff_t(twice), fed[twice - 1]);

  CompressionOptions options;
  options.glitch.counts_min = INFINITY;
  options.leaves_out_turning = false;
  Compressor compressor(pulses_info(), options);
  SegmentedFeed feed(compressor, segments);
  const auto chunk = *rc::gen::inRange<std::size_t>(1, 400);
  for (std::size_t i = 0; i < fed.size(); i += chunk)
    feed.add(std::span(fed).subspan(i, std::min(chunk, fed.size() - i)));
  feed.finish();
  const CompressedRecording r = compressor.take();

  RC_ASSERT(r.samples == std::ssize(samples));
  std::size_t begin = 0;
  std::int64_t at = 0;
  for (const Block& block : r.blocks) {
    const std::size_t end = begin + block.samples;
    RC_ASSERT(block.start_sample == at);
    expect_same_sums(block, naive(samples, begin, end, at));
    const Segment& owner = r.segments[block.segment];
    RC_ASSERT(samples[begin].counter >= owner.start_sample && samples[end - 1].counter < owner.end_sample);
    at = samples[end - 1].counter + 1;
    RC_ASSERT(at == block.start_sample + block.samples + block.missing);
    RC_ASSERT(block.whole_second == (owner.kind != SegmentKind::rotate && block.samples == 200 && block.missing == 0));
    RC_ASSERT(std::isnan(block.temperature_c));
    // 0.012 rad are 2653.2 pulses of 0.93292 arcsec; of a moment of even rate, and at the end of a segment, two blocks or more go together.
    const bool last = &block == &r.blocks.back() || (&block + 1)->segment != block.segment;
    const bool together = last || block.samples > 20 || block.gyro.norm() > 4000.0;
    if (owner.kind == SegmentKind::rotate && !together && block.samples > 1 && block.missing == 0)
      RC_ASSERT(naive(samples, begin, end - 1, block.start_sample).gyro.norm() < 2653.3);
    begin = end;
  }
  RC_ASSERT(begin == samples.size());
  RC_ASSERT(!testing::Test::HasFailure());
  std::size_t gaps = 0;
  for (const DataEvent& event : r.events) {
    if (event.kind == Kind::duplicate) RC_ASSERT(has_twice && event.sample == fed[twice].counter);
    if (event.kind != Kind::gap) continue;
    RC_ASSERT(event.sample == lost[gaps].first && event.count == lost[gaps].second && !event.filled);
    ++gaps;
  }
  RC_ASSERT(gaps == lost.size() && r.events.size() == gaps + (has_twice ? 1U : 0U));
}

// 10 deg/s about x: 57 samples are 0.05 rad. Where the rate changes blocks stay short.
TEST(Compression, ASteadyTurnHasLongBlocks) {
  std::vector<ImuSample> samples = quiet_samples(2000);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].gyro[0] = i < 200 ? std::round(0.965 * double(i)) : 193.0;
    samples[i].gyro[1] = samples[i].gyro[2] = 0.0;
  }
  const CompressedRecording r = compress_as(SegmentKind::rotate, samples);
  std::size_t begin = 0, longest_of_rise = 0, shortest_of_turn = samples.size();
  for (const Block& block : r.blocks) {
    const std::size_t length = std::size_t(block.samples), end = begin + length;
    expect_same_sums(block, naive(samples, begin, end, std::int64_t(begin)));
    EXPECT_LT(block.gyro.norm(), 11055.1);  // 0.05 rad
    if (end < 200) longest_of_rise = std::max(longest_of_rise, length);
    if (begin > 250 && end < 2000) shortest_of_turn = std::min(shortest_of_turn, length);
    begin = end;
  }
  EXPECT_EQ(begin, 2000u);
  EXPECT_LE(longest_of_rise, 20u);
  EXPECT_GE(shortest_of_turn, 42u);  // three of 14 samples, 2702 pulses each
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
  for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(r.blocks[k].whole_second, k >= 2) << k;
}

// block_motion.h is good for a tenth of a radian: a unit that is turned in a dwell must not make longer blocks.
TEST(Compression, AUnitMovedInADwellMakesShortBlocks) {
  std::vector<ImuSample> samples = quiet_samples(400);
  for (std::size_t i = 0; i < 200; ++i) samples[i].gyro[2] += 190.0;  // 10 deg/s
  const CompressedRecording r = compress_as(SegmentKind::still, samples);
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

// ---- what is wrong with the data

TEST(CompressionEvents, AFewLostSamplesAreFilledInWithTheirVariance) {
  std::vector<ImuSample> samples = quiet_samples(1000);
  const CompressedRecording whole = compress_as(SegmentKind::still, samples);
  samples.erase(samples.begin() + 250, samples.begin() + 253);
  const CompressedRecording r = compress_as(SegmentKind::still, samples);
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

TEST(CompressionEvents, AGlitchOrAMarkedSampleIsListedOnceWithPlaceAxisAndSize) {
  std::vector<ImuSample> samples = quiet_samples(1000), turning = turning_samples(4000);
  samples[77].flags = sample_flag_invalid;
  samples[500].gyro[2] += 221.0;   // 1 mrad
  samples[700].accel[0] += 100.0;  // 0.05 m/s
  turning[1800].gyro[1] -= 221.0;
  std::vector<DataEvent> events = compress_as(SegmentKind::still, samples).events;
  std::ranges::copy(compress_as(SegmentKind::rotate, turning).events, std::back_inserter(events));
  ASSERT_EQ(events.size(), 4u);
  EXPECT_EQ(std::tie(events[0].kind, events[0].sample), std::tuple(Kind::invalid, 77));
  EXPECT_EQ(std::tie(events[1].kind, events[1].sample, events[1].axis), std::tuple(Kind::gyro_glitch, 500, 2));
  EXPECT_NEAR(events[1].size, 221.0, 3.0);
  EXPECT_EQ(std::tie(events[2].kind, events[2].sample, events[2].axis), std::tuple(Kind::accel_glitch, 700, 0));
  EXPECT_NEAR(events[2].size, 100.0, 3.0);
  EXPECT_EQ(std::tie(events[3].kind, events[3].sample, events[3].axis), std::tuple(Kind::gyro_glitch, 1800, 1));
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
    for (std::size_t i = 0; i < samples.size(); ++i) samples[i].gyro[1] += angle(double(i) + 1.0) - angle(double(i));
    EXPECT_TRUE(compress_as(SegmentKind::rotate, samples).events.empty()) << turn;
    const auto place = std::size_t(between(1010.0, 1390.0));
    samples[place].gyro[1] += 1.0 * std::abs(slope) + 100.0;
    const CompressedRecording r = compress_as(SegmentKind::rotate, samples);
    ASSERT_EQ(r.events.size(), 1u) << turn;
    EXPECT_EQ(r.events[0].sample, std::int64_t(place));
  }
}

// Gravity goes from one axis to another by 2 pulses a sample; after half a second that was lost it is elsewhere, which is no glitch.
TEST(CompressionEvents, AGapInATurnIsNoGlitch) {
  for (const std::size_t border : {4000u, 1850u}) {  // the turn ends in the gap, too
    std::vector<ImuSample> samples = quiet_samples(4000, 9);
    for (std::size_t i = 0; i < samples.size(); ++i) samples[i].accel[0] += 2.0 * double(std::min(i, border));
    samples.erase(samples.begin() + 1800, samples.begin() + 1900);
    const auto at = std::int64_t(border);
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
  const CompressedRecording r = compress_as(SegmentKind::still, samples);
  ASSERT_EQ(r.events.size(), 2u);
  EXPECT_EQ(r.events[0].kind, Kind::gap);
  EXPECT_EQ(r.events[1].kind, Kind::accel_glitch);
}

}  // namespace
}  // namespace turncal
