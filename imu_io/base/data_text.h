// Tables for other programs, in JSON (RFC 8259) and CSV (RFC 4180). Every command and page uses this one writer.
//
// Invalid UTF-8 is copied unchanged to CSV, and becomes U+FFFD in JSON.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "imu_io/base/text.h"

namespace turncal {

std::string quoted_json(std::string_view text);
std::string json_number(double value);  // null where it is not finite

std::string json_list(const std::vector<std::string>& jsons);

class JsonObject {
 public:
  void raw(std::string_view key, std::string_view json);
  void text(std::string_view key, std::string_view value) { raw(key, quoted_json(value)); }
  void number(std::string_view key, double value) { raw(key, json_number(value)); }
  void number(std::string_view key, std::optional<double> value) { raw(key, value ? json_number(*value) : "null"); }
  void flag(std::string_view key, bool value) { raw(key, value ? "true" : "false"); }
  void list(std::string_view key, const std::vector<std::string>& jsons) { raw(key, json_list(jsons)); }
  void texts(std::string_view key, const std::vector<std::string>& values);
  std::string end() { return text_ + "}"; }

 private:
  std::string text_ = "{";
};

// A text, number or flag in both forms. A missing value or a number that is not finite is an empty cell in CSV and null in JSON.
struct DataCell {
  DataCell() = default;
  DataCell(std::string_view text);
  DataCell(const std::string& text) : DataCell(std::string_view(text)) {}
  DataCell(const char* text) : DataCell(std::string_view(text)) {}
  template <class Number>
  requires std::is_arithmetic_v<Number> DataCell(Number value) {
    if constexpr (std::is_same_v<Number, bool>)
      csv = json = value ? "true" : "false";
    else if (std::isfinite(double(value)))
      csv = json = format_number(value);
  }
  // Makes a number or a flag of a word that reads as one, nothing of an empty word, else a text.
  static DataCell of_word(std::string_view word);
  // The same of `key = word`; a serial and a hash are texts, whatever their digits.
  static DataCell of_item(std::string_view key, std::string_view word);

  std::string csv, json = "null";
};

class DataTable {
 public:
  explicit DataTable(std::vector<std::string> columns) : columns_(std::move(columns)) {}
  void row(std::vector<DataCell> cells) { rows_.push_back(std::move(cells)); }  // in the order of the columns

  std::string csv() const;
  std::string json() const;         // an array of objects, one per line
  std::string json_object() const;  // one object, from a table of keys and values
  // `format` is "csv" or "json".
  std::string as(std::string_view format) const { return format == "json" ? json() : csv(); }

 private:
  std::vector<std::string> columns_;
  std::vector<std::vector<DataCell>> rows_;
};
// Writes `key = value` lines for key_value.h. Line breaks in a text are replaced, so that each entry stays on one line.
class KeyValues {
 public:
  explicit KeyValues(std::string_view title = {}) : lines_(title) {}
  void comment(std::string_view words);
  void text(std::string_view key, std::string_view value);
  void number(std::string_view key, double value);  // an empty value if not finite
  void flag(std::string_view key, bool value) { text(key, value ? "true" : "false"); }
  std::string take() { return std::move(lines_); }

 private:
  void add_line(std::string line);
  std::string lines_;
};

inline const std::vector<std::string> data_formats = {"json", "csv"};

}  // namespace turncal
