#include "orchestrator/records/journal_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/bytes.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/record_log.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {

namespace {

constexpr std::uint32_t journal_magic = 0x4a435489;  // the bytes 0x89 'T' 'C' 'J'
constexpr std::array<std::string_view, 12> type_names = {"begin",   "transition", "home",   "move",
                                                         "dwell",   "seal",       "resume", "results",
                                                         "verdict", "dropout",    "clock",  "estimate"};

// Any text as one value of a key-value line: '%', '#' and control characters as %XX, and a blank at either end.
std::string escaped(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const bool outer_blank = c == ' ' && (i == 0 || i + 1 == text.size());
    if (c == '%' || c == '#' || c < 0x20 || c == 0x7f || outer_blank) {
      char code[4];
      std::snprintf(code, sizeof code, "%%%02x", c);
      result += code;
    } else {
      result += text[i];
    }
  }
  return result;
}

std::string unescaped(std::string_view text) {
  const auto digit = [](char c) { return c <= '9' ? c - '0' : c - 'a' + 10; };
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size()) {
      result += static_cast<char>(digit(text[i + 1]) * 16 + digit(text[i + 2]));
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

void append_record(std::vector<std::byte>& out, JournalType type, std::uint32_t number, const JournalFields& fields) {
  const std::size_t begun = begin_record(out, journal_magic, static_cast<std::uint32_t>(type), number);
  for (const auto& [key, value] : fields) {
    if (!value.empty()) append_bytes(out, std::string_view(key + " = " + escaped(value) + "\n"));
  }
  end_record(out, begun);
}

std::string_view text_of(const Record& record) {
  return {reinterpret_cast<const char*>(record.payload.data()), record.payload.size()};
}

JournalFields fields_of(KeyValueFile& file) {
  JournalFields fields;
  for (const std::string& key : file.keys()) fields.emplace_back(key, unescaped(file.text(key)));
  return fields;
}

// Calls `take` for every record; the scanner then says where the good part ends.
Status scan(const PosixFile& file, RecordScanner& scanner, const std::function<Status(const Record&)>& take) {
  Record record;
  for (;;) {
    const Result<bool> more = scanner.next(record);
    if (!more) return more.error();
    if (!*more) break;
    if (Status status = take(record); !status) return status;
  }
  if (scanner.records_dropped() > 0) {
    return input_error(file.path() + ": " + std::to_string(scanner.records_dropped()) +
                       " records are damaged: this journal cannot be relied on");
  }
  if (scanner.next_number() == 0) return input_error(file.path() + ": expected a journal of turncal");
  return {};
}

// The keys of the first unit have no prefix; the others' are unit.2.next_sample and so on.
std::string unit_prefix(std::size_t unit) { return unit == 0 ? "" : "unit." + std::to_string(unit + 1) + "."; }

CompletedDwell read_dwell(KeyValueFile& file) {
  CompletedDwell dwell;
  dwell.item = static_cast<std::size_t>(file.integer("item", 0));
  for (std::size_t unit = 0; unit == 0 || file.has(unit_prefix(unit) + "next_sample"); ++unit) {
    const std::string prefix = unit_prefix(unit);
    std::optional<std::uint32_t> written;
    if (file.has(prefix + "written_xxh32"))
      written = static_cast<std::uint32_t>(file.integer(prefix + "written_xxh32", 0));
    dwell.units.push_back(
        {.next_sample = file.integer(prefix + "next_sample", 0),
         .first_counter = file.integer(prefix + "first_counter"),
         .last_counter = file.integer(prefix + "last_counter"),
         .lost_samples = static_cast<std::uint64_t>(file.integer(prefix + "lost_samples", 0)),
         .duplicate_samples = static_cast<std::uint64_t>(file.integer(prefix + "duplicate_samples", 0)),
         .written = written});
  }
  dwell.repeated_dwells = static_cast<int>(file.integer("repeated_dwells", 0));
  dwell.time_s = file.number("time_s");
  dwell.utc_s = file.number("utc_s");
  return dwell;
}

constexpr std::pair<ErrorKind, std::string_view> dropout_kinds[] = {
    {ErrorKind::input, "input"}, {ErrorKind::unit_failed, "unit_failed"}, {ErrorKind::device, "device"}};

JournalContents::DroppedUnit read_dropout(KeyValueFile& file) {
  JournalContents::DroppedUnit dropped;
  dropped.unit = static_cast<std::size_t>(file.integer("unit", 1)) - 1;
  dropped.why.message = unescaped(file.text("why"));
  dropped.why.kind = ErrorKind::device;
  const std::string kind = file.text("kind");
  for (const auto& [candidate, name] : dropout_kinds) {
    if (kind == name) dropped.why.kind = candidate;
  }
  dropped.after_last_dwell = true;
  return dropped;
}

JournalCommand read_move(KeyValueFile& file) {
  Move move;
  const std::string axis = file.one_of("axis", {"heading", "pitch", "roll"});
  for (Axis candidate : all_axes) {
    if (axis == to_string(candidate)) move.axis = candidate;
  }
  move.target_deg = file.number("target_deg");
  move.rate_degps = file.number("rate_degps", positive);
  move.acceleration_degps2 = file.number("acceleration_degps2", positive);
  return {file.number("time_s"), move};
}

}  // namespace

