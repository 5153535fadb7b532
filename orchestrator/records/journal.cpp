#include "orchestrator/records/journal.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>

#include "imu_io/base/bytes.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/record_log.h"
#include "imu_io/base/text.h"

namespace turncal {

namespace {

constexpr std::array<std::string_view, 13> type_names = {"begin", "transition", "home",    "move",    "dwell",
                                                         "seal",  "resume",     "results", "verdict", "dropout",
                                                         "clock", "estimate",   "settle"};

constexpr std::uint32_t journal_magic = 0x4a435489;  // the bytes 0x89 'T' 'C' 'J'

// Escapes any text as the value of a key-value line: '%', '#' and control characters as %XX, and a blank at either end.
std::string escaped_value(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const bool outer_blank = c == ' ' && (i == 0 || i + 1 == text.size());
    if (c == '%' || c == '#' || c < 0x20 || c == 0x7f || outer_blank)
      result += fmt::format("%{:02x}", c);
    else
      result += text[i];
  }
  return result;
}

std::string_view text_of(const Record& record) {
  return {reinterpret_cast<const char*>(record.payload.data()), record.payload.size()};
}

// Keys of the first unit have no prefix; the others' are unit.2.next_sample and so on.
std::string unit_prefix(std::size_t unit) { return unit == 0 ? "" : "unit." + std::to_string(unit + 1) + "."; }

// Calls `take` for every record; the scanner then says where the good part ends.
Status scan_journal(const PosixFile& file, RecordScanner& scanner, const std::function<Status(const Record&)>& take) {
  Record record;
  for (;;) {
    if (!TRY(scanner.next(record))) break;
    TRY(take(record));
  }
  if (scanner.records_dropped() > 0)
    return input_error(file.path() + ": " + std::to_string(scanner.records_dropped()) +
                       " records are damaged: this journal cannot be relied on");
  if (scanner.next_number() == 0) return input_error(file.path() + ": expected a journal of turncal");
  return {};
}

JournalFields fields_of(KeyValueFile& file) {
  JournalFields fields;
  for (const std::string& key : file.keys()) fields.emplace_back(key, unescaped_value(file.text(key)));
  return fields;
}

// Reads fields whose texts are escaped; an empty text was not written.
void read_record(KeyValueFile& file, const Fields& fields) {
  for (const Field& field : fields) {
    std::string* const* const text = std::get_if<std::string*>(&field.value);
    if (text == nullptr)
      read_fields(file, {field});
    else
      **text = unescaped_value(file.text_or(field.key, ""));
  }
}

CompletedDwell read_dwell(KeyValueFile& file) {
  CompletedDwell dwell;
  dwell.units.resize(1);
  while (file.has(unit_prefix(dwell.units.size()) + "next_sample")) dwell.units.emplace_back();
  read_record(file, fields_of(dwell));
  return dwell;
}

// Returns the number of bytes at the end that are not a record.
Result<std::uint64_t> scan_file(const std::string& path, const std::function<Status(const Record&)>& take) {
  const std::string folder = folder_of(path);
  TRY(expect_file(folder, FileKind::recording));  // the run's folder, or whatever path was given for it
  if (path_exists(folder) && !path_exists(path))
    return input_error("{}: holds no {}: expected the folder of a run", folder, journal_name);
  PosixFile file = TRY(PosixFile::open_to_read(path));
  const std::uint64_t size = TRY(file.size());
  RecordScanner scanner(file, size, journal_magic);
  TRY(scan_journal(file, scanner, take));
  return scanner.tail_bytes();
}

bool same(const RecordingInfo& a, const RecordingInfo& b) {
  return a.sample_period_s == b.sample_period_s && a.latitude_deg == b.latitude_deg &&
         a.gravity_mps2 == b.gravity_mps2 && a.unit_serial == b.unit_serial && a.gyro_increment == b.gyro_increment &&
         a.accel_increment == b.accel_increment && a.accel_pulse_mps == b.accel_pulse_mps &&
         a.has_temperature == b.has_temperature && a.simulated == b.simulated;
}

}  // namespace

std::string_view to_string(JournalType type) {
  const auto index = std::size_t(type) - 1;
  return index < type_names.size() ? type_names[index] : "unknown";
}

