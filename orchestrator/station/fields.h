// The fields of a thing as one list: the name of each, and where it is. What is written of the thing and read back (key = value text, a
// record of a journal, a row of a database or a table) is made from that list.
//
//   Fields fields_of(Leg& leg) { return {{"turn_deg", &leg.turn_deg}, {"rate_degps", &leg.rate_degps, positive}}; }
//
//   texts_of(leg)                      {"turn_deg", "90"}, {"rate_degps", "10"}
//   read_fields(file, fields_of(leg))  defects stay with the file
//
// A text that is empty and an optional number that is not there are not written; nor is an `optional` field that is 0 or false.
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

// One of several words, by its place among them.
struct Choice {
  std::vector<std::string> words;
  std::string expected;  // for the message
  std::function<std::size_t()> get;
  std::function<void(std::size_t)> set;
};

struct Field {
  std::string key;
  std::variant<std::string*, bool*, int*, std::int64_t*, std::uint64_t*, double*, std::optional<double>*,
               std::optional<std::int64_t>*, std::optional<std::uint32_t>*, Choice>
      value;
  NumberRange range = any_number;  // of a number that is read
  bool optional = false;           // may be missing, and is left as it is then
  double unit = 1.0;               // of a double: what is written is the value over it
};
using Fields = std::vector<Field>;

// Enumerators in the order of `words`, or false and true.
template <class Value>
Field chosen(std::string key, Value& value, std::vector<std::string> words, std::string expected) {
  return {std::move(key), Choice{std::move(words), std::move(expected), [&value] { return std::size_t(value); },
                                 [&value](std::size_t place) { value = static_cast<Value>(place); }}};
}

const Field& field_named(std::string_view key, const Fields& fields);  // REQUIRES one
// "name.1", "name.2" ...
void add_list(const std::string& name, std::vector<std::string>& values, Fields& fields);
// How many of "PREFIX1SUFFIX", "PREFIX2SUFFIX" ... there are without a gap.
std::size_t count_numbered(const KeyValueFile& file, const std::string& prefix, const std::string& suffix = "");

std::string text_of(const Field& field);
std::string json_of(const Field& field);
KeyTexts texts_of(const Fields& fields);
template <class Thing>
KeyTexts texts_of(Thing thing) {
  return texts_of(fields_of(thing));
}
std::string key_value_lines(const KeyTexts& texts);

// False: not of its kind.
bool set_text(const Field& field, std::string_view text);
// Those that are there.
void set_texts(const KeyTexts& texts, const Fields& fields);
void read_fields(KeyValueFile& file, const Fields& fields);

std::string json_of(const Fields& fields);  // one object
DataCell cell_of(const Field& field);
void add_row(const Fields& fields, DataTable& table);  // the columns of the table are those of the fields

const std::string& value_of(const KeyTexts& texts, std::string_view key);  // "" when missing

}  // namespace turncal
