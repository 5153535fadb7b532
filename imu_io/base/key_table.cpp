#include "imu_io/base/key_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "imu_io/base/format_number.h"

namespace turncal {

void KeyTable::refuse(const std::string& key, const std::string& value, const std::string& expected) {
  if (status_) status_ = input_error(whose_ + ": " + key + " = " + value + ": expected " + expected);
}

void KeyTable::number(const std::string& key, double& value, NumberRange range) {
  if (file_)
    value = file_->number_or(key, value, range);
  else if (!(range.contains(value) && std::isfinite(value)))
    refuse(key, format_number(value), describe(range));
}

void KeyTable::number(const std::string& key, std::optional<double>& value, NumberRange range) {
  if (!file_) return;
  if (const std::optional<double> given = file_->number_if(key, range)) value = given;
}

void KeyTable::flag(const std::string& key, bool& value) {
  if (file_) value = file_->boolean_or(key, value);
}

void KeyTable::text(const std::string& key, std::string& value) {
  if (file_) value = file_->text_or(key, value);
}

std::int64_t KeyTable::whole_of(const std::string& key, std::int64_t value, std::int64_t min, std::int64_t max) {
  if (file_) return file_->integer_or(key, value, min, max);
  if (value < min || value > max)
    refuse(key, std::to_string(value), fmt::format("a whole number between {} and {}", min, max));
  return value;
}

std::size_t KeyTable::place_of(const std::string& key, std::size_t place,
                               std::initializer_list<std::string_view> names) {
  if (!file_) {
    whole_of(key, static_cast<std::int64_t>(place), 0, static_cast<std::int64_t>(names.size()) - 1);
    return place;
  }
  const std::string name = file_->one_of_or(key, names.begin()[place], names);
  // A defect leaves no name; the caller may go on with any value.
  const auto at = std::find(names.begin(), names.end(), name);
  return at == names.end() ? place : static_cast<std::size_t>(at - names.begin());
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
