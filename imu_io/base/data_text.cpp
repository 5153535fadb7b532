#include "imu_io/base/data_text.h"

#include <fmt/format.h>

#include <algorithm>

namespace turncal {
namespace {

// Quotes a text where needed. A text that a spreadsheet would take for a formula gets an apostrophe in front.
std::string csv_text(std::string text) {
  if (text.find_first_of("=+-@\t\r") == 0) text.insert(0, "'");
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

}  // namespace

std::string quoted_json(std::string_view text) {
  std::string result = "\"";
  while (!text.empty()) {
    const char c = text.front();
    const std::size_t length = utf8_character(text);
    if (length == 0)
      result += "\\ufffd";
    else if (c == '"' || c == '\\')
      result += std::string("\\") + c;
    else if (static_cast<unsigned char>(c) < 0x20 || c == '<')  // '<': safe inside a page's script, too
      result += fmt::format("\\u{:04x}", unsigned(c));
    else
      result += text.substr(0, length);
    text.remove_prefix(std::max<std::size_t>(1, length));
  }
  return result + "\"";
}

std::string json_number(double value) { return std::isfinite(value) ? format_number(value) : "null"; }

void JsonObject::raw(std::string_view key, std::string_view json) {
  text_ += (text_.size() > 1 ? "," : "") + quoted_json(key) + ":";
  text_ += json;
}

std::string json_list(const std::vector<std::string>& jsons) { return fmt::format("[{}]", fmt::join(jsons, ",")); }

void JsonObject::texts(std::string_view key, const std::vector<std::string>& values) {
  std::vector<std::string> jsons;
  for (const std::string& value : values) jsons.push_back(quoted_json(value));
  list(key, jsons);
}

DataCell::DataCell(std::string_view text) : csv(csv_text(std::string(text))), json(quoted_json(text)) {}

DataCell DataCell::of_word(std::string_view word) {
  if (word.empty()) return {};
  if (word == "true" || word == "false") return word == "true";
  // The word is kept as written, so that no digit is lost. JSON numbers cannot begin with a point or have leading zeros.
  const std::size_t digit = word.starts_with('-') ? 1 : 0;
  const bool plain = word.size() > digit && word[digit] >= '0' && word[digit] <= '9' && word.back() != '.' &&
                     (word[digit] != '0' || word.size() == digit + 1 || word.find_first_of(".eE") == digit + 1);
  DataCell cell(word);
  if (plain && parse_number<double>(word)) cell.csv = cell.json = word;
  return cell;
}

DataCell DataCell::of_item(std::string_view key, std::string_view word) {
  return key.ends_with("serial") || key.ends_with("hash") ? DataCell(word) : of_word(word);
}

std::string DataTable::csv() const {
  std::string text = fmt::format("{}\n", fmt::join(columns_, ","));
  for (const std::vector<DataCell>& row : rows_)
    for (std::size_t k = 0; k < row.size(); ++k) text += row[k].csv + (k + 1 < row.size() ? "," : "\n");
  return text;
}

std::string DataTable::json() const {
  std::string text = "[";
  for (const std::vector<DataCell>& row : rows_) {
    JsonObject object;
    for (std::size_t k = 0; k < row.size(); ++k) object.raw(columns_[k], row[k].json);
    text += (text.size() > 1 ? ",\n" : "\n") + object.end();
  }
  return text + "\n]\n";
}

std::string DataTable::json_object() const {
  std::string text = "{";
  for (const std::vector<DataCell>& row : rows_)
    text += (text.size() > 1 ? ",\n" : "\n") + row[0].json + ":" + row[1].json;
  return text + "\n}\n";
}

void KeyValues::add_line(std::string line) {
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  lines_ += line + "\n";
}

void KeyValues::comment(std::string_view words) { add_line("# " + std::string(words)); }

void KeyValues::text(std::string_view key, std::string_view value) {
  add_line(fmt::format("{} ={}{}", key, value.empty() ? "" : " ", value));
}

void KeyValues::number(std::string_view key, double value) {
  text(key, std::isfinite(value) ? format_number(value) : "");
}

}  // namespace turncal
