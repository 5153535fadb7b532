#include "imu_io/base/key_value.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

constexpr std::size_t max_file_bytes = std::size_t{16} << 20;

bool is_key(std::string_view key) {
  bool part_is_empty = true;
  for (const char c : key) {
    const bool letter = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
    if (!letter && (c != '.' || part_is_empty)) return false;
    part_is_empty = c == '.';
  }
  return !part_is_empty;
}

std::vector<std::string_view> split_at_commas(std::string_view text) {
  return text.empty() ? std::vector<std::string_view>{} : split(text, ',');
}

std::string describe_integer(std::int64_t min, std::int64_t max) {
  using Limits = std::numeric_limits<std::int64_t>;
  const bool below = min != Limits::min(), above = max != Limits::max();
  if (below && above) return fmt::format("a whole number between {} and {}", min, max);
  if (below) return fmt::format("a whole number >= {}", min);
  return above ? fmt::format("a whole number <= {}", max) : "a whole number";
}

constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

}  // namespace

std::string describe(NumberRange range) {
  const bool below = std::isfinite(range.min);
  const bool above = std::isfinite(range.max);
  const std::string min = format_number(range.min);
  const std::string max = format_number(range.max);
  if (below && above) {
    if (range.min_excluded) return "a number > " + min + " and <= " + max;
    return (range.or_zero ? "0, or a number between " : "a number between ") + min + " and " + max;
  }
  if (below) return (range.min_excluded ? "a number > " : "a number >= ") + min;
  if (above) return "a number <= " + max;
  return "a number";
}

Result<KeyValueFile> KeyValueFile::read(const std::string& path) {
  const std::string text = TRY(read_whole_file(path, max_file_bytes));
  return parse(text, path);
}

Result<KeyValueFile> KeyValueFile::parse(std::string_view text, std::string file_name) {
  KeyValueFile file;
  file.file_name_ = std::move(file_name);
  int line_number = 0;
  const auto defect = [&](const std::string& what) {
    return input_error("{}:{}: {}", file.file_name_, line_number, what);
  };
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);  // byte order mark of some editors
  while (!text.empty()) {
    ++line_number;
    std::string_view line = next_line(text);
    for (const char c : line)
      if ((static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7F)
        return defect("a control character: expected a text file");
    const std::size_t mark = line.find('#');
    const std::string_view comment = mark == std::string_view::npos ? "" : trimmed(line.substr(mark + 1));
    line = trimmed(line.substr(0, mark));
    if (line.empty()) continue;
    for (std::string_view left = line; !left.empty();) {
      const std::size_t length = left.front() == '\t' ? 1 : printable_character(left);
      if (length == 0) return defect(turncal::quoted(line) + ": expected printable text in UTF-8");
      left.remove_prefix(length);
    }
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) return defect(turncal::quoted(line) + ": expected key = value");
    const std::string key(trimmed(line.substr(0, equals)));
    if (!is_key(key))
      return defect("key " + turncal::quoted(key) + ": expected letters, digits, '_' and '-', parts joined by '.'");
    const auto [place, is_new] = file.index_.emplace(key, file.entries_.size());
    if (!is_new)
      return defect(fmt::format("key {} again: it is already in line {}", turncal::quoted(key),
                                file.entries_[place->second].line));
    file.entries_.push_back({key, std::string(trimmed(line.substr(equals + 1))), line_number, std::string(comment)});
  }
  if (file.entries_.empty()) return input_error(file.file_name_ + ": empty file: expected key = value lines");
  return file;
}

const KeyValueFile::Entry* KeyValueFile::find(std::string_view key) const {
  for (std::string name = scope_ + std::string(key);; name = key) {
    const auto place = index_.find(name);
    if (place != index_.end()) return &entries_[place->second];
    not_there_.push_back(name);
    if (name == key) return nullptr;
  }
}

std::string KeyValueFile::name_of(std::string_view key) const {
  const Entry* found = find(key);
  return found != nullptr ? found->key : std::string(key);
}

KeyValueFile::Entry* KeyValueFile::use(std::string_view key) {
  const Entry* found = find(key);
  if (found == nullptr) return nullptr;
  Entry& entry = entries_[std::size_t(found - entries_.data())];
  entry.used = true;
  return &entry;
}

KeyValueFile::Entry* KeyValueFile::require(std::string_view key, std::string_view expected) {
  Entry* entry = use(key);
  if (entry == nullptr) reject(key, expected);
  return entry;
}

std::vector<std::string> KeyValueFile::keys_with_prefix(std::string_view prefix) const {
  std::vector<std::string> keys;
  for (const Entry& entry : entries_)
    if (entry.key.starts_with(prefix)) keys.push_back(entry.key);
  return keys;
}

int KeyValueFile::line_of(std::string_view key) const {
  const Entry* entry = find(key);
  return entry == nullptr ? 0 : entry->line;
}

std::string KeyValueFile::beside(const std::string& path) const {
  return path.starts_with('/') ? path : file_name_.substr(0, file_name_.rfind('/') + 1) + path;  // npos + 1: no folder
}

std::string KeyValueFile::comment_of(std::string_view key) const {
  const Entry* entry = find(key);
  return entry == nullptr ? "" : entry->comment;
}

Error KeyValueFile::error_at(std::string_view key, std::string_view expected) const {
  const Entry* entry = find(key);
  if (entry == nullptr) return input_error("{}: key '{}' is missing: expected {}", file_name_, key, expected);
  return input_error("{}:{}: key '{}' = {}: expected {}", file_name_, entry->line, entry->key,
                     turncal::quoted(entry->value), expected);
}

