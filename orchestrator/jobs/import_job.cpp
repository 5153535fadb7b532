#include "orchestrator/jobs/import_job.h"

#include <fmt/format.h>

#include "calib/rests/rest_data.h"
#include "calib/rests/rest_units.h"
#include "calib/statistics/data_screen.h"
#include "orchestrator/jobs/calibration_job.h"
#include "orchestrator/jobs/navigation/calibrated_intervals.h"

namespace turncal {

namespace {

// An imported recording in memory.
class ImportedSource final : public RecordingSource {
 public:
  ImportedSource(const CsvImport& content, std::string path) : RecordingSource(std::move(path)), content_(content) {
    info_ = content.info;
  }

 private:
  Status stream(const Sink& sink) override { return content_.samples.empty() ? Status() : sink(content_.samples); }
  const CsvImport& content_;
};

}  // namespace

std::string wrong_units_of(RecordingSource& source, const Segments& segments) {
  Compressor compressor(source.info(), rest_compression_options());
  SegmentedFeed feed(compressor, segments);
  static_cast<void>(source.read([&](std::span<const ImuSample> samples) {
    feed.add(samples);
    return Status();
  }));
  feed.finish();
  return wrong_units(make_rest_data(compressor.take()));
}

Result<std::vector<std::string>> defects_of(RecordingSource& source, const Segments& segments) {
  const double period_s = source.info().sample_period_s;
  ChannelLife life(source.info());
  SpikeFinder finder(source.info());
  StuckChannels stuck(period_s);
  RestOf rest(segments);
  std::vector<std::string> spikes, defects;
  std::vector<ImuSample> known;
  TRY(source.read([&](std::span<const ImuSample> samples) {
    known.clear();
    for (const ImuSample& sample : samples) {
      life.add(sample);
      stuck.add(sample, rest.at(sample.counter), known);
      if (const auto k = finder.spike_in(sample))
        spikes.push_back(glitch_of(*k, channel_of(sample, *k), sample.counter, period_s));
    }
    return Status();
  }));
  if (!spikes.empty())
    defects.push_back(counted(std::ssize(spikes), "sample") +
                      " that no unit can have felt, the first: " + spikes.front());
  if (const std::string dead = life.without_change(); !dead.empty()) defects.push_back(dead + ": is it connected?");
  for (const std::string& found : stuck.found()) defects.push_back(found);
  return defects;
}

std::string words_of(const CsvImport& content, const std::string& accel) {
  std::string line = fmt::format("{} of {}, mean period {:.6g} ms, jitter {:.3g} ms rms, {}, {}",
                                 counted(std::ssize(content.samples), "sample"), counted(content.rows, "row"),
                                 1e3 * content.info.sample_period_s, 1e3 * content.jitter_s,
                                 counted(content.saturated, "saturated row"), counted(content.gaps, "gap"));
  if (content.without_accel > 0)
    line += fmt::format("; {} left out, where {} has none", counted(content.without_accel, "row"), accel);
  for (const std::string& more : {content.note, content.chosen})
    if (!more.empty()) line += "; " + more;
  return line;
}

Result<std::vector<std::string>> check_import(const CsvImport& content, const std::string& path, const char* where) {
  ImportedSource source(content, path);
  const Result<Segmentation> found = find_rests(source);
  const Segments segments = found ? found->segments
                                  : Segments{{.kind = SegmentKind::still,
                                              .start_sample = content.samples.front().counter,
                                              .end_sample = content.samples.back().counter + 1}};
  if (const std::string wrong = wrong_units_of(source, segments); !wrong.empty())
    return input_error("units: {}: expected others, another scale or other axes in {}", wrong, where);
  std::vector<std::string> notes;
  if (content.clipped > 0)
    notes.push_back(counted(content.clipped, "sample") + " clipped: a gyro repeats its extreme value");
  for (const std::string& defect : TRY(defects_of(source, segments))) notes.push_back(defect);
  if (content.bad_rows > 0)
    notes.push_back(counted(content.bad_rows, "bad row") + " skipped, the first: " + content.first_bad);
  return notes;
}

}  // namespace turncal
