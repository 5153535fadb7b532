#include "orchestrator/records/journal_file.h"

#include <cmath>
#include <cstdio>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/bytes.h"
#include "imu_io/base/format_number.h"

namespace turncal {

namespace {

void append_record(std::vector<std::byte>& out, JournalType type, std::uint32_t number, const JournalFields& fields) {
  const std::size_t begun = begin_record(out, journal_magic, static_cast<std::uint32_t>(type), number);
  for (const auto& [key, value] : fields) {
    if (!value.empty()) append_bytes(out, std::string_view(key + " = " + escaped_value(value) + "\n"));
  }
  end_record(out, begun);
}

}  // namespace

Result<JournalFile> JournalFile::create(const std::string& path, const JournalFields& begin) {
  if (path_exists(path)) return input_error(path + ": there already is a journal");
  const std::string temporary = temporary_name(path);
  PosixFile file = TRY(PosixFile::create_new(temporary));
  JournalFile journal(std::move(file), 0);
  Status status = journal.file_.lock_exclusive();
  if (status) status = journal.append(JournalType::begin, begin);
  if (status) status = rename_durably(temporary, path);
  if (!status) {
    std::remove(temporary.c_str());
    return status.error();
  }
  journal.file_.renamed(path);
  return journal;
}

Result<JournalFile> JournalFile::reopen(const std::string& path) {
  PosixFile file = TRY(PosixFile::open_to_change(path));
  TRY(file.lock_exclusive());
  const std::uint64_t size = TRY(file.size());
  RecordScanner scanner(file, size, journal_magic);
  if (Status status = scan_journal(file, scanner, [](const Record&) { return Status{}; }); !status)
    return status.error();
  if (scanner.good_end() < size) {
    TRY(file.truncate(scanner.good_end()));
    TRY(file.sync());
  }
  TRY(file.seek(scanner.good_end()));
  const std::uint32_t next_number = scanner.next_number();
  return JournalFile(std::move(file), next_number);
}

Status JournalFile::append(JournalType type, const JournalFields& fields) {
  if (failed_) return device_error(file_.path() + ": nothing more is written after an error");
  std::vector<std::byte> bytes;
  append_record(bytes, type, next_number_++, fields);
  Status status = file_.check_kept();
  if (status) status = file_.write_all(bytes);
  if (status) status = file_.sync();
  if (!status) failed_ = true;
  return status;
}

Status JournalFile::transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  return append(JournalType::transition, {{"time_s", format_number(at.time_s)},
                                          {"utc_s", format_number(at.utc_s)},
                                          {"step", std::to_string(at.step)},
                                          {"from", std::string(to_string(record.from))},
                                          {"event", std::string(to_string(record.event))},
                                          {"to", std::string(to_string(record.to))},
                                          {"action", std::string(to_string(record.action))},
                                          {"heading_deg", format_number(at.position_deg[Axis::heading])},
                                          {"pitch_deg", format_number(at.position_deg[Axis::pitch])},
                                          {"roll_deg", format_number(at.position_deg[Axis::roll])},
                                          {"detail", record.detail}});
}

Status JournalFile::home(double time_s) { return append(JournalType::home, {{"time_s", format_number(time_s)}}); }

Status JournalFile::move(const Move& move, double time_s) {
  return append(JournalType::move, {{"time_s", format_number(time_s)},
                                    {"axis", to_string(move.axis)},
                                    {"target_deg", format_number(move.target_deg)},
                                    {"rate_degps", format_number(move.rate_degps)},
                                    {"acceleration_degps2", format_number(move.acceleration_degps2)}});
}

Status JournalFile::dwell(const CompletedDwell& dwell) {
  const auto point = [](const RecordingPoint& at, const std::string& prefix) -> JournalFields {
    return {{prefix + "next_sample", format_number(at.next_sample)},
            {prefix + "first_counter", format_number(at.first_counter)},
            {prefix + "last_counter", format_number(at.last_counter)},
            {prefix + "lost_samples", format_number(at.lost_samples)},
            {prefix + "duplicate_samples", format_number(at.duplicate_samples)}};
  };
  const JournalFields first = point(dwell.units.front(), "");
  JournalFields fields = {{"item", format_number(dwell.item)},
                          first[0],
                          first[1],
                          first[2],
                          {"repeated_dwells", format_number(dwell.repeated_dwells)},
                          first[3],
                          first[4],
                          {"time_s", format_number(dwell.time_s)},
                          {"utc_s", format_number(dwell.utc_s)}};
  for (std::size_t unit = 1; unit < dwell.units.size(); ++unit) {
    const JournalFields more = point(dwell.units[unit], unit_prefix(unit));
    fields.insert(fields.end(), more.begin(), more.end());
  }
  for (std::size_t unit = 0; unit < dwell.units.size(); ++unit)
    if (const std::optional<std::uint32_t>& written = dwell.units[unit].written)
      fields.emplace_back(unit_prefix(unit) + "written_xxh32", std::to_string(*written));
  return append(JournalType::dwell, fields);
}

Status JournalFile::dropout(const Dropout& dropout) {
  std::string kind = "device";
  for (const auto& [candidate, name] : dropout_kinds) {
    if (dropout.why.kind == candidate) kind = name;
  }
  return append(JournalType::dropout, {{"unit", format_number(dropout.unit + 1)},
                                       {"serial", dropout.serial},
                                       {"kind", kind},
                                       {"time_s", format_number(dropout.at.time_s)},
                                       {"utc_s", format_number(dropout.at.utc_s)},
                                       {"why", dropout.why.message}});
}

Status JournalFile::seal(double utc_s, const std::vector<std::string>& hashes) {
  JournalFields fields = {{"utc_s", format_number(utc_s)}};
  for (std::size_t unit = 0; unit < hashes.size(); ++unit)
    fields.emplace_back(unit_prefix(unit) + "recording_hash", hashes[unit]);
  for (std::size_t unit = 0; unit < clocks_.size(); ++unit) {
    if (!clocks_[unit]) continue;
    fields.emplace_back(unit_prefix(unit) + "clock_ppm", format_number(clocks_[unit]->ppm));
    fields.emplace_back(unit_prefix(unit) + "clock_uncertainty_ppm", format_number(clocks_[unit]->uncertainty_ppm));
  }
  return append(JournalType::seal, fields);
}

Status JournalFile::clock_set(double by_s, const RunSnapshot& at) {
  return append(JournalType::clock, {{"time_s", format_number(at.time_s)},
                                     {"utc_s", format_number(at.utc_s)},
                                     {"by_s", format_number(std::round(by_s * 1e3) / 1e3)}});
}

}  // namespace turncal
