#include "orchestrator/records/journal_contents.h"

#include <algorithm>
#include <cstdio>
#include <functional>

#include "imu_io/base/key_value.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {

namespace {

JournalFields fields_of(KeyValueFile& file) {
  JournalFields fields;
  for (const std::string& key : file.keys()) fields.emplace_back(key, unescaped_value(file.text(key)));
  return fields;
}

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

JournalContents::DroppedUnit read_dropout(KeyValueFile& file) {
  JournalContents::DroppedUnit dropped;
  dropped.unit = static_cast<std::size_t>(file.integer("unit", 1)) - 1;
  dropped.why.message = unescaped_value(file.text("why"));
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

// Bytes at the end that are no record.
Result<std::uint64_t> scan_file(const std::string& path, const std::function<Status(const Record&)>& take) {
  PosixFile file = TRY(PosixFile::open_to_read(path));
  const std::uint64_t size = TRY(file.size());
  RecordScanner scanner(file, size, journal_magic);
  TRY(scan_journal(file, scanner, take));
  return scanner.tail_bytes();
}

}  // namespace

const std::string& value_of(const JournalFields& fields, std::string_view key) {
  static const std::string nothing;
  const auto found = std::find_if(fields.begin(), fields.end(), [key](const auto& one) { return one.first == key; });
  return found == fields.end() ? nothing : found->second;
}

const std::string& JournalContents::begin_value(std::string_view key) const { return value_of(begin, key); }

const JournalFields* JournalContents::newest(const std::vector<JournalFields>& records, const std::string& unit) const {
  const bool alone = units().size() == 1;
  const std::pair<std::string, std::string> mark("unit", unit);
  const JournalFields* last = nullptr;
  for (const JournalFields& record : records) {
    if (alone || std::find(record.begin(), record.end(), mark) != record.end()) last = &record;
  }
  return last;
}

const JournalFields* JournalContents::results_of(const std::string& unit) const { return newest(results, unit); }
const JournalFields* JournalContents::verdict_of(const std::string& unit) const { return newest(verdicts, unit); }

std::vector<std::string> JournalContents::units() const {
  std::vector<std::string> units = {begin_value("unit")};
  for (std::string serial; !(serial = begin_value("unit." + std::to_string(units.size() + 1))).empty();)
    units.push_back(serial);
  return units;
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
      case JournalType::home: contents.commands.push_back({fields.number("time_s"), std::nullopt}); break;
      case JournalType::move: contents.commands.push_back(read_move(fields)); break;
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
      case JournalType::resume:  // what was commanded after the last completed dwell is taken back
        contents.commands.resize(commands_kept);
        std::erase_if(contents.dropped, [](const auto& dropped) { return dropped.after_last_dwell; });
        ++contents.sessions;
        contents.pause_asked = false;
        if (fields.has("overdue_reason")) {  // given now: the table's calibration ran out meanwhile
          std::erase_if(contents.begin, [](const auto& field) { return field.first == "overdue_reason"; });
          contents.begin.emplace_back("overdue_reason", unescaped_value(fields.text("overdue_reason")));
        }
        break;
      case JournalType::verdict: contents.verdicts.push_back(fields_of(fields)); break;
      case JournalType::dropout: contents.dropped.push_back(read_dropout(fields)); break;
      case JournalType::estimate: contents.estimate = fields_of(fields); break;  // found again from the samples
      case JournalType::transition:
        contents.transition = fields_of(fields);
        contents.pause_asked |= value_of(contents.transition, "event") == to_string(RunEvent::pause_wanted);
        break;
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
  const Result<std::uint64_t> torn = scan_file(path, [&text](const Record& record) -> Status {
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
      table.text(unescaped_value(trimmed(line.substr(std::min(equals + 1, line.size())))));
    }
    return {};
  };
  TRY(scan_file(path, take));
  return table;
}

}  // namespace turncal
