// The text configuration of this project: `key = value`, one dotted key a line, `#` starts a comment.
//
//   KeyValueFile file = ...;                                    // from KeyValueFile::read(path)
//   options.rate_degps = file.number("table.rate_degps", between(0.1, 100.0));
//   options.note = file.text_or("note", "");
//   TRY(file.check_all_used());
//
// Getters do not fail at once: the first defect is remembered, and the getter returns its default (NaN, 0, false or ""
// for a required key). check_all_used() returns that first defect, else the first key that no getter asked for.
// The values are valid only once it has succeeded. Every error is one line:
// `file:line: key 'x' = 'y': expected ...`.
//
// Keys consist of letters, digits, `_`, `-` and `.`, with no empty part between dots. A repeated key is an error. Values cannot
// hold `#` or a line break; blanks around them are dropped; commas separate a list. LF and CRLF. Not modelled: quoting,
// sections, includes.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

// The numbers that a key accepts.
struct NumberRange {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_excluded = false;
  bool or_zero = false;  // 0 switches something off; any other number below min is a mistake
  bool contains(double x) const { return (or_zero && x == 0.0) || ((min_excluded ? x > min : x >= min) && x <= max); }
};
inline constexpr NumberRange any_number{};
inline constexpr NumberRange positive{0.0, std::numeric_limits<double>::infinity(), true};
inline constexpr NumberRange not_negative{0.0};
constexpr NumberRange at_least(double min) { return {min}; }
constexpr NumberRange between(double min, double max) { return {min, max}; }
constexpr NumberRange zero_or(double min, double max) { return {min, max, false, true}; }

class KeyValueFile {
 public:
  static Result<KeyValueFile> read(const std::string& path);
  static Result<KeyValueFile> parse(std::string_view text, std::string file_name);

  const std::string& file_name() const { return file_name_; }
  std::string beside(const std::string& path) const;  // a path named by a key, relative to this file's folder
  // Makes `key` mean `name.key` wherever the file has that. An empty name ends the scope.
  void set_scope(std::string_view name) { scope_ = name.empty() ? "" : std::string(name) + "."; }
  bool has(std::string_view key) const { return find(key) != nullptr; }
  std::string name_of(std::string_view key) const;  // the key as written in the file
  // The keys in file order. This does not mark them as used.
  std::vector<std::string> keys() const { return keys_with_prefix(""); }
  std::vector<std::string> keys_with_prefix(std::string_view prefix) const;

  // Getters of required keys: a missing key is a defect. text() also rejects an empty value.
  std::string text(std::string_view key);
  double number(std::string_view key, NumberRange range = any_number);
  std::int64_t integer(std::string_view key, std::int64_t min = std::numeric_limits<std::int64_t>::min(),
                       std::int64_t max = std::numeric_limits<std::int64_t>::max());
  std::string one_of(std::string_view key, const std::vector<std::string>& choices);
  // count: how many numbers are required; 0 allows any number of them, also none.
  std::vector<double> numbers(std::string_view key, std::size_t count = 0, NumberRange range = any_number);
  std::vector<std::string> list(std::string_view key);
  std::string file_named(std::string_view key);  // the path, beside(), of a file that can be read; empty after a defect

  // Getters of optional keys: the default when the key is missing. A value that is present is always checked.
  std::string text_or(std::string_view key, std::string_view otherwise);
  double number_or(std::string_view key, double otherwise, NumberRange range = any_number) {
    return has(key) ? number(key, range) : otherwise;
  }
  std::optional<double> number_if(std::string_view key, NumberRange range = any_number) {
    return has(key) ? std::optional(number(key, range)) : std::nullopt;
  }
  std::int64_t integer_or(std::string_view key, std::int64_t otherwise,
                          std::int64_t min = std::numeric_limits<std::int64_t>::min(),
                          std::int64_t max = std::numeric_limits<std::int64_t>::max()) {
    return has(key) ? integer(key, min, max) : otherwise;
  }
  bool boolean_or(std::string_view key, bool otherwise);  // true or false
  std::string one_of_or(std::string_view key, std::string_view otherwise, const std::vector<std::string>& choices) {
    return has(key) ? one_of(key, choices) : std::string(otherwise);
  }
  std::vector<double> numbers_or(std::string_view key, std::vector<double> otherwise, std::size_t count = 0,
                                 NumberRange range = any_number) {
    return has(key) ? numbers(key, count, range) : otherwise;
  }
  std::vector<std::string> list_or(std::string_view key, std::vector<std::string> otherwise) {
    return has(key) ? list(key) : otherwise;
  }

