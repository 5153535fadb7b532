// The keys of a configuration as a table: one line a key, with the field that it sets and what it accepts.
//
//   KeyTable keys(file);
//   keys.number("motion.settle_s", motion.settle_s, between(0.0, 3600.0));
//   keys.chosen("link.parity", link.parity, {"none", "even", "odd"});
//
// A key that is not in the file leaves its field, which holds the default, as it is. Defects stay with the file.
// Without a file the same table looks whether what the fields hold is in its range: for a configuration that was made
// otherwise. Keys that cannot be missing are asked of KeyValueFile.
#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/key_value.h"

namespace turncal {

class KeyTable {
 public:
  // `usual`: the range of the numbers that have none of their own.
  explicit KeyTable(KeyValueFile& file, NumberRange usual = any_number) : file_(&file), usual_(usual) {}
  // Only looks. Defects then begin with `whose`.
  explicit KeyTable(std::string whose, NumberRange usual = any_number) : whose_(std::move(whose)), usual_(usual) {}

  void number(const std::string& key, double& value, NumberRange range);
  void number(const std::string& key, double& value) { number(key, value, usual_); }
  void number(const std::string& key, std::optional<double>& value, NumberRange range);
  void number(const std::string& key, std::optional<double>& value) { number(key, value, usual_); }
  template <class Whole>
  void whole(const std::string& key, Whole& value, Whole min, Whole max) {
    value = static_cast<Whole>(whole_of(key, static_cast<std::int64_t>(value), static_cast<std::int64_t>(min),
                                        static_cast<std::int64_t>(max)));
  }
  void flag(const std::string& key, bool& value);  // true or false
  void text(const std::string& key, std::string& value);
  // The value is the place of the name: enumerators in the order of `names`, false and true.
  template <class Value>
  void chosen(const std::string& key, Value& value, std::initializer_list<std::string_view> names) {
    value = static_cast<Value>(place_of(key, static_cast<std::size_t>(value), names));
  }

  KeyValueFile* file() const { return file_; }      // nullptr: only looks
  const Status& status() const { return status_; }  // without a file: the first value that is out of its range

 private:
  std::int64_t whole_of(const std::string& key, std::int64_t value, std::int64_t min, std::int64_t max);
  std::size_t place_of(const std::string& key, std::size_t place, std::initializer_list<std::string_view> names);
  void refuse(const std::string& key, const std::string& value, const std::string& expected);

  KeyValueFile* file_ = nullptr;
  std::string whose_;
  NumberRange usual_;
  Status status_;
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
