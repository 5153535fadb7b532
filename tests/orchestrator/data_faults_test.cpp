// What is wrong with the data themselves: words that were garbled on their way, channels that do not live, temperatures that cannot be,
// units that are plainly wrong. Named in recordings and in a run, at a cost of a second or a dwell.

#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/records/journal.h"
#include "tests/orchestrator/program.h"
#include "tests/orchestrator/rig_station.h"

namespace turncal {
namespace {

// The demo sequence on the rig, in memory.
struct Recorded {
  RecordingInfo info;
  Segments segments;
  std::vector<ImuSample> samples;
};

const Recorded& recorded() {
  static const Recorded once = [] {
    const TemporaryFolder folder;
    RigStation s(file_text(std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq"));
    s.devices.imu.describe(s.info);
    s.plan = make_plan(s.sequence, plan_limits(s.station, s.info.sample_period_s));
    RecordingSink sink(folder.path());
    StationRun run(s.devices.devices(), {s.sequence, s.plan, s.station}, {{s.devices.imu, {&sink}, "SN1"}}, {});
    EXPECT_EQ(run.run().state, RunState::done);
    const auto source = RecordingSource::open(sink.path());
    Recorded r{(*source)->info(), (*source)->segments(), {}};
    EXPECT_TRUE((*source)
                    ->read([&](std::span<const ImuSample> samples) {
                      r.samples.insert(r.samples.end(), samples.begin(), samples.end());
                      return Status{};
                    })
                    .ok());
    return r;
  }();
  return once;
}

// As a file that was changed: written, loaded.
class Changed {
 public:
  explicit Changed(const Recorded& r) {
    const std::string path = folder_ / "recording.tcr";
    auto writer = RecordingWriter::create(path, r.info);
    EXPECT_TRUE(writer.ok());
    for (const Segment& s : r.segments) {
      EXPECT_TRUE(writer->begin_segment(s).ok());
      EXPECT_TRUE(writer->end_segment(s.kind, s.end_sample, {{s.heading_deg, s.pitch_deg, s.roll_deg}}).ok());
    }
    EXPECT_TRUE(writer->add(r.samples).ok());
    EXPECT_TRUE(writer->finish().ok());
    Result<LoadedRecording> loaded_now = load_recording(path);
    if (loaded_now) loaded = std::move(*loaded_now);
    if (!loaded_now) refusal = loaded_now.error();
  }
  LoadedRecording loaded;
  Status refusal;

 private:
  TemporaryFolder folder_;
};

double& channel(ImuSample& sample, std::size_t i) { return i < 3 ? sample.gyro[i] : sample.accel[i - 3]; }

std::string lines_of(const std::vector<std::string>& all) {
  std::string text;
  for (const std::string& line : all) text += line + "\n";
  return text;
}

TEST(DataFaults, ASpikeCostsItsSecondAndIsNamed) {
  const Result<CalibrationOutput> plain = good(calibrate_recording(Changed(recorded()).loaded, {}));
  std::mt19937_64 random(20);
  for (int trial = 0; trial < 12; ++trial) {
    Recorded r = recorded();
    const std::size_t at = random() % r.samples.size(), i = random() % 6;
    // From what no unit can feel to the largest number there is.
    const double size = std::exp2(17.0 + 14.0 * double(random() % 1000) / 1000.0);
    channel(r.samples[at], i) = (random() % 2 == 0 ? 1.0 : -1.0) * std::floor(size);
    const Result<CalibrationOutput> output = calibrate_recording(Changed(r).loaded, {});
    const std::string what = std::string(channel_names[i]) + " at sample " + std::to_string(at);
    ASSERT_TRUE(output.ok()) << what << ": " << output.error().message;
    for (std::size_t k = 0; k < parameter_keys.size(); ++k) {
      if (!plain->file.sigma[k]) continue;
      const auto p = Eigen::Index(k);
      EXPECT_LT(std::abs(output->file.parameters[p] - plain->file.parameters[p]), *plain->file.sigma[k])
          << what << ": " << parameter_keys[k];
      EXPECT_LT(*output->file.sigma[k], 1.3 * *plain->file.sigma[k]) << what << ": " << parameter_keys[k];
    }
    const std::string notes = lines_of(output->notes);
    const std::string said =
        std::string(i < 3 ? "gyro" : "accelerometer") + " glitch on axis " + "xyz"[i % 3] + " gave ";
    EXPECT_SAYS(notes, said) << what;
    EXPECT_SAYS(notes, "at sample " + std::to_string(at) + " (") << what;
  }
}

TEST(DataFaults, WhatLastsIsNoSpike) {
  // Another weight of a pulse: 40 times as many of them.
  RecordingInfo info;
  info.accel_pulse_mps = 0.0005;
  SpikeFinder finder(info);
  int left_out = 0;
  for (int k = 0; k < 2000; ++k) {
    ImuSample sample;
    const double radps = 7.0 * std::min(1.0, 0.002 * k);  // a table that begins to turn
    sample.gyro = {40.0 * radps * 0.005 / (0.93 * rad_per_arcsec), 0.0, 0.0};
    sample.accel = {0.0, 40.0 * 98.0, 0.0};
    left_out += finder.spike_in(sample) ? 1 : 0;
  }
  EXPECT_LE(left_out, 5);
}

TEST(DataFaults, AChannelThatDoesNotLiveIsNamed) {
  std::mt19937_64 random(21);
  for (std::size_t i = 0; i < 6; ++i) {
    Recorded r = recorded();
    // From the first sample, or from somewhere in the first half.
    const std::size_t from = i % 2 == 0 ? 0 : 1 + random() % (r.samples.size() / 2);
    const double value = from == 0 ? 0.0 : channel(r.samples[from], i);
    for (std::size_t k = from; k < r.samples.size(); ++k) channel(r.samples[k], i) = value;
    const Changed changed(r);
    const std::string said = std::string(channel_names[i]) + (from == 0 ? " is dead" : " is stuck");
    const Result<CalibrationOutput> output = calibrate_recording(changed.loaded, {});
    ASSERT_FALSE(output.ok());
    EXPECT_EQ(output.error().kind, ErrorKind::unit_failed);
    EXPECT_SAYS(output.error().message, said);
    const Result<DiagnosisOutput> diagnosis = diagnose_recordings({&changed.loaded, 1}, {});
    ASSERT_FALSE(diagnosis.ok());
    EXPECT_EQ(diagnosis.error().kind, ErrorKind::unit_failed) << "one outcome, one code";
    EXPECT_EQ(diagnosis.error().message, output.error().message);
  }
  EXPECT_EQ(Changed(recorded()).loaded.dead_channel, "");
}

// At rest; gyro z counts a pulse now and then, and repeats itself for long.
TEST(DataFaults, WhatSticksAtRestIsMarked) {
  constexpr int samples = 20000, turn = 500;
  for (const auto& [from, to] : {std::pair{1000, samples}, {10000, samples}, {10000, 10250}, {10000, 10150}, {0, 0}}) {
    std::mt19937_64 random(22);
    std::normal_distribution<double> noise;
    StuckChannels stuck(0.005);
    std::vector<ImuSample> known;
    ImuSample sample;
    for (int k = 0; k < samples; ++k) {
      sample.counter = 7 + k;
      for (std::size_t i = 0; i < 6; ++i)
        if (i != 1 || k <= from || k >= to) channel_of(sample, i) = 1e-4 * noise(random);
      sample.gyro[2] = k % 6000 < 100 ? double(k % 2) : 0.0;
      stuck.add(sample, k >= turn, known);
    }
    stuck.finish(known);
    ASSERT_EQ(known.size(), std::size_t(samples));
    const bool long_enough = to - from >= 200;
    for (int k = 0; k < samples; ++k) {
      ASSERT_EQ(known[std::size_t(k)].counter, 7 + k);
      ASSERT_EQ(known[std::size_t(k)].flags, long_enough && k >= from && k < to ? sample_flag_invalid : 0) << k;
    }
    EXPECT_EQ(stuck.found().size(), long_enough ? 1u : 0u);
    EXPECT_EQ(stuck.found(true).size(), long_enough && to == samples ? 1u : 0u);
    if (!long_enough) continue;
    EXPECT_SAYS(stuck.found()[0],
                fmt::format("gyro y is stuck: it gave one value, {:.6g}, in {} samples at rest from sample {} (",
                            known[std::size_t(from)].gyro[1], to - from, from + 7));
  }
}

TEST(DataFaults, ARecordingOfFlaggedSamplesAloneIsRefused) {
  Recorded r = recorded();
  for (ImuSample& sample : r.samples) sample.flags |= sample_flag_invalid;
  EXPECT_TRUE(fails(Changed(r).refusal, "all samples are flagged as bad: expected some to use"));
}

TEST(DataFaults, ATemperatureThatCannotBeIsNotUsed) {
  Recorded r = recorded();
  const Result<CalibrationOutput> plain = calibrate_recording(Changed(r).loaded, {});
  for (std::size_t k = 500; k < 600; ++k) r.samples[k].temperature_c = 3000.0F;
  const Result<CalibrationOutput> output = calibrate_recording(Changed(r).loaded, {});
  ASSERT_TRUE(output.ok() && plain.ok());
  EXPECT_NEAR(*output->mean_temperature_c, *plain->mean_temperature_c, 0.01);
  const std::string notes = lines_of(output->notes);
  EXPECT_SAYS(notes, "100 temperature(s) that cannot be, the first 3000 C at sample 500");
  for (ImuSample& sample : r.samples) sample.temperature_c = 3000.0F;
  EXPECT_FALSE(calibrate_recording(Changed(r).loaded, {})->mean_temperature_c) << "as if none were measured";
}

TEST(DataFaults, UnitsThatAreWrongAreNamed) {
  const auto physical = [](double gyros, double accelerometers) {
    Recorded r = recorded();
    const SensorModel model = sensor_model(start_parameters(r.info), r.info);
    r.info.gyro_increment = r.info.accel_increment = IncrementKind::physical;
    for (ImuSample& sample : r.samples) {
      for (double& x : sample.gyro) x *= gyros * model.gyro_scale(0, 0);
      for (double& x : sample.accel) x *= accelerometers * model.accel_scale(0, 0);
    }
    const Result<CalibrationOutput> output = calibrate_recording(Changed(r).loaded, {});
    if (output) return std::string("good");
    EXPECT_EQ(output.error().kind, ErrorKind::unit_failed);
    return output.error().message;
  };
  EXPECT_EQ(physical(1.0, 1.0), "good");
  EXPECT_SAYS(physical(1.0 / rad_per_deg, 1.0),
              "the gyros add up to 57.3 times what is expected: as if they were in deg/s");
  EXPECT_SAYS(physical(rad_per_deg, 1.0), "as if they were in rad/s, not deg/s");
  EXPECT_SAYS(physical(1.0, 1.0 / standard_gravity_mps2), "as if they were in g, not m/s^2");
  for (const double factor : {0.1, 2.0, 10.0}) {
    Recorded r = recorded();
    r.info.accel_pulse_mps *= factor;
    EXPECT_TRUE(fails(calibrate_recording(Changed(r).loaded, {}), "is not what a pulse of this unit weighs")) << factor;
  }
}

// ---- in a run

// Homing 2 s; align 2 to 7 s, move to 17 s, dwell to 27 s (rig_station.h).
TEST(DataFaults, ASpikeRepeatsTheDwellOrTheMove) {
  for (const bool in_dwell : {true, false}) {
    RigFault fault{.kind = RigFaultKind::gyro_glitch, .sample = in_dwell ? 4400 : 2400, .axis = 1};
    fault.size = 9e6;  // mrad: 2e9 pulses
    RigStation s(two_steps_text, rig_with({fault}));
    const RunOutcome outcome = ended(s.run(), RunState::done);
    EXPECT_TRUE(s.at_rest());
    EXPECT_EQ(in_dwell ? outcome.repeated_dwells : outcome.repeated_moves, 1);
    EXPECT_SAYS(lines_of(s.watcher.text), "glitch: gyro y gave ");
    if (in_dwell) {
      EXPECT_SAYS(lines_of(s.watcher.text), ", which cannot be");
    }
  }
}

}  // namespace
}  // namespace turncal
