// The fields of a struct as one list: the name of each and a pointer to it. Whatever is written of the struct and read back (key = value text,
// a record of a journal, a row of a database or a table) is made from that list.
//
//   Fields fields_of(Leg& leg) { return {{"turn_deg", &leg.turn_deg}, {"rate_degps", &leg.rate_degps, positive}}; }
//
//   texts_of(leg)                      {"turn_deg", "90"}, {"rate_degps", "10"}
//   read_fields(file, fields_of(leg))  defects stay with the file
//
// An empty text and an optional number without a value are not written; nor is an `optional` field that is 0 or false.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "imu_io/base/data_text.h"
#include "imu_io/base/key_value.h"

namespace turncal {

using KeyTexts = std::vector<std::pair<std::string, std::string>>;

// One of several words, by its index.
struct Choice {
  std::vector<std::string> words;
  std::string expected;  // what the message says was expected
  std::function<std::size_t()> get;
  std::function<void(std::size_t)> set;
};

struct Field {
  std::string key;
  std::variant<std::string*, bool*, int*, std::int64_t*, std::uint64_t*, double*, std::optional<double>*,
               std::optional<std::int64_t>*, std::optional<std::uint32_t>*, Choice>
      value;
  NumberRange range = any_number;  // accepted range when a number is read
  bool optional = false;           // may be missing; it then keeps its value
  double unit = 1.0;               // of a double: the text is the value divided by this
};
using Fields = std::vector<Field>;

// Returns a field whose texts are `words`: for enumerators in that order, or for false and true.
template <class Value>
Field chosen(std::string key, Value& value, std::vector<std::string> words, std::string expected) {
  return {std::move(key), Choice{std::move(words), std::move(expected), [&value] { return std::size_t(value); },
                                 [&value](std::size_t place) { value = static_cast<Value>(place); }}};
}

const Field& field_named(std::string_view key, const Fields& fields);  // REQUIRES that there is one
// Adds the fields "name.1", "name.2" ...
void add_list(const std::string& name, std::vector<std::string>& values, Fields& fields);
// Counts "PREFIX1SUFFIX", "PREFIX2SUFFIX" ... up to the first that is missing.
std::size_t count_numbered(const KeyValueFile& file, const std::string& prefix, const std::string& suffix = "");

std::string text_of(const Field& field);
std::string json_of(const Field& field);
KeyTexts texts_of(const Fields& fields);
template <class Thing>
KeyTexts texts_of(Thing thing) {
  return texts_of(fields_of(thing));
}
std::string key_value_lines(const KeyTexts& texts);

// Returns false when the text does not fit the field's type.
bool set_text(const Field& field, std::string_view text);
// Sets the fields for which there is a text.
void set_texts(const KeyTexts& texts, const Fields& fields);
void read_fields(KeyValueFile& file, const Fields& fields);

std::string json_of(const Fields& fields);  // one object
DataCell cell_of(const Field& field);
void add_row(const Fields& fields, DataTable& table);  // the table has one column a field

const std::string& value_of(const KeyTexts& texts, std::string_view key);  // "" when missing

}  // namespace turncal
