#include "orchestrator/records/journal_record.h"

#include <cstdio>

namespace turncal {

namespace {

constexpr std::array<std::string_view, 12> type_names = {"begin",   "transition", "home",   "move",
                                                         "dwell",   "seal",       "resume", "results",
                                                         "verdict", "dropout",    "clock",  "estimate"};

}  // namespace

std::string_view to_string(JournalType type) {
  const auto index = static_cast<std::size_t>(type) - 1;
  return index < type_names.size() ? type_names[index] : "unknown";
}

std::string escaped_value(std::string_view text) {
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

std::string unescaped_value(std::string_view text) {
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

std::string_view text_of(const Record& record) {
  return {reinterpret_cast<const char*>(record.payload.data()), record.payload.size()};
}

std::string unit_prefix(std::size_t unit) { return unit == 0 ? "" : "unit." + std::to_string(unit + 1) + "."; }

Status scan_journal(const PosixFile& file, RecordScanner& scanner, const std::function<Status(const Record&)>& take) {
  Record record;
  for (;;) {
    const bool more = TRY(scanner.next(record));
    if (!more) break;
    TRY(take(record));
  }
  if (scanner.records_dropped() > 0) {
    return input_error(file.path() + ": " + std::to_string(scanner.records_dropped()) +
                       " records are damaged: this journal cannot be relied on");
  }
  if (scanner.next_number() == 0) return input_error(file.path() + ": expected a journal of turncal");
  return {};
}

}  // namespace turncal
