// The text configuration of this project: `key = value`, one dotted key a line, `#` starts a comment.
//
//   KeyValueFile file = ...;                                    // from KeyValueFile::read(path)
//   options.rate_degps = file.number("table.rate_degps", between(0.1, 100.0));
//   options.note = file.text_or("note", "");
//   TRY(file.check_all_used());
//
// Getters never fail on the spot: the first defect is remembered and the getter returns its default (or NaN, 0, false,
// "" for a required key). check_all_used() returns that first defect, else the first key that no getter asked for.
// Until it has returned success the values mean nothing. Every error is one line:
// `file:line: key 'x' = 'y': expected ...`.
//
// Keys: letters, digits, `_`, `-` and `.`; no empty part between dots. A key twice is an error. Values cannot hold `#`
// or a line break; blanks around them are dropped; a list is separated by commas. LF and CRLF. Not modelled: quoting,
// sections, includes.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

// Which numbers a key accepts.
struct NumberRange {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_excluded = false;
  bool or_zero = false;  // 0 switches something off; what is smaller than min and is not 0 is a slip of the pen
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
  std::string beside(const std::string& path) const;  // of a file that a key names: relative to the folder of this one
  // From here on `key` stands for `name.key` where the file has that. Empty: no more.
  void set_scope(std::string_view name) { scope_ = name.empty() ? "" : std::string(name) + "."; }
  bool has(std::string_view key) const { return find(key) != nullptr; }
  std::string name_of(std::string_view key) const;  // as it stands in the file
  // In file order. Asking for keys does not mark them as used.
  std::vector<std::string> keys() const { return keys_with_prefix(""); }
  std::vector<std::string> keys_with_prefix(std::string_view prefix) const;

  // Required: a missing key is a defect. text() also refuses an empty value.
  std::string text(std::string_view key);
  double number(std::string_view key, NumberRange range = any_number);
  std::int64_t integer(std::string_view key, std::int64_t min = std::numeric_limits<std::int64_t>::min(),
                       std::int64_t max = std::numeric_limits<std::int64_t>::max());
  std::string one_of(std::string_view key, std::initializer_list<std::string_view> choices);
  // count: how many numbers are wanted, 0 for any (an empty list then is one too).
  std::vector<double> numbers(std::string_view key, std::size_t count = 0, NumberRange range = any_number);
  std::vector<std::string> list(std::string_view key);

  // Optional: the default when the key is missing; a value that is there is checked all the same.
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
  std::string one_of_or(std::string_view key, std::string_view otherwise,
                        std::initializer_list<std::string_view> choices) {
    return has(key) ? one_of(key, choices) : std::string(otherwise);
  }
  std::vector<double> numbers_or(std::string_view key, std::vector<double> otherwise, std::size_t count = 0,
                                 NumberRange range = any_number) {
    return has(key) ? numbers(key, count, range) : otherwise;
  }
  std::vector<std::string> list_or(std::string_view key, std::vector<std::string> otherwise) {
    return has(key) ? list(key) : otherwise;
  }

  // For the caller's own checks: remembers `file:line: key 'x' = 'y': expected ...` unless there already is a defect.
  void reject(std::string_view key, std::string_view expected);
  // The same line as an error to return.
  Error error_at(std::string_view key, std::string_view expected) const;
  int line_of(std::string_view key) const;             // 0: no such key
  std::string comment_of(std::string_view key) const;  // after the # of its line

  Status status() const;          // the first defect so far
  Status check_all_used() const;  // the same, else the first unknown key; a misspelt one before the missing one

 private:
  struct Entry {
    std::string key;
    std::string value;
    int line = 0;
    std::string comment;
    bool used = false;
  };
  const Entry* find(std::string_view key) const;
  Entry* use(std::string_view key);                                 // marks as used; nullptr when missing
  Entry* require(std::string_view key, std::string_view expected);  // the same; missing is a defect

  std::string file_name_, scope_;
  std::vector<Entry> entries_;
  std::unordered_map<std::string, std::size_t> index_;
  std::optional<Error> first_defect_;
  std::string missing_;                         // the key whose absence is that defect, if it is one
  mutable std::vector<std::string> not_there_;  // every key that was asked for in vain
};

// "a number > 0", "a number between -90 and 90": what messages say after "expected".
std::string describe(NumberRange range);

// The keys of a configuration as a table: one line a key, with the field that it sets and what it accepts.
//
//   KeyTable keys(file);
//   keys.number("motion.settle_s", motion.settle_s, between(0.0, 3600.0));
//   keys.chosen("link.parity", link.parity, {"none", "even", "odd"});
//
// A key that is not in the file leaves its field, which holds the default, as it is. Defects stay with the file. Keys that cannot be
// missing are asked of KeyValueFile.
class KeyTable {
 public:
  // `usual`: the range of the numbers that have none of their own.
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
  // The value is the place of the name: enumerators in the order of `names`, false and true.
  template <class Value>
  void chosen(const std::string& key, Value& value, std::initializer_list<std::string_view> names) {
    value = static_cast<Value>(place_of(key, std::size_t(value), names));
  }

  KeyValueFile& file() const { return file_; }

 private:
  std::size_t place_of(const std::string& key, std::size_t place, std::initializer_list<std::string_view> names);

  KeyValueFile& file_;
  NumberRange usual_;
};

// Where the lines of a description (a register map, a dialect, a frame) come from.
//
//   source.manual = Maker, "Title", edition                 names a source
//   write.stop = 0x50E u32 1000           # [manual]        a line that is taken from it
//   link.terminator_in = \n               # [guess]         a line for which there is none
//   axis.heading.unit = 1                 # [yours]         a setting of the station, which claims nothing of the device
//
// More may stand after the bracket. A line without a mark is the word of whoever wrote the file.
struct LineSource {
  std::string key;
  int line = 0;
  std::string mark;  // empty: none
  bool is_guess() const { return mark == "guess"; }
};

// Of every key but source.*, which it reads. In a file that names sources a comment that begins with none of them is a defect.
std::vector<LineSource> read_line_sources(KeyValueFile& file);

// Where on the earth's surface a unit can stand.
inline constexpr NumberRange site_latitude_deg = between(-90.0, 90.0);
inline constexpr NumberRange site_gravity_mps2 = between(9.7, 9.9);
// Of a recording, whoever made it: a value outside is a slip of unit or of pen.
inline constexpr NumberRange recorded_gravity_mps2 = between(9.0, 11.0);

}  // namespace turncal