  // For the caller's own checks: remembers `file:line: key 'x' = 'y': expected ...` as the first defect, if there is none yet.
  void reject(std::string_view key, std::string_view expected);
  // Returns that line as an error.
  Error error_at(std::string_view key, std::string_view expected) const;
  int line_of(std::string_view key) const;             // 0: no such key
  std::string comment_of(std::string_view key) const;  // the text after the # of its line

  Status status() const;          // the first defect
  Status check_all_used() const;  // the first defect, else the first unknown key; the typo before the missing key

 private:
  struct Entry {
    std::string key;
    std::string value;
    int line = 0;
    std::string comment;
    bool used = false;
  };
  const Entry* find(std::string_view key) const;
  Entry* use(std::string_view key);                                 // marks it as used; nullptr if missing
  Entry* require(std::string_view key, std::string_view expected);  // the same, but a missing key is a defect

  std::string file_name_, scope_;
  std::vector<Entry> entries_;
  std::unordered_map<std::string, std::size_t> index_;
  std::optional<Error> first_defect_;
  std::string missing_;                         // the required key that was missing, if that is the first defect
  mutable std::vector<std::string> not_there_;  // every key that was asked for and not found
};

// Returns "a number > 0", "a number between -90 and 90": the text after "expected" in messages.
std::string describe(NumberRange range);

// The keys of a configuration as a table: one line per key, with the field that it sets and the values that it accepts.
//
//   KeyTable keys(file);
//   keys.number("motion.settle_s", motion.settle_s, between(0.0, 3600.0));
//   keys.chosen("link.parity", link.parity, {"none", "even", "odd"});
//
// A key that is not in the file leaves its field at the default. Defects are remembered by the file. Ask KeyValueFile itself for
// required keys.
class KeyTable {
 public:
  // `usual`: the range for numbers that are given none.
  explicit KeyTable(KeyValueFile& file, NumberRange usual = any_number) : file_(file), usual_(usual) {}

  void number(const std::string& key, double& value, NumberRange range) { value = file_.number_or(key, value, range); }
  void number(const std::string& key, double& value) { number(key, value, usual_); }
  void number(const std::string& key, std::optional<double>& value, NumberRange range) {
    if (file_.has(key)) value = file_.number(key, range);
  }
  void number(const std::string& key, std::optional<double>& value) { number(key, value, usual_); }
  template <class Whole>
  void whole(const std::string& key, Whole& value, Whole min, Whole max) {
    value = static_cast<Whole>(file_.integer_or(key, std::int64_t(value), std::int64_t(min), std::int64_t(max)));
  }
  void flag(const std::string& key, bool& value) { value = file_.boolean_or(key, value); }
  void text(const std::string& key, std::string& value) { value = file_.text_or(key, value); }
  // The value is the index of the word in `names`: enumerators in their order, or false and true.
  template <class Value>
  void chosen(const std::string& key, Value& value, const std::vector<std::string>& names) {
    value = static_cast<Value>(place_of(key, std::size_t(value), names));
  }

  KeyValueFile& file() const { return file_; }

 private:
  std::size_t place_of(const std::string& key, std::size_t place, const std::vector<std::string>& names);

  KeyValueFile& file_;
  NumberRange usual_;
};

// The source of each line of a description (a register map, a dialect, a frame).
//
//   source.manual = Maker, "Title", edition                 names a source
//   write.stop = 0x50E u32 1000           # [manual]        taken from that source
//   link.terminator_in = \n               # [guess]         no source known
//   axis.heading.unit = 1                 # [yours]         a setting of the station, no statement about the device
//
// More text may follow the bracket. A line without a mark rests on its author's word.
struct LineSource {
  std::string key;
  int line = 0;
  std::string mark;  // empty: no mark
  bool is_guess() const { return mark == "guess"; }
};

// Returns the source of every key but source.*. If the file names sources, every comment must begin with one of these marks.
std::vector<LineSource> read_line_sources(KeyValueFile& file);

// The places on Earth where a unit can stand.
inline constexpr NumberRange site_latitude_deg = between(-90.0, 90.0);
inline constexpr NumberRange site_gravity_mps2 = between(9.7, 9.9);
// Gravity in a recording from any origin: a value outside is a wrong unit or a typing error.
inline constexpr NumberRange recorded_gravity_mps2 = between(9.0, 11.0);

}  // namespace turncal
