// Tables for other programs: JSON (RFC 8259) and CSV (RFC 4180), one writer for every command and page that has them.
//
// Bytes of a text that are no UTF-8 stand as they are in CSV, and as U+FFFD in JSON.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

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

// Cells are made by the functions below; each knows how it stands in either form.
class DataTable {
 public:
  explicit DataTable(std::vector<std::string> columns) : columns_(std::move(columns)) {}
  void begin_row() { rows_.emplace_back(); }
  // In the order of the columns.
  void text(std::string_view value);
  void number(double value);
  void count(std::int64_t value);
  void flag(bool value);
  void nothing();  // null; an empty cell
  // What reads as a number, true or false is one, and empty is nothing.
  void word(std::string_view value);

  std::string csv() const;
  std::string json() const;         // an array of objects, a line each
  std::string json_object() const;  // of a table of keys and values: one object
  // "csv" or "json".
  std::string as(std::string_view format) const { return format == "json" ? json() : csv(); }

 private:
  struct Cell {
    std::string csv, json;
  };
  std::vector<std::string> columns_;
  std::vector<std::vector<Cell>> rows_;
};
// Lines `key = value`, as key_value.h reads them, each of one line whatever is in the words.
class KeyValues {
 public:
  explicit KeyValues(std::string_view title = {}) : lines_(title) {}
  void comment(std::string_view words);
  void text(std::string_view key, std::string_view value);
  void number(std::string_view key, double value);  // no value where it is not finite
  void flag(std::string_view key, bool value) { text(key, value ? "true" : "false"); }
  std::string take() { return std::move(lines_); }

 private:
  void add_line(std::string line);
  std::string lines_;
};

inline const std::vector<std::string> data_formats = {"json", "csv"};

}  // namespace turncal
