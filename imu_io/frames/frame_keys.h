// The keys of one variant of a frame description: `<variant>.<key>` where the file has it, else `<key>`, which then holds for
// all variants. Internal to frame_description.cpp. As with KeyValueFile, a defect is remembered there and something harmless is
// returned.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "imu_io/base/key_value.h"
#include "imu_io/frames/frame_description.h"

namespace turncal {

class FrameKeys {
 public:
  FrameKeys(KeyValueFile& file, std::string variant) : file_(file), variant_(std::move(variant)) {}
  KeyValueFile& file() { return file_; }
  std::string name(const std::string& key) const;  // as it stands in the file
  bool has(const std::string& key) const { return file_.has(name(key)); }

  // Decimal, or hexadecimal with 0x in front. Without `otherwise` the key is required.
  std::uint64_t bits(const std::string& key, std::optional<std::uint64_t> otherwise);
  std::vector<std::byte> bytes(const std::string& key);                   // "EB 90"
  std::array<double, 3> three(const std::string& key, double otherwise);  // one number stands for three
  // prefix.type, .order, .word_order, .mask
  FieldForm form(const std::string& prefix, std::string_view default_type);
  // prefix.offset with its form: one offset or as many as are wanted (0: any number); the others follow the only one given.
  std::vector<FrameField> fields(const std::string& prefix, std::string_view default_type, std::size_t wanted);
  // The offsets that stand at `key`, of numbers of this form.
  std::vector<FrameField> places(const std::string& key, const FieldForm& shape, std::size_t wanted);
  FrameField field(const std::string& prefix, std::string_view default_type) {
    return fields(prefix, default_type, 1)[0];
  }

 private:
  KeyValueFile& file_;
  std::string variant_;
};

}  // namespace turncal
