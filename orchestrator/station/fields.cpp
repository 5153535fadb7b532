#include "orchestrator/station/fields.h"

#include <algorithm>

#include "imu_io/base/text.h"

namespace turncal {

namespace {

template <class Value>
std::string text_of_value(const Field& field, const Value& value) {
  if constexpr (std::is_same_v<Value, std::string>)
    return value;
  else if constexpr (std::is_same_v<Value, bool>)
    return value ? "true" : field.optional ? "" : "false";
  else if constexpr (std::is_same_v<Value, double>)
    return field.optional && value == 0.0 ? "" : format_number(value / field.unit);
  else if constexpr (std::is_integral_v<Value>)
    return field.optional && value == 0 ? "" : format_number(value);
  else
    return value ? format_number(*value) : "";
}

template <class Value>
bool set_value(const Field& field, std::string_view text, Value& value) {
  if constexpr (std::is_same_v<Value, std::string>) {
    value = text;
    return true;
  } else if constexpr (std::is_same_v<Value, bool>) {
    value = text == "true";
    return value || text == "false";
  } else if constexpr (std::is_same_v<Value, double>) {
    const std::optional<double> number = parse_number(text);
    if (number) value = *number * field.unit;
    return number && field.range.contains(*number);
  } else if constexpr (std::is_integral_v<Value>) {
    const std::optional<Value> number = parse_integer<Value>(text);
    if (number) value = *number;
    return number && field.range.contains(double(*number));
  } else {
    typename Value::value_type number{};
    const bool good = set_value(field, text, number);
    if (good) value = number;
    return good;
  }
}

std::string expected_of(const Field& field) {
  if (const Choice* const choice = std::get_if<Choice>(&field.value)) return choice->expected;
  if (std::holds_alternative<std::string*>(field.value)) return "a text";
  if (std::holds_alternative<bool*>(field.value)) return "true or false";
  const bool real =
      std::holds_alternative<double*>(field.value) || std::holds_alternative<std::optional<double>*>(field.value);
  return real ? describe(field.range) : "a whole number";
}

}  // namespace

const Field& field_named(std::string_view key, const Fields& fields) {
  return *std::ranges::find_if(fields, [key](const Field& field) { return field.key == key; });
}

void add_list(const std::string& name, std::vector<std::string>& values, Fields& fields) {
  for (std::size_t k = 0; k < values.size(); ++k) fields.push_back({name + "." + std::to_string(k + 1), &values[k]});
}

std::size_t count_numbered(const KeyValueFile& file, const std::string& prefix, const std::string& suffix) {
  std::size_t count = 0;
  while (file.has(prefix + std::to_string(count + 1) + suffix)) ++count;
  return count;
}

std::string text_of(const Field& field) {
  if (const Choice* const choice = std::get_if<Choice>(&field.value)) return choice->words[choice->get()];
  return std::visit(
      [&field](const auto& value) -> std::string {
        if constexpr (std::is_pointer_v<std::decay_t<decltype(value)>>) return text_of_value(field, *value);
        return "";
      },
      field.value);
}

std::string json_of(const Field& field) {
  const std::string text = text_of(field);
  if (std::holds_alternative<std::string*>(field.value) || std::holds_alternative<Choice>(field.value))
    return quoted_json(text);
  return text.empty() || text == "nan" || text == "inf" || text == "-inf" ? "null" : text;
}

KeyTexts texts_of(const Fields& fields) {
  KeyTexts texts;
  for (const Field& field : fields)
    if (std::string text = text_of(field); !text.empty()) texts.emplace_back(field.key, std::move(text));
  return texts;
}

std::string key_value_lines(const KeyTexts& texts) {
  std::string lines;
  for (const auto& [key, text] : texts) lines += key + " = " + text + "\n";
  return lines;
}

bool set_text(const Field& field, std::string_view text) {
  if (const Choice* const choice = std::get_if<Choice>(&field.value)) {
    const auto at = std::ranges::find(choice->words, text);
    if (at == choice->words.end()) return false;
    choice->set(std::size_t(at - choice->words.begin()));
    return true;
  }
  return std::visit(
      [&](const auto& value) -> bool {
        if constexpr (std::is_pointer_v<std::decay_t<decltype(value)>>) return set_value(field, text, *value);
        return false;
      },
      field.value);
}

void set_texts(const KeyTexts& texts, const Fields& fields) {
  for (const Field& field : fields) static_cast<void>(set_text(field, value_of(texts, field.key)));
}

void read_fields(KeyValueFile& file, const Fields& fields) {
  for (const Field& field : fields) {
    const bool is_text = std::holds_alternative<std::string*>(field.value);
    if (!file.has(field.key)) {  // file.text and file.number report what is missing
      if (field.optional) continue;
      is_text ? static_cast<void>(file.text(field.key)) : static_cast<void>(file.number(field.key, field.range));
      continue;
    }
    const std::string text = file.text_or(field.key, "");
    if ((is_text && text.empty()) || !set_text(field, text)) file.reject(field.key, expected_of(field));
  }
}

void add_row(const Fields& fields, DataTable& table) {
  std::vector<DataCell> cells;
  for (const Field& field : fields) cells.push_back(cell_of(field));
  table.row(std::move(cells));
}

DataCell cell_of(const Field& field) {
  const std::string text = text_of(field);
  if (std::holds_alternative<std::string*>(field.value) || std::holds_alternative<Choice>(field.value)) return text;
  return DataCell::of_word(text == "nan" || text == "inf" || text == "-inf" ? "" : text);
}

std::string json_of(const Fields& fields) {
  JsonObject object;
  for (const Field& field : fields) object.raw(field.key, json_of(field));
  return object.end();
}

const std::string& value_of(const KeyTexts& texts, std::string_view key) {
  static const std::string nothing;
  const auto found = std::ranges::find_if(texts, [key](const auto& one) { return one.first == key; });
  return found == texts.end() ? nothing : found->second;
}

}  // namespace turncal