void KeyValueFile::reject(std::string_view key, std::string_view expected) {
  if (first_defect_) return;
  if (!has(key)) missing_ = key;
  first_defect_ = error_at(key, expected);
}

Status KeyValueFile::status() const { return first_defect_ ? Status(*first_defect_) : Status(); }

Status KeyValueFile::check_all_used() const {
  if (first_defect_ && missing_.empty()) return *first_defect_;
  for (const Entry& entry : entries_) {
    if (entry.used) continue;
    const std::string meant = did_you_mean(entry.key, first_defect_ ? std::vector<std::string>{missing_} : not_there_);
    if (first_defect_ && meant.empty()) continue;
    return input_error("{}:{}: key {} is unknown{}", file_name_, entry.line, turncal::quoted(entry.key), meant);
  }
  return status();
}

// ---- values ----

std::string KeyValueFile::text(std::string_view key) {
  const Entry* entry = require(key, "a text");
  if (entry == nullptr) return {};
  if (entry->value.empty()) reject(key, "a text");
  return entry->value;
}

std::string KeyValueFile::text_or(std::string_view key, std::string_view otherwise) {
  const Entry* entry = use(key);
  return entry != nullptr ? entry->value : std::string(otherwise);
}

double KeyValueFile::number(std::string_view key, NumberRange range) {
  const Entry* entry = require(key, describe(range));
  if (entry == nullptr) return no_number;
  const auto value = parse_number(entry->value);
  if (value && range.contains(*value)) return *value;
  reject(key, describe(range));
  return no_number;
}

std::int64_t KeyValueFile::integer(std::string_view key, std::int64_t min, std::int64_t max) {
  const Entry* entry = require(key, describe_integer(min, max));
  if (entry == nullptr) return 0;
  const auto value = parse_integer(entry->value);
  if (value && *value >= min && *value <= max) return *value;
  reject(key, describe_integer(min, max));
  return 0;
}

bool KeyValueFile::boolean_or(std::string_view key, bool otherwise) {
  const Entry* entry = use(key);
  if (entry == nullptr) return otherwise;
  if (entry->value != "true" && entry->value != "false") reject(key, turncal::one_of(entry->value, {"true", "false"}));
  return entry->value == "true";
}

std::string KeyValueFile::one_of(std::string_view key, const std::vector<std::string>& choices) {
  const Entry* entry = require(key, turncal::one_of("", choices));
  if (entry == nullptr) return {};
  if (std::ranges::find(choices, entry->value) != choices.end()) return entry->value;
  reject(key, turncal::one_of(entry->value, choices));
  return {};
}

std::vector<double> KeyValueFile::numbers(std::string_view key, std::size_t count, NumberRange range) {
  std::vector<double> values;
  const Entry* entry = require(key, "numbers separated by commas");
  if (entry != nullptr) {
    const auto parts = split_at_commas(entry->value);
    bool good = count == 0 || parts.size() == count;
    for (const std::string_view part : parts) {
      const auto value = parse_number(part);
      good = good && value && range.contains(*value);
      values.push_back(value.value_or(no_number));
    }
    if (good) return values;
    const std::string how_many = count == 0 ? "numbers" : std::to_string(count) + " numbers";
    reject(key, how_many + " separated by commas, each " + describe(range));
  }
  // Returns the required number of values, so that the caller may index before it checks.
  values.assign(count, no_number);
  return values;
}

std::vector<std::string> KeyValueFile::list(std::string_view key) {
  const Entry* entry = require(key, "names separated by commas");
  if (entry == nullptr) return {};
  const auto parts = split_at_commas(entry->value);
  if (std::ranges::find(parts, "") == parts.end()) return {parts.begin(), parts.end()};
  reject(key, "names separated by commas, none empty");
  return {};
}

std::string KeyValueFile::file_named(std::string_view key) {
  const Entry* const entry = require(key, "a file");
  const Result<PosixFile> file = PosixFile::open_to_read(entry == nullptr ? "" : beside(entry->value));
  if (file) return file->path();
  reject(key, "a file: " + file.error().message);
  return {};
}

// ---- key tables and line sources ----

std::size_t KeyTable::place_of(const std::string& key, std::size_t place, const std::vector<std::string>& names) {
  const std::string name = file_.one_of_or(key, names[place], names);
  // After a defect the word is unknown; the caller may go on with any value.
  const auto at = std::ranges::find(names, name);
  return at == names.end() ? place : std::size_t(at - names.begin());
}

std::vector<LineSource> read_line_sources(KeyValueFile& file) {
  const std::vector<std::string> named = file.keys_with_prefix("source.");
  for (const std::string& key : named) file.text(key);
  std::vector<LineSource> lines;
  for (const std::string& key : file.keys()) {
    if (key.starts_with("source.")) continue;
    LineSource line{key, file.line_of(key), ""};
    const std::string comment = file.comment_of(key);
    const std::size_t end = comment.find(']');
    if (comment.starts_with('[') && end != std::string::npos) line.mark = comment.substr(1, end - 1);
    const bool known = comment.empty() || line.is_guess() || line.mark == "yours" || file.has("source." + line.mark);
    if (!known && !named.empty())
      file.reject(key, "[guess], [yours] or a NAME of a line source.NAME after its #, not '" + comment + "'");
    if (!known) line.mark.clear();
    lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace turncal