std::string_view to_string(JournalType type) {
  const auto index = static_cast<std::size_t>(type) - 1;
  return index < type_names.size() ? type_names[index] : "unknown";
}

Result<JournalFile> JournalFile::create(const std::string& path, const JournalFields& begin) {
  if (path_exists(path)) return input_error(path + ": there already is a journal");
  const std::string temporary = temporary_name(path);
  Result<PosixFile> file = PosixFile::create_new(temporary);
  if (!file) return file.error();
  JournalFile journal(std::move(*file), 0);
  Status status = journal.file_.lock_exclusive();
  if (status) status = journal.append(JournalType::begin, begin);
  if (status) status = rename_durably(temporary, path);
  if (!status) {
    std::remove(temporary.c_str());
    return status.error();
  }
  return journal;
}

Result<JournalFile> JournalFile::reopen(const std::string& path) {
  Result<PosixFile> file = PosixFile::open_to_change(path);
  if (!file) return file.error();
  if (Status status = file->lock_exclusive(); !status) return status.error();
  const Result<std::uint64_t> size = file->size();
  if (!size) return size.error();
  RecordScanner scanner(*file, *size, journal_magic);
  if (Status status = scan(*file, scanner, [](const Record&) { return Status{}; }); !status) return status.error();
  if (scanner.good_end() < *size) {
    if (Status status = file->truncate(scanner.good_end()); !status) return status.error();
    if (Status status = file->sync(); !status) return status.error();
  }
  if (Status status = file->seek(scanner.good_end()); !status) return status.error();
  const std::uint32_t next_number = scanner.next_number();
  return JournalFile(std::move(*file), next_number);
}

