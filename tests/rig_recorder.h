// For tests: the rig walked through a sequence by a perfect station, straight into a CompressedRecording.
//
// No state machine: the table stands at the sequence's start position at the first sample, every move is its trapezoid
// and half a second of rest, every dwell counts at once. The samples stream through the Compressor; none are kept. The segments are those
// of planned_segments(): what an undisturbed run records.
//
//   const Sequence sequence = must_read_sequence("fourteen_step.seq");  // a file of sequences/
//   const RigRecording made = record_on_rig(sequence, rig_config);      // 1.27 million samples: 0.5 to 0.9 s
//   made.recording, made.truth
//
// noise_free() takes away what is random in a RigConfig and leaves parameters, table errors and effects as they are.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/joint/joint_estimate.h"
#include "calib/model/parameters.h"
#include "calib/statistics/compression.h"
#include "imu_io/recordings/recording_source.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"
#include "turntable_drivers/rig/rig.h"
#include "turntable_drivers/rig/rig_devices.h"

namespace turncal {

struct RigRecording {
  CompressedRecording recording;
  Parameters truth;
};

struct RigRecorderOptions {
  // This dwell (0: the first of the sequence, alignments count) is recorded, found bad and repeated, as a station does
  // it: closed as rotate, settled, and recorded again.
  int repeated_dwell = -1;
  std::function<void(std::span<ImuSample>)> alter;  // what becomes of the samples on their way
  std::function<bool(const ImuSample&)> lost;       // these do not arrive
};

// No noise, bias instability or walks, and real-valued pulses.
inline RigConfig noise_free(RigConfig config) {
  config.noise.gyro_random_walk_deg_per_rt_h = 0.0;
  config.noise.accel_random_walk_ug_per_rt_hz = 0.0;
  config.noise.gyro_bias_instability_degph = 0.0;
  config.noise.accel_bias_instability_ug = 0.0;
  config.noise.gyro_rate_random_walk_degph_per_rt_h = 0.0;
  config.noise.accel_acceleration_random_walk_ug_per_rt_h = 0.0;
  config.quantisation = RigQuantisation::off;
  return config;
}

// An error is the test's own mistake (a wrong file, a full disk): it ends the test program with the message.
template <class T>
T must(Result<T> result) {
  if (!result.ok()) {
    std::fprintf(stderr, "%s\n", result.error().message.c_str());
    std::abort();
  }
  return std::move(*result);
}
inline void must(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s\n", status.error().message.c_str());
  std::abort();
}

#ifdef TURNCAL_SOURCE_DIR
inline Sequence must_read_sequence(const std::string& name) {
  return must(read_sequence(std::string(TURNCAL_SOURCE_DIR "/sequences/") + name));
}
inline const Sequence& fourteen_steps() {
  static const Sequence sequence = must_read_sequence("fourteen_step.seq");
  return sequence;
}
#endif

inline Parameters rig_truth(const Rig& rig) {
  ParameterVector v;
  for (int i = 0; i < parameter_count; ++i) v[i] = rig.truth()[std::size_t(i)];
  return from_vector(v);
}

// Site, unit and sample format of the rig.
inline RecordingInfo rig_recording_info(Rig& rig) {
  RecordingInfo info;
  RigImu(rig).describe(info);
  info.latitude_deg = rig.config().site.latitude_deg;
  info.gravity_mps2 = rig.config().site.gravity_mps2;
  info.unit_serial = rig.config().unit_serial;
  return info;
}

inline RigRecording record_on_rig(const Sequence& sequence, RigConfig config, const RigRecorderOptions& options = {}) {
  for (const Axis axis : all_axes) config.table.power_on_deg[index(axis)] = sequence.start_deg[axis];
  Rig rig(config);
  const RecordingInfo info = rig_recording_info(rig);

  // Soft limits do not matter here.
  const Plan plan = make_plan(sequence, {.settle_s = 0.5, .sample_period_s = info.sample_period_s});

  Compressor compressor(info);
  std::vector<ImuSample> chunk(2048);
  std::int64_t counter = config.first_counter;
  const auto record = [&](Segment segment, std::int64_t samples, SegmentKind final_kind) {
    segment.start_sample = counter;
    segment.end_sample = counter += samples;
    compressor.begin_segment(segment);
    while (samples > 0) {
      const std::int64_t now = std::min<std::int64_t>(samples, 1024);  // twice as many may come back: duplicates
      const std::size_t count = rig.advance_time(now, chunk);
      std::span<ImuSample> got(chunk.data(), count);
      if (options.alter) options.alter(got);
      if (options.lost)
        got = got.first(std::size_t(std::remove_if(got.begin(), got.end(), options.lost) - got.begin()));
      compressor.add(got);
      samples -= now;
    }
    compressor.end_segment(final_kind, segment.end_sample);
  };
  int dwell = 0;
  for (const PlannedItem& item : plan.items) {
    const bool move = item.kind == SequenceItem::Kind::move;
    Segment segment;
    segment.step = item.step;
    segment.kind = move ? SegmentKind::rotate : item.dwell_kind;
    segment.heading_deg = item.commanded_deg[Axis::heading];
    segment.pitch_deg = item.commanded_deg[Axis::pitch];
    segment.roll_deg = item.commanded_deg[Axis::roll];
    if (move) rig.command_move(item.axis, item.to_deg, item.rate_degps, item.acceleration_degps2);
    if (!move && dwell++ == options.repeated_dwell) {
      record(segment, item.samples / 2, SegmentKind::rotate);
      Segment settle = segment;
      settle.kind = SegmentKind::rotate;
      record(settle, 100, SegmentKind::rotate);
    }
    record(segment, item.samples, segment.kind);
  }
  return {compressor.take(), rig_truth(rig)};
}

// A recording in a folder, compressed.
inline CompressedRecording compress_folder(const std::string& folder) {
  const auto source = must(RecordingSource::open(folder));
  Compressor compressor(source->info());
  SegmentedFeed feed(compressor, source->segments());
  must(source->read([&](std::span<const ImuSample> samples) {
    feed.add(samples);
    return Status{};
  }));
  feed.finish();
  return compressor.take();
}

// Normalised estimation error squared: the error of the free parameters in the metric of the predicted covariance. For a right
// estimate chi-square with as many degrees of freedom as there are free parameters.
inline double nees(const JointResult& r, const Parameters& truth) {
  const ParameterVector difference = to_vector(r.parameters) - to_vector(truth);
  const Eigen::VectorXd error = difference(r.free);
  const Eigen::VectorXd scale = r.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlation = scale.asDiagonal() * r.covariance * scale.asDiagonal();
  const Eigen::VectorXd normalised = scale.cwiseProduct(error);
  return normalised.dot(correlation.ldlt().solve(normalised));
}

// Of 21 parameters; one of a thousand right estimates lies above.
inline constexpr double chi_square_21_one_in_1000 = 46.8;

// What a navigation unit's biases differ by between two switch-ons.
inline constexpr double accel_turn_on_g = 20e-6;
inline constexpr double gyro_turn_on_degph = 0.05;

}  // namespace turncal
