#include "orchestrator/jobs/allan_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>

#include "calib/statistics/data_screen.h"
#include "calib/statistics/numerics.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/recordings/csv_map_import.h"
#include "imu_io/recordings/parameter_file.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"

namespace turncal {

namespace {

// Largest change of a second's mean from the first one in a unit at rest.
constexpr double moves_radps = 0.02, moves_mps2 = 0.5;

// Averages the cells of each rest in pairs.
RestCells paired(const RestCells& cells) {
  RestCells pairs;
  pairs.cell_s = 2.0 * cells.cell_s;
  pairs.sample_s = cells.sample_s;
  for (std::size_t r = 0, from = 0; r < cells.ends.size(); from = cells.ends[r++]) {
    for (std::size_t k = from; k + 1 < cells.ends[r]; k += 2)
      for (std::size_t axis = 0; axis < 6; ++axis)
        pairs.mean[axis].push_back(0.5 * (cells.mean[axis][k] + cells.mean[axis][k + 1]));
    pairs.ends.push_back(pairs.mean[0].size());
  }
  return pairs;
}

// Quantization noise is the model's Q only where the noise N moves the count between cells by at least this share of a pulse (phase of the
// count 2.4 rad). In shorter cells it has spectral lines, whose frequencies depend on the input; lines at low frequency look like N.
constexpr double least_share_of_pulse = 0.39;
// Fits with cells long enough to have no lines. pulse: rad or m/s; 0: the channel does not count pulses.
void fit_beyond_lines(RestCells cells, const Channels& pulse, AllanResult& result) {
  constexpr std::size_t fewest_cells = 100;
  const auto has_lines = [&](std::size_t axis) {
    const AllanFit& fit = result.axes[axis].fit;
    return fit.made &&
           fit.random_walk().value * std::sqrt(cells.cell_s) < least_share_of_pulse * pulse[Eigen::Index(axis)];
  };
  constexpr std::array<std::size_t, 6> axes = {0, 1, 2, 3, 4, 5};
  while (std::ranges::any_of(axes, has_lines) && cells.mean[0].size() >= 2 * fewest_cells) {
    RestCells pairs = paired(cells);
    const AllanResult longer = allan_deviation(pairs);
    for (const std::size_t axis : axes)
      if (has_lines(axis)) result.axes[axis].fit = longer.axes[axis].fit;
    cells = std::move(pairs);
  }
}

struct ReadRests {
  RestCells cells;
  Channels pulse = Channels::Zero();
  std::vector<std::string> notes;
  Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();  // when there is one rest only
};

// Reads the samples at rest, one after the other.
class RestReader {
 public:
  RestReader(const RecordingInfo& info, Segments segments, std::string path)
      : info_(info),
        segments_(std::move(segments)),
        rest_(segments_),
        path_(std::move(path)),
        maker_(info.sample_period_s),
        stuck_(info.sample_period_s),
        spikes_(info),
        glitches_(info, GlitchLimits::at_rest(info)) {
    const SensorModel model = sensor_model(start_parameters(info), info);
    si_ << model.gyro_scale.diagonal(), model.accel_scale.diagonal();
    si_ = si_.cwiseAbs();
    a_second_ = std::max<std::int64_t>(1, std::llround(1.0 / info.sample_period_s));
  }

  Status add(std::span<const ImuSample> samples) {
    known_.clear();
    for (const ImuSample& sample : samples) stuck_.add(sample, rest_.at(sample.counter), known_);
    return add_known();
  }

  Result<ReadRests> take() {
    known_.clear();
    stuck_.finish(known_);
    TRY(add_known());
    TRY(end_rest());
    ReadRests found;
    found.notes = stuck_.found();
    found.cells = maker_.take(si_);
    if (info_.gyro_increment == IncrementKind::pulses) found.pulse.head<3>() = si_.head<3>();
    if (info_.accel_increment == IncrementKind::pulses) found.pulse.tail<3>() = si_.tail<3>();
    if (found.cells.ends.size() == 1)
      found.force_mps2 = total_.cwiseProduct(si_).tail<3>() / (taken_ * info_.sample_period_s);
    std::vector<double> norms;
    for (std::size_t k = 0; k < found.cells.mean[0].size(); ++k)
      if (!std::isnan(found.cells.mean[3][k]))
        norms.push_back(std::hypot(found.cells.mean[3][k], found.cells.mean[4][k], found.cells.mean[5][k]));
    const std::string wrong = norms.empty() ? "" : wrong_gravity(median(norms) / info_.gravity_mps2, info_);
    if (!wrong.empty()) found.notes.push_back("units: " + wrong);
    if (left_out_ > 0)
      found.notes.push_back(counted(left_out_, "sample") + " left out: marked as bad, glitches, or beyond any unit");
    const std::vector<double>& mean = found.cells.mean[0];
    const auto cells = double(mean.size());
    const auto lost = double(std::ranges::count_if(mean, [](double v) { return std::isnan(v); }));
    constexpr double least_s = 10.0;
    if (cells * found.cells.cell_s < least_s)
      return input_error("{}: {:.3g} s at rest: expected at least {:g} s", path_, cells * found.cells.cell_s, least_s);
    if (lost > 0.0) found.notes.push_back(fmt::format("gaps: {:.2g} % of the time at rest", 100.0 * lost / cells));
    return found;
  }

