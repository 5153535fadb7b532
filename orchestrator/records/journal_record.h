// One record of a run's journal: its type, its fields as `key = value` text, and how a journal's records are gone through.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/posix_file.h"
#include "imu_io/base/record_log.h"

namespace turncal {

inline constexpr const char* journal_name = "journal.tcj";
inline constexpr std::uint32_t journal_magic = 0x4a435489;  // the bytes 0x89 'T' 'C' 'J'

enum class JournalType : std::uint32_t {
  begin = 1,
  transition,
  home,
  move,
  dwell,
  seal,
  resume,
  results,
  verdict,
  dropout,
  clock,
  estimate
};
std::string_view to_string(JournalType type);

using JournalFields = std::vector<std::pair<std::string, std::string>>;  // an empty value is left out of the record

// Any text as one value of a key-value line: '%', '#' and control characters as %XX, and a blank at either end.
std::string escaped_value(std::string_view text);
std::string unescaped_value(std::string_view text);
std::string_view text_of(const Record& record);

// The keys of the first unit have no prefix; the others' are unit.2.next_sample and so on.
std::string unit_prefix(std::size_t unit);

inline constexpr std::pair<ErrorKind, std::string_view> dropout_kinds[] = {
    {ErrorKind::input, "input"}, {ErrorKind::unit_failed, "unit_failed"}, {ErrorKind::device, "device"}};

// Calls `take` for every record; the scanner then says where the good part ends.
Status scan_journal(const PosixFile& file, RecordScanner& scanner, const std::function<Status(const Record&)>& take);

}  // namespace turncal