Status JournalFile::append(JournalType type, const JournalFields& fields) {
  if (failed_) return device_error(file_.path() + ": nothing more is written after an error");
  std::vector<std::byte> bytes;
  append_record(bytes, type, next_number_++, fields);
  Status status = file_.write_all(bytes);
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

const std::string& JournalContents::begin_value(std::string_view key) const {
  static const std::string nothing;
  const auto found = std::find_if(begin.begin(), begin.end(), [key](const auto& field) { return field.first == key; });
  return found == begin.end() ? nothing : found->second;
}

const JournalFields* JournalContents::verdict_of(const std::string& unit) const {
  const bool alone = units().size() == 1;
  const std::pair<std::string, std::string> mark("unit", unit);
  const JournalFields* last = nullptr;
  for (const JournalFields& verdict : verdicts) {
    if (alone || std::find(verdict.begin(), verdict.end(), mark) != verdict.end()) last = &verdict;
  }
  return last;
}

std::vector<std::string> JournalContents::units() const {
  std::vector<std::string> units = {begin_value("unit")};
  for (std::string serial; !(serial = begin_value("unit." + std::to_string(units.size() + 1))).empty();)
    units.push_back(serial);
  return units;
}

Result<JournalContents> read_journal(const std::string& path) {
  Result<PosixFile> file = PosixFile::open_to_read(path);
  if (!file) return file.error();
  const Result<std::uint64_t> size = file->size();
  if (!size) return size.error();
  RecordScanner scanner(*file, *size, journal_magic);
  JournalContents contents;
  std::size_t commands_kept = 0;
  const auto take = [&](const Record& record) -> Status {
    Result<KeyValueFile> fields =
        KeyValueFile::parse(text_of(record), path + ": record " + std::to_string(record.number));
    if (!fields) return fields.error();
    const auto type = static_cast<JournalType>(record.type);
    if ((record.number == 0) != (type == JournalType::begin))
      return input_error(path + ": expected `begin` first, and once");
    switch (type) {
      case JournalType::begin: contents.begin = fields_of(*fields); break;
      case JournalType::home: contents.commands.push_back({fields->number("time_s"), std::nullopt}); break;
      case JournalType::move: contents.commands.push_back(read_move(*fields)); break;
      case JournalType::dwell:
        contents.last_dwell = read_dwell(*fields);
        commands_kept = contents.commands.size();
        for (JournalContents::DroppedUnit& dropped : contents.dropped) dropped.after_last_dwell = false;
        break;
      case JournalType::seal:
        contents.seal_utc_s = fields->number("utc_s");
        contents.hashes.assign(contents.units().size(), "");
        contents.clocks.assign(contents.units().size(), std::nullopt);
        for (std::size_t unit = 0; unit < contents.hashes.size(); ++unit) {
          contents.hashes[unit] = fields->text_or(unit_prefix(unit) + "recording_hash", "");
          if (!fields->has(unit_prefix(unit) + "clock_ppm")) continue;
          contents.clocks[unit] = {fields->number(unit_prefix(unit) + "clock_ppm"),
                                   fields->number(unit_prefix(unit) + "clock_uncertainty_ppm")};
        }
        break;
      case JournalType::resume:  // what was commanded after the last completed dwell is taken back
        contents.commands.resize(commands_kept);
        std::erase_if(contents.dropped, [](const auto& dropped) { return dropped.after_last_dwell; });
        ++contents.sessions;
        if (fields->has("overdue_reason")) {  // given now: the table's calibration ran out meanwhile
          std::erase_if(contents.begin, [](const auto& field) { return field.first == "overdue_reason"; });
          contents.begin.emplace_back("overdue_reason", unescaped(fields->text("overdue_reason")));
        }
        break;
      case JournalType::verdict: contents.verdicts.push_back(fields_of(*fields)); break;
      case JournalType::dropout: contents.dropped.push_back(read_dropout(*fields)); break;
      case JournalType::results:
      case JournalType::clock:
      case JournalType::estimate:  // found again from the samples
      case JournalType::transition: break;
    }
    return fields->status();
  };
  if (Status status = scan(*file, scanner, take); !status) return status.error();
  contents.commands.resize(commands_kept);
  return contents;
}

namespace {

// Bytes at the end that are no record.
Result<std::uint64_t> scan_journal(const std::string& path, const std::function<Status(const Record&)>& take) {
  Result<PosixFile> file = PosixFile::open_to_read(path);
  if (!file) return file.error();
  const Result<std::uint64_t> size = file->size();
  if (!size) return size.error();
  RecordScanner scanner(*file, *size, journal_magic);
  if (Status status = scan(*file, scanner, take); !status) return status.error();
  return scanner.tail_bytes();
}

}  // namespace

Result<std::string> journal_as_text(const std::string& path) {
  std::string text;
  const Result<std::uint64_t> torn = scan_journal(path, [&text](const Record& record) -> Status {
    char head[40];
    const std::string name(to_string(static_cast<JournalType>(record.type)));
    std::snprintf(head, sizeof head, "%5u %-10s", record.number, name.c_str());
    std::string fields(text_of(record));
    for (std::size_t i = 0; (i = fields.find('\n', i)) != std::string::npos; i += 2) fields.replace(i, 1, "; ");
    text += head + (" " + fields.substr(0, fields.size() - std::min<std::size_t>(fields.size(), 2))) + "\n";
    return {};
  });
  if (!torn) return torn.error();
  if (*torn > 0) text += "      torn at the end: " + std::to_string(*torn) + " bytes\n";
  return text;
}

Result<DataTable> journal_as_table(const std::string& path) {
  DataTable table({"record", "type", "key", "value"});
  const auto take = [&table](const Record& record) -> Status {
    std::string_view fields = text_of(record);
    while (!fields.empty()) {
      const std::string_view line = next_line(fields);
      const std::size_t equals = std::min(line.find('='), line.size());
      table.begin_row();
      table.count(record.number);
      table.text(to_string(static_cast<JournalType>(record.type)));
      table.text(trimmed(line.substr(0, equals)));
      table.text(unescaped(trimmed(line.substr(std::min(equals + 1, line.size())))));
    }
    return {};
  };
  const Result<std::uint64_t> torn = scan_journal(path, take);
  if (!torn) return torn.error();
  return table;
}

}  // namespace turncal
