#include "orchestrator/commands/command_segment.h"

#include <cstdio>
#include <functional>
#include <memory>
#include <optional>

#include "calib/rests/rest_data.h"
#include "calib/rests/rest_units.h"
#include "calib/statistics/segmentation.h"
#include "imu_io/base/format_number.h"
#include "imu_io/recordings/csv_map_import.h"
#include "imu_io/recordings/recording_source.h"
#include "imu_io/recordings/recording_text.h"
#include "imu_io/recordings/recording_writer.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/figures/report_format.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct SegmentOptions {
  std::string source;
  std::string out;
  double min_rest_s = SegmentationOptions{}.min_rest_s;
  std::optional<double> threshold;
};

void print_segmentation(const Segmentation& found, const RecordingInfo& info, std::int64_t first, std::ostream& out) {
  const double period = info.sample_period_s;
  out << formatted("threshold %.3g on the ratio of variance to quiet variance: ", found.threshold) << found.reason
      << '\n';
  if (info.gyro_increment == IncrementKind::physical) {
    out << formatted("quiet level: gyros %.3g rad/s, accelerometers %.3g m/s^2 a sample\n", found.quiet_gyro / period,
                     found.quiet_accel / period);
  } else {
    out << formatted("quiet level: gyros %.3g, accelerometers %.3g pulses a sample\n", found.quiet_gyro,
                     found.quiet_accel);
  }
  if (found.slow_turns > 0) {
    out << found.slow_turns << " quiet stretches taken out: their mean rate is that of a slow turn\n";
  }
  if (found.cut > 0) out << found.cut << " rests cut to where the unit stands still\n";
  if (found.moving > 0) out << found.moving << " rests taken out: too little of them is still\n";
  int number = 0;
  out << "rest      from s        to s    length s\n";
  for (const Segment& s : found.segments) {
    if (s.kind != SegmentKind::still) continue;
    out << formatted("%4d  %10.2f  %10.2f  %10.2f\n", ++number, static_cast<double>(s.start_sample - first) * period,
                     static_cast<double>(s.end_sample - first) * period,
                     static_cast<double>(s.end_sample - s.start_sample) * period);
  }
}

// What is plainly wrong with the units, where there are rests to tell it by.
void warn_of_units(const RecordingInfo& info, const Segments& segments,
                   const std::function<void(SegmentedFeed&)>& feed_samples, std::ostream& out) {
  Compressor compressor(info, rest_compression_options());
  SegmentedFeed feed(compressor, segments);
  feed_samples(feed);
  feed.finish();
  const CompressedRecording recording = compressor.take();
  if (const std::string wrong = wrong_units(make_rest_data(recording)); !wrong.empty())
    out << "units: " << wrong << std::endl;
}

Status segment_recording(const SegmentOptions& options, CommandContext& context) {
  std::unique_ptr<RecordingSource> opened = TRY(RecordingSource::open(options.source));
  RecordingSource& source = *opened;
  TRY(check_not_source(options.out, options.source));
  Result<OutputFolder> folder = OutputFolder::prepare(options.out, {binary_recording_name});
  if (!folder) return folder.error();
  SegmentationOptions segmentation;
  segmentation.min_rest_s = options.min_rest_s;
  segmentation.threshold = options.threshold;
  RestFinder finder(source.info(), segmentation);
  const Status read = source.read([&](std::span<const ImuSample> samples) {
    finder.add(samples);
    return Status();
  });
  if (!read) return read;
  const Segmentation found = finder.finish();
  if (found.segments.empty()) {
    return input_error(options.source + ": no rest found: " +
                       (options.threshold ? "no stretch of " + format_number(options.min_rest_s) +
                                                " s stays below the threshold " + format_number(*options.threshold)
                                          : found.reason));
  }
  print_segmentation(found, source.info(), found.segments.front().start_sample, context.out);
  TRY(import_binary(source, found.segments, folder->file(binary_recording_name)));
  folder->keep();
  warn_of_units(
      source.info(), found.segments,
      [&](SegmentedFeed& feed) {
        const Status again = source.read([&](std::span<const ImuSample> samples) {
          feed.add(samples);
          return Status();
        });
        (void)again;  // read once already
      },
      context.out);
  context.out << "written to " << folder->path() << ": " << found.segments.size() << " segments" << std::endl;
  return {};
}

}  // namespace

Status import_mapped_csv(const MappedImport& from, const std::string& out, CommandContext& context) {
  CsvMap map = TRY(read_csv_map(from.map));
  map.format.skip_bad_rows = from.skip_bad_rows;
  const CsvImport content = TRY(import_csv(map, from.file, from.accel));
  Result<OutputFolder> folder = OutputFolder::prepare(out, {binary_recording_name});
  if (!folder) return folder.error();
  TRY(write_recording(content, folder->file(binary_recording_name)));
  folder->keep();
  context.out << "imported into " << folder->path() << ": " << content.samples.size() << " samples of " << content.rows
              << " rows"
              << formatted(", mean period %.6g ms, jitter %.3g ms rms, ", 1e3 * content.info.sample_period_s,
                           1e3 * content.jitter_s)
              << content.saturated << " saturated rows, " << content.gaps << " gaps" << std::endl;
  if (content.clipped > 0)
    context.out << content.clipped << " samples clipped: a gyro repeats its extreme value" << std::endl;
  if (content.bad_rows > 0)
    context.out << content.bad_rows << " bad rows skipped, the first: " << content.first_bad << std::endl;
  if (const Segmentation found = find_rests(content.info, content.samples); !found.segments.empty())
    warn_of_units(
        content.info, found.segments, [&](SegmentedFeed& feed) { feed.add(content.samples); }, context.out);
  return {};
}

void add_segment_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<SegmentOptions>();
  const Command command = line.command("segment", "find the rests of a recording and write it with segments");
  command.option("source", options->source, "recording: a folder or a .tcr file").required();
  command.option("--out", options->out, "folder to write to; must not hold a recording yet").required();
  command
      .option("--threshold", options->threshold,
              "variance over the quiet one at which a rest ends; default: looked for")
      .range(1.0, 1e12);
  command.option("--min-rest", options->min_rest_s, "shortest rest, s").range(0.1, 3600.0);
  command.runs(context, [options, &context] { return segment_recording(*options, context); });
}

}  // namespace turncal