 private:
  static constexpr std::size_t known_after = 6;   // samples after which a glitch is recognised
  static constexpr std::size_t known_from = 128;  // samples from which the usual scatter is known

  Status add_known() {
    for (const ImuSample& sample : known_) {
      if (!segments_.empty() && !TRY(at_rest(sample.counter))) continue;
      if (sample.flags != 0 || !channels_of(sample).allFinite() || spikes_.spike_in(sample))
        ++left_out_;
      else if (begin_.push_back(sample); begun_ || begin_.size() == known_from)
        TRY(screen());
    }
    return {};
  }

  Status screen() {
    if (!std::exchange(begun_, true) && !begin_.empty()) glitches_.begin_rest(begin_);
    for (const ImuSample& sample : begin_) {
      glitches_.add(sample, found_);
      waiting_.push_back(sample);
      TRY(keep_all_but(known_after));
    }
    begin_.clear();
    return {};
  }

  // After the last sample of a rest, other samples of it serve as its neighbours.
  Status end_rest() {
    TRY(screen());
    for (std::size_t k = 0; k < 3 && waiting_.size() == known_after; ++k) {
      ImuSample neighbour = waiting_[k];
      neighbour.counter = waiting_.back().counter + 1 + std::int64_t(k);
      glitches_.add(neighbour, found_);
    }
    begun_ = false;
    return keep_all_but(0);
  }

  Status keep_all_but(std::size_t last) {
    for (; waiting_.size() > last; waiting_.pop_front()) {
      const std::int64_t counter = waiting_.front().counter;
      const Channels increments = channels_of(waiting_.front());
      auto glitch = found_.rbegin();
      while (glitch != found_.rend() && glitch->sample > counter) ++glitch;
      if (glitch != found_.rend() && glitch->sample == counter) {
        ++left_out_;
        continue;
      }
      maker_.add(counter, increments), total_ += increments, ++taken_;
      if (segments_.empty()) TRY(check_still(counter, increments));
    }
    return {};
  }

  Result<bool> at_rest(std::int64_t counter) {
    while (index_ < segments_.size() && counter >= segments_[index_].end_sample) {
      const Segment& past = segments_[index_++];
      if (index_ == segments_.size()) return false;
      const Segment& next = segments_[index_];
      const bool same = past.kind != SegmentKind::rotate && next.kind != SegmentKind::rotate &&
                        past.end_sample == next.start_sample && past.heading_deg == next.heading_deg &&
                        past.pitch_deg == next.pitch_deg && past.roll_deg == next.roll_deg;
      if (same) continue;
      TRY(end_rest());
      maker_.begin_rest();
    }
    return index_ < segments_.size() && counter >= segments_[index_].start_sample &&
           segments_[index_].kind != SegmentKind::rotate;
  }

  Status check_still(std::int64_t counter, const Channels& increments) {
    if (!first_) first_ = counter;
    sum_ += increments;
    if (++summed_ < a_second_) return {};
    const Channels mean = sum_.cwiseProduct(si_) / (double(summed_) * info_.sample_period_s);
    sum_.setZero();
    summed_ = 0;
    if (!first_mean_) first_mean_ = mean;
    const Channels moved = (mean - *first_mean_).cwiseAbs();
    for (Eigen::Index k = 0; k < 6; ++k)
      if (!(moved[k] < (k < 3 ? moves_radps : moves_mps2)))
        return input_error("{}: {} moves at {:.1f} s: expected a unit at rest; `turncal segment` finds rests", path_,
                           channel_names[std::size_t(k)], double(counter - *first_) * info_.sample_period_s);
    return {};
  }