std::string unescaped_value(std::string_view text) {
  const auto digit = [](char c) { return c <= '9' ? c - '0' : (c | 0x20) - 'a' + 10; };
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size()) {
      result += char(digit(text[i + 1]) * 16 + digit(text[i + 2]));
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

Fields fields_of(Dropout& dropout) {
  return {{"unit", &dropout.place, at_least(1.0)},
          {"serial", &dropout.serial},
          chosen("kind", dropout.why.kind, {"input", "unit_failed", "aborted", "device", "internal", "interrupted"},
                 "a kind of error"),
          {"time_s", &dropout.at.time_s},
          {"utc_s", &dropout.at.utc_s},
          {"why", &dropout.why.message}};
}

Fields fields_of(Settling& settling) {
  return {{"unit", &settling.unit},
          {"doubt", &settling.doubt},
          {"added_s", &settling.added_s},
          {"why_not", &settling.why_not},
          {"sequence", &settling.sequence}};
}

Fields fields_of(TableCommand& command) {
  Fields fields = {{"time_s", &command.time_s}};
  if (!command.move) return fields;
  Move& move = *command.move;
  fields.push_back(chosen("axis", move.axis, {"heading", "pitch", "roll"}, "heading, pitch or roll"));
  fields.push_back({"target_deg", &move.target_deg});
  fields.push_back({"rate_degps", &move.rate_degps, positive});
  fields.push_back({"acceleration_degps2", &move.acceleration_degps2, positive});
  return fields;
}

Fields fields_of(CompletedDwell& dwell) {
  Fields fields;
  for (std::size_t unit = 0; unit < dwell.units.size(); ++unit) {
    RecordingPoint& at = dwell.units[unit];
    const std::string prefix = unit_prefix(unit);
    fields.push_back({prefix + "next_sample", &at.next_sample, not_negative});
    fields.push_back({prefix + "first_counter", &at.first_counter});
    fields.push_back({prefix + "last_counter", &at.last_counter});
    fields.push_back({prefix + "lost_samples", &at.lost_samples});
    fields.push_back({prefix + "duplicate_samples", &at.duplicate_samples});
  }
  fields.insert(fields.begin() + 3, {"repeated_dwells", &dwell.repeated_dwells, not_negative});
  fields.insert(fields.begin(), {"item", &dwell.item});
  fields.insert(fields.begin() + 7, {{"time_s", &dwell.time_s}, {"utc_s", &dwell.utc_s}});
  for (std::size_t unit = 0; unit < dwell.units.size(); ++unit)
    fields.push_back({unit_prefix(unit) + "written_xxh32", &dwell.units[unit].written, not_negative, true});
  return fields;
}

Result<JournalFile> JournalFile::create(const std::string& path, const JournalFields& begin) {
  if (path_exists(path)) return input_error(path + ": there already is a journal");
  const std::string temporary = temporary_name(path);
  JournalFile journal(TRY(PosixFile::create_new(temporary)), 0);
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
  TRY(scan_journal(file, scanner, [](const Record&) { return Status{}; }));
  if (scanner.good_end() < size) TRY(file.truncate(scanner.good_end()));
  TRY(file.seek(scanner.good_end()));
  TRY(file.sync());
  const std::uint32_t next_number = scanner.next_number();
  return JournalFile(std::move(file), next_number);
}

Status JournalFile::append(JournalType type, const JournalFields& fields) {
  if (!status_) return status_;
  std::vector<std::byte> bytes;
  const std::size_t begun = begin_record(bytes, journal_magic, std::uint32_t(type), next_number_++);
  for (const auto& [key, value] : fields)
    if (!value.empty()) append_bytes(bytes, std::string_view(key + " = " + escaped_value(value) + "\n"));
  end_record(bytes, begun);
  status_ = file_.write_all(bytes);
  if (status_) status_ = file_.sync();
  return status_;
}

Status JournalFile::transition(const TransitionRecord& record) {
  const RunSnapshot& at = record.at;
  return append(JournalType::transition, {{"time_s", format_number(at.time_s)},
                                          {"utc_s", format_number(at.utc_s)},
                                          {"step", std::to_string(at.step)},
                                          {"from", to_string(record.from)},
                                          {"event", to_string(record.event)},
                                          {"to", to_string(record.to)},
                                          {"action", to_string(record.action)},
                                          {"heading_deg", format_number(at.position_deg[Axis::heading])},
                                          {"pitch_deg", format_number(at.position_deg[Axis::pitch])},
                                          {"roll_deg", format_number(at.position_deg[Axis::roll])},
                                          {"detail", record.detail}});
}

Status JournalFile::command(const TableCommand& command) {
  return append(command.move ? JournalType::move : JournalType::home, texts_of(command));
}

Status JournalFile::dwell(const CompletedDwell& dwell) { return append(JournalType::dwell, texts_of(dwell)); }

Status JournalFile::dropout(const Dropout& dropout) { return append(JournalType::dropout, texts_of(dropout)); }

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

const JournalFields* JournalContents::newest(const std::vector<JournalFields>& records, const std::string& unit) const {
  const bool alone = units().size() == 1;
  const JournalFields* last = nullptr;
  for (const JournalFields& record : records)
    if (alone || value_of(record, "unit") == unit) last = &record;
  return last;
}

std::vector<std::string> JournalContents::units() const {
  std::vector<std::string> units = {begin_value("unit")};
  for (std::string serial; !(serial = begin_value("unit." + std::to_string(units.size() + 1))).empty();)
    units.push_back(serial);
  return units;
}

std::string JournalContents::table_warning() const {
  if (!table_unknown || begin_value("manual") == "true") return "";
  return "go to the table before anything else: its state is unknown, it may still move and its drives may be on; "
         "press its emergency stop, find out why the run did not leave it at rest (run.log), and only then go on";
}

Result<JournalContents> read_journal(const std::string& path) {
  JournalContents contents;
  std::size_t commands_kept = 0;
  const auto take = [&](const Record& record) -> Status {
    KeyValueFile fields = TRY(KeyValueFile::parse(text_of(record), path + ": record " + std::to_string(record.number)));
    const auto type = static_cast<JournalType>(record.type);
    if ((record.number == 0) != (type == JournalType::begin))
      return input_error(path + ": expected `begin` first, and once");
    switch (type) {
      case JournalType::begin: contents.begin = fields_of(fields); break;
      case JournalType::home: read_record(fields, fields_of(contents.commands.emplace_back())); break;
      case JournalType::move:
        read_record(fields, fields_of(contents.commands.emplace_back(TableCommand{0.0, Move{}})));
        break;
      case JournalType::dwell:
        contents.last_dwell = read_dwell(fields);
        commands_kept = contents.commands.size();
        for (JournalContents::DroppedUnit& dropped : contents.dropped) dropped.after_last_dwell = false;
        break;
      case JournalType::seal:
        contents.seal_utc_s = fields.number("utc_s");
        contents.hashes.assign(contents.units().size(), "");
        contents.clocks.assign(contents.units().size(), std::nullopt);
        for (std::size_t unit = 0; unit < contents.hashes.size(); ++unit) {
          contents.hashes[unit] = fields.text_or(unit_prefix(unit) + "recording_hash", "");
          if (!fields.has(unit_prefix(unit) + "clock_ppm")) continue;
          contents.clocks[unit] = {fields.number(unit_prefix(unit) + "clock_ppm"),
                                   fields.number(unit_prefix(unit) + "clock_uncertainty_ppm")};
        }
        break;
      case JournalType::resume:  // discards commands after the last completed dwell
        contents.commands.resize(commands_kept);
        std::erase_if(contents.dropped, [](const auto& dropped) { return dropped.after_last_dwell; });
        ++contents.sessions;
        contents.pause_asked = false;
        if (fields.has("overdue_reason")) {  // given at the resume: the table's calibration has expired meanwhile
          std::erase_if(contents.begin, [](const auto& field) { return field.first == "overdue_reason"; });
          contents.begin.emplace_back("overdue_reason", unescaped_value(fields.text("overdue_reason")));
        }
        break;
      case JournalType::verdict: contents.verdicts.push_back(fields_of(fields)); break;
      case JournalType::dropout: read_record(fields, fields_of(contents.dropped.emplace_back())); break;
      case JournalType::settle: read_record(fields, fields_of(contents.settled.emplace_back())); break;
      case JournalType::estimate: contents.estimate = fields_of(fields); break;  // follows from the samples
      case JournalType::transition: {
        contents.transition = fields_of(fields);
        const std::string& event = value_of(contents.transition, "event");
        const auto from = enum_from<RunState>(value_of(contents.transition, "from")),
                   to = enum_from<RunState>(value_of(contents.transition, "to"));
        const auto moves = [](auto in) { return in && (live_states.contains(*in) || in == RunState::stopping); };
        contents.ended = to && is_final(*to) ? to : std::nullopt;
        contents.pause_asked =
            event == to_string(RunEvent::pause_wanted) || (contents.pause_asked && to != RunState::stopping);
        contents.table_unknown =
            event != to_string(RunEvent::stopped_verified) && (contents.table_unknown || moves(from) || moves(to));
        if (to == RunState::failed)
          contents.failed.push_back({fields.number("utc_s"), contents.last_dwell ? contents.last_dwell->utc_s : 0.0});
        break;
      }
      case JournalType::results: contents.results.push_back(fields_of(fields)); break;
      case JournalType::clock: break;
    }
    return fields.status();
  };
  if (const Result<std::uint64_t> torn = scan_file(path, take); !torn) return torn.error();
  contents.commands.resize(commands_kept);
  return contents;
}

Result<std::string> journal_as_text(const std::string& path) {
  std::string text;
  const std::uint64_t torn = TRY(scan_file(path, [&text](const Record& record) -> Status {
    std::string fields(text_of(record));
    for (std::size_t i = 0; (i = fields.find('\n', i)) != std::string::npos; i += 2) fields.replace(i, 1, "; ");
    text += fmt::format("{:5} {:<10} {}\n", record.number, to_string(static_cast<JournalType>(record.type)),
                        fields.substr(0, fields.size() - std::min<std::size_t>(fields.size(), 2)));
    return {};
  }));
  if (torn > 0) text += "      torn at the end: " + std::to_string(torn) + " bytes\n";
  return text;
}

Result<DataTable> journal_as_table(const std::string& path) {
  DataTable table({"record", "type", "key", "value"});
  const auto take = [&table](const Record& record) -> Status {
    std::string_view fields = text_of(record);
    while (!fields.empty()) {
      const std::string_view line = next_line(fields);
      const std::size_t equals = std::min(line.find('='), line.size());
      table.row({record.number, to_string(static_cast<JournalType>(record.type)), trimmed(line.substr(0, equals)),
                 unescaped_value(trimmed(line.substr(std::min(equals + 1, line.size()))))});
    }
    return {};
  };
  TRY(scan_file(path, take));
  return table;
}

std::vector<std::string> runs_newest_first(std::vector<std::string> folders) {
  std::erase_if(folders, [](const std::string& folder) { return !path_exists(folder + "/" + journal_name); });
  std::ranges::stable_sort(folders, std::greater{}, [](const std::string& folder) {
    std::error_code none;
    return std::filesystem::last_write_time(folder + "/" + journal_name, none);
  });
  return folders;
}

std::optional<RunFolder> newest_run(const std::string& runs) {
  std::vector<std::string> folders = names_in(runs);
  for (std::string& folder : folders) folder.insert(0, runs + "/");
  folders = runs_newest_first(std::move(folders));
  for (const std::string& folder : folders)
    if (const std::optional<pid_t> process = lock_holder(folder + "/.lock")) return RunFolder{folder, process};
  return folders.empty() ? std::nullopt : std::optional(RunFolder{folders.front(), std::nullopt});
}

Status RecordingSink::start(const RecordingInfo& info) {
  writer_.emplace(TRY(RecordingWriter::create(folder_ + "/" + partial_recording_name, info)));
  return {};
}

Status RecordingSink::resume(const RecordingInfo& info, std::int64_t end_sample, std::optional<std::uint32_t> written) {
  const std::string path = folder_ + "/" + partial_recording_name;
  TRY(RecordingWriter::check_reopens(path, end_sample, written));
  RecordingWriter writer = TRY(RecordingWriter::reopen(path, RecordingWriter::OpenSegment::drop, end_sample));
  if (!same(writer.info(), info)) {
    const bool kind = writer.info().simulated != info.simulated;
    return input_error(path +
                       (kind ? std::string(": simulated and real data cannot be one recording")
                             : ": was made with another unit, site or kind of samples than this station has now"));
  }
  writer_.emplace(std::move(writer));
  return {};
}

Status RecordingSink::finish() {
  TRY(writer_->finish());
  writer_.reset();
  return rename_durably(folder_ + "/" + partial_recording_name, path());
}

}  // namespace turncal