  const RecordingInfo info_;
  const Segments segments_;
  RestOf rest_;
  const std::string path_;
  RestCellMaker maker_;
  StuckChannels stuck_;
  std::vector<ImuSample> known_;  // of which channels stick
  SpikeFinder spikes_;
  GlitchFinder glitches_;
  std::vector<DataEvent> found_;
  std::vector<ImuSample> begin_;   // not screened yet
  bool begun_ = false;             // the rest has begun
  std::deque<ImuSample> waiting_;  // screened
  Channels si_ = Channels::Zero(), total_ = si_;
  double taken_ = 0.0;  // number of samples in total_
  std::int64_t a_second_ = 1, left_out_ = 0;
  std::size_t index_ = 0;
  std::optional<std::int64_t> first_;
  std::optional<Channels> first_mean_;
  Channels sum_ = Channels::Zero();
  std::int64_t summed_ = 0;
};

Result<ReadRests> read_rests(RecordingSource& source, const std::string& name) {
  RestReader reader(source.info(), source.segments(), name);
  TRY(source.read_to_use([&](std::span<const ImuSample> samples) { return reader.add(samples); }));
  Result<ReadRests> found = reader.take();
  if (const std::string damage = describe(source.damage()); found && !damage.empty()) found->notes.push_back(damage);
  return found;
}

Result<ReadRests> read_rests(const std::string& path, const std::string& map_file) {
  const FileKind kind = recognise_file(path);
  if (map_file.empty() && is_table(kind))
    return input_error(path + ": a table of numbers: expected --map with its columns, or a recording (turncal import)");
  if (map_file.empty() || kind == FileKind::recording) return read_rests(*TRY(RecordingSource::open(path)), path);
  CsvMap map = TRY(read_csv_map(map_file));
  // At rest a reading is the same over a longer interval, so jitter of the stamps does not matter.
  map.increments = CsvMap::Increments::period;
  const ColumnSource source = TRY(open_columns(path, map.topic, map.format.skip_bad_rows));
  std::optional<RestReader> reader;
  const CsvImport table = TRY(stream_columns(
      map, source, nullptr, [&](const CsvImport& begun) { reader.emplace(begun.info, Segments(), path); },
      [&](std::span<const ImuSample> samples) { return reader->add(samples); }));
  Result<ReadRests> found = reader->take();
  if (found && table.jitter_s > 0.01 * table.info.sample_period_s)
    found->notes.push_back(
        fmt::format("time stamps jitter by {:.2g} ms rms: the mean period is used", 1e3 * table.jitter_s));
  if (found && table.bad_rows > 0) found->notes.push_back(table.first_bad);
  return found;
}

Result<AllanResult> deviation_of(const ReadRests& rests, const std::string& path) {
  AllanResult result = allan_deviation(rests.cells);
  for (std::size_t axis = 0; axis < 6; ++axis)
    if (result.axes[axis].points.empty())
      return input_error("{}: {} reads {:g} throughout: expected a channel that is connected and shows noise", path,
                         channel_names[axis], rests.cells.mean[axis].front());
  fit_beyond_lines(rests.cells, rests.pulse, result);
  return result;
}

Result<AllanReport> report_of(const ReadRests& rests, const std::string& source) {
  return AllanReport{.source = source,
                     .against = {},
                     .result = TRY(deviation_of(rests, source)),
                     .sample_s = rests.cells.sample_s,
                     .rests = rests.cells.ends.size(),
                     .mean_force_mps2 = rests.force_mps2,
                     .notes = rests.notes};
}

}  // namespace

Result<AllanReport> allan_report(RecordingSource& source, const std::string& name) {
  return report_of(TRY(read_rests(source, name)), name);
}

Result<AllanReport> allan_report(const AllanRequest& request) {
  const ReadRests rests = TRY(read_rests(request.source, request.map));
  AllanReport report = TRY(report_of(rests, request.source));
  report.against = request.against;
  if (request.against.ends_with(".conf")) {
    const ParameterFile file = TRY(read_parameter_file(request.against));
    if (!has_noise(file))
      return input_error(request.against + ": has no noise. keys: expected a calibration that measured the noise");
    report.file = TRY(stored_noise(file, request.against));
  } else if (!request.against.empty()) {
    const ReadRests other = TRY(read_rests(request.against, request.map));
    report.other = TRY(deviation_of(other, request.against));
  }
  return report;
}

}  // namespace turncal
